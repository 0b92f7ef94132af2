"""Earlier frames of a stereo camera: other draws of its noise, for its filter over time."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moderngl import Context

from glsim.core.seeds import stable_seed
from glsim.faces.one_mesh import OneMesh
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import Simulator
from glsim.simulation.plan.tasks import make_tasks
from tests.support.scenes import face_mesh, rig_toml

ALPHA = 0.4


def camera(folder: Path) -> str:
    """A small D435."""
    file = folder / "small.toml"
    file.write_text(f'extends = "realsense-d435"\ntitle = "small"\n{rig_toml(200, 150, 140)}')
    return str(file)


def settings_of(sensor: str, **stages: dict[str, Any]) -> Settings:
    return load_settings(
        overrides={
            "sensor": sensor,
            "stage": stages,
            "pose": {"distance_mm": 600, "motion": 0},
            "scene": {"wall_mm": 900},
            "output": {"depth_unit_mm": 0.05},
        },
        source={"subjects": 1, "frames_per_subject": 3},
    )


def draw(context: Context, settings: Settings, *seeds: int) -> list[Frame]:
    """Frames of the plate before a wall, each with its own seed (default: those of the plan)."""
    source = OneMesh(face_mesh(40))
    tasks = list(make_tasks(settings, [source]))
    if seeds:
        tasks = [replace(tasks[0], seeds=tasks[0].seeds._replace(frame=seed)) for seed in seeds]
    simulator = Simulator(settings, [source], context, ("earlier_depth", "disparity"))
    frames = [frame for frame in simulator.frames(tasks) if isinstance(frame, Frame)]
    assert len(frames) == len(tasks)
    return frames


def filtered(**p: float) -> dict[str, dict[str, float]]:
    return {
        "temporal_filter": {"enabled": True, "alpha": ALPHA, "unit_mm": 0} | p,
        "match_stereo": {"depth_unit_mm": 0.05, "subpixel_steps": 256},
    }


def test_a_frame_before_is_the_frame_of_its_own_seed(context: Context, tmp_path: Path) -> None:
    """The twin exposes as the shader does, but for counts on the edge of a rounding."""
    settings = settings_of(camera(tmp_path), **filtered())
    (now,) = draw(context, settings, 1234)
    earlier = now.extra["earlier_depth"]
    assert earlier.shape == (*now.clean_m.shape, 8)
    off = settings_of(camera(tmp_path), match_stereo=filtered()["match_stereo"])
    seeds = [stable_seed("earlier frame", 1234, before) for before in (8, 1)]
    for number, frame in zip((0, 7), draw(context, off, *seeds), strict=True):
        assert (earlier[..., number] == frame.noisy_m).mean() > 0.99
        assert (earlier[..., number] != now.noisy_m).mean() > 0.5
        assert "earlier_depth" not in frame.extra, "without the filter there are none"


@pytest.mark.parametrize("count", [pytest.param(8, marks=pytest.mark.long), 2])
def test_noise_in_time_falls_as_alpha_says(context: Context, tmp_path: Path, count: int) -> None:
    """N frames before: variance a^2 (1 + q + ... + q^(N-1)) + q^N with q = (1 - a)^2."""
    deviation = []
    for enabled in (False, True):
        stages = filtered(enabled=enabled)
        stages["match_stereo"]["earlier_frames"] = count
        frames = draw(context, settings_of(camera(tmp_path), **stages), *range(12))
        depth_m = np.stack([frame.noisy_m for frame in frames])
        found = (depth_m > 0).all(axis=0)
        px = 140 * 0.05017 / np.where(found, depth_m, 1.0)
        deviation.append(np.where(found, px.std(axis=0, ddof=1), np.inf))
    q = (1 - ALPHA) ** 2
    wanted = np.sqrt(ALPHA**2 * sum(q**n for n in range(count)) + q**count)
    calm = np.maximum(*deviation) < 0.15  # a pixel that jumps between surfaces starts anew
    assert calm.mean() > 0.5
    falls = np.sqrt((deviation[1][calm] ** 2).mean() / (deviation[0][calm] ** 2).mean())
    assert falls == pytest.approx(wanted, rel=0.1)


def test_the_same_bytes_alone_and_in_any_order(context: Context, tmp_path: Path) -> None:
    settings = settings_of(camera(tmp_path), **filtered())
    first, second, third = draw(context, settings)
    again = draw(context, settings, third.seed, first.seed)
    assert np.array_equal(again[1].noisy_m, first.noisy_m)
    assert not np.array_equal(second.noisy_m, first.noisy_m)
