"""librealsense's filters in a chain: crops, earlier frames of the same scene, the same bytes."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
import pytest

import glsim
from glsim.sensors import sensor
from glsim.simulation.corrupt import Corrupter
from tests.support.scenes import (
    face_mesh,
    frames_of,
    moving_settings,
    plate,
    sensor_file,
    settings_for,
)

COARSE = face_mesh(60)

#: A stage that writes this frame's depth and earlier ones, each a draw of its own.
DRAWS = """
import numpy as np
from glsim import array_stage

@array_stage(earlier_frames=("int", 7, 0, 30, "1", "frames before this one"))
def draws(view, layers, p):
    "Adds white noise, drawn anew for each earlier frame."
    drawn = []
    for number in range(int(p["earlier_frames"]) + 1):
        rng = np.random.default_rng([view.seed, number])
        noise = rng.standard_normal((view.height, view.width))[view.window.slices]
        disparity = 32 * view.focal_baseline_px_m / np.maximum(layers["depth"], 1e-3) + 3 * noise
        depth = 32 * view.focal_baseline_px_m / disparity
        drawn.append(np.where(layers["depth"] > 0, depth, 0))
    return {"depth": drawn[0], "earlier_depth": np.stack(drawn[1:], axis=-1)}
"""


def kinect_with(folder: Path, *stages: str) -> str:
    """The file of a Kinect V1 with more stages at its end."""
    shipped = Path(sensor.__file__).parent / "kinect-v1.toml"
    file = folder / "mine.toml"
    file.write_text(shipped.read_text() + "".join(f"\n[[stage]]\n{stage}\n" for stage in stages))
    return str(file)


@pytest.mark.parametrize(
    "stages",
    [
        ('use = "spatial_filter"\nfilling_mode = 4',),
        ('use = "spatial_filter"', 'use = "hole_filling"\nmode = 0'),
        ('use = "hole_filling"', 'use = "threshold_filter"\nfar_mm = 1200'),
    ],
)
def test_a_crop_is_filtered_as_the_whole_frame(
    context: moderngl.Context, tmp_path: Path, stages: tuple[str, ...]
) -> None:
    named = kinect_with(tmp_path, *stages)
    scene = {"wall_mm": 1300}
    whole, cut = (
        frames_of(context, moving_settings(named, scene=scene, **crop), COARSE, 2)
        for crop in ({}, {"output": {"crop": 64}})
    )
    for full, part in zip(whole, cut, strict=True):
        left = round(full.intrinsics.cx - part.intrinsics.cx)
        top = round(full.intrinsics.cy - part.intrinsics.cy)
        window = np.s_[top : top + 64, left : left + 64]
        assert (part.noisy > 0).mean() > 0.2
        for layer in ("noisy", "reason"):
            np.testing.assert_array_equal(part.image(layer), full.image(layer)[window])


def test_earlier_frames_of_the_scene_smooth_this_one(
    context: moderngl.Context, tmp_path: Path
) -> None:
    """White noise falls to 1/2 of its sigma, by alpha / (2 - alpha); the same bytes each time."""
    (tmp_path / "draws.py").write_text(DRAWS)
    temporal = 'use = "temporal_filter"\nunit_mm = 0'
    named = sensor_file(tmp_path, 'use = "draws.py:draws"', temporal, emitter=True)
    sigmas = []
    for enabled in (False, True):
        fine = {"output": {"depth_unit_mm": 0.02}}
        chosen = settings_for(named, stage={"temporal_filter": {"enabled": enabled}}, **fine)
        made, again = (frames_of(context, chosen, plate())[0] for _ in range(2))
        assert made.noisy.tobytes() == again.noisy.tobytes()
        inside = made.noisy[made.clean > 0].astype(float)
        sigmas.append(inside.std())
    assert sigmas[1] / sigmas[0] == pytest.approx(np.sqrt(0.4 / 1.6), rel=0.06)


def test_a_still_sequence_of_depth_maps_is_filtered_after_it_was_made() -> None:
    """A recording, or frames of a Corrupter: noise falls and rims keep their depth."""
    depth = np.full((60, 80), 1.6, np.float32)
    depth[20:40, 20:50] = 0.9
    with Corrupter(settings_for("kinect-v1"), depth.shape, backend="numpy") as camera:
        noisy = camera(np.stack([depth] * 12))
        focal_baseline_px_m = camera.rig.intrinsics.fx * camera.rig.baseline_m
    filtered = glsim.filter_sequence(noisy, focal_baseline_px_m)
    assert filtered.shape == noisy.shape
    assert filtered.dtype == np.float32
    known = (noisy[-1] > 0)[24:36, 24:46]
    error, before = ((m[-1] - depth)[24:36, 24:46][known] for m in (filtered, noisy))
    assert np.abs(error).mean() < 0.8 * np.abs(before).mean()
    assert ((filtered[-1] > 1.0) & (filtered[-1] < 1.5)).mean() <= (
        (noisy[-1] > 1.0) & (noisy[-1] < 1.5)
    ).mean()
    assert (filtered[-1] > 0).sum() > (noisy[-1] > 0).sum()
