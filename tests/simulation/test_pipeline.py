"""From settings to frames: the same bytes in any order and process, bad faces, poses, sequences."""

import json
import subprocess
import sys
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.core.errors import ConfigError, MeshError
from glsim.core.mesh import Mesh
from glsim.faces.face_source import BadFace, Face, FaceKey
from glsim.faces.one_mesh import OneMesh
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.pipeline import Simulator, frames, simulate
from glsim.simulation.plan.tasks import Task, make_tasks
from tests.support.scenes import (
    V2,
    TwoSequences,
    assert_cut,
    face_mesh,
    frames_of,
    moving_settings,
    plate,
    settings_for,
)

COARSE = face_mesh(60)


def fingerprint(frame: Frame | Skipped) -> int:
    """Hash all that a data set would hold."""
    total = 0
    for layer in ("clean", "noisy", "infrared", "reason"):
        total = zlib.crc32(np.ascontiguousarray(frame.image(layer)).tobytes(), total)
    record = [dict(frame.pose), dict(frame.parameters), frame.seed, list(frame.window)]
    return zlib.crc32(json.dumps(record, sort_keys=True).encode(), total)


def plan_of(settings: Settings) -> tuple[list[OneMesh], Sequence[Task]]:
    sources: list[OneMesh] = [TwoSequences(COARSE)]
    return sources, make_tasks(settings, list(sources))


def made(
    context: Context, settings: Settings, tasks: Sequence[Task] | None = None
) -> dict[int, int]:
    sources, whole = plan_of(settings)
    tasks = whole if tasks is None else tasks
    results = simulate(settings, tasks, sources=sources, context=context)
    return {task.index: fingerprint(f) for task, f in zip(tasks, results, strict=True)}


@pytest.mark.parametrize("sensor", ["kinect-v1", "kinect-v2", "kinect-v2-paper"])
def test_a_frame_is_the_same_whatever_was_made_before(context: Context, sensor: str) -> None:
    """Any part of the plan, in any order, by a Simulator that is new or was used before."""
    drawn = {"uniform": [0, 1]}
    stage = {
        "kinect-v1": {"axial": {"angle_mm": drawn}},
        "kinect-v2": {"tof_floor": {"sigma_mm": drawn}},
    }.get(sensor, {})
    settings = moving_settings(sensor, output={"crop": 128}, stage=stage)
    whole = made(context, settings)
    assert len(set(whole.values())) == 24
    sources, tasks = plan_of(settings)
    shuffled = [tasks[n] for n in np.random.default_rng(0).permutation(24)[:9]]
    assert made(context, settings, shuffled) == {t.index: whole[t.index] for t in shuffled}
    worker = Simulator(settings, sources, context)
    for order in (tasks[20:], tasks[5:9][::-1]):
        results = [fingerprint(frame) for frame in worker.frames(order)]
        assert results == [whole[task.index] for task in order]


_FRESH = """
import sys
sys.path.insert(0, sys.argv[1])
import tests.simulation.test_pipeline as t
from glsim.gl.context import describe, open_context
context = open_context(sys.argv[2])
print(describe(context)["renderer"], file=sys.stderr)
print(t.json.dumps([list(t.made(context, t.moving_settings(s, output={"crop": 128})).values())
                    for s in ("kinect-v1", "kinect-v2", "kinect-v2-paper")]))
"""


@pytest.mark.long
@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_other_processes_and_backends_give_the_same_bytes(context: Context, backend: str) -> None:
    """Bytes are guaranteed per renderer; EGL and OSMesa share one without a GPU."""
    done = subprocess.run(
        [sys.executable, "-c", _FRESH, Path(__file__).parents[2], backend],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    same_renderer = done.stderr.split("(")[0] in str(context.info["GL_RENDERER"])
    for sensor, theirs in zip(
        ("kinect-v1", "kinect-v2", "kinect-v2-paper"), json.loads(done.stdout), strict=True
    ):
        ours = list(made(context, moving_settings(sensor, output={"crop": 128})).values())
        assert len(theirs) == len(set(theirs)) == len(ours)
        assert ours == theirs or not same_renderer


@pytest.mark.parametrize("sensor", ["kinect-v1", "kinect-v2", "kinect-v2-paper"])
@pytest.mark.parametrize("wall", [None, 1300])
def test_a_crop_is_cut_from_the_whole_frame(
    context: Context, sensor: str, wall: float | None
) -> None:
    """The bytes agree, noise included."""
    changes: dict[str, object] = {"scene": {"wall_mm": wall}} if wall else {}
    whole = frames_of(context, moving_settings(sensor, **changes), COARSE, 3)
    cut = frames_of(context, moving_settings(sensor, **changes, output={"crop": 128}), COARSE, 3)
    assert_cut(whole, cut, "clean", "noisy", "infrared", "reason")


def test_islands_are_as_large_as_in_the_whole_frame(context: Context) -> None:
    """The crop and its margin are smaller than the islands that are removed."""
    stage = {"despeckle": {"min_area_px": 3000}}
    changes = {"scene": {"wall_mm": 1300}, "stage": stage}
    whole, cut = (
        frames_of(context, moving_settings("kinect-v1", **changes, **crop), COARSE, 3)
        for crop in ({}, {"output": {"crop": 12}})
    )
    assert all(part.noisy.any() for part in cut)
    assert_cut(whole, cut, "noisy", "reason")


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "corner"), [(0, 0, None), (-500, -400, (0, 0)), (500, 500, (384, 296))]
)
def test_a_crop_is_centred_on_the_face_and_stays_in_the_image(
    context: Context, x_mm: float, y_mm: float, corner: tuple[int, int] | None
) -> None:
    pose = {"x_mm": x_mm, "y_mm": y_mm, "distance_mm": 800}
    (frame,) = frames_of(context, settings_for(pose=pose, output={"crop": 128}), COARSE)
    assert frame.clean.shape == (128, 128)
    assert frame.clean.any()
    left, top = V2.cx - frame.intrinsics.cx, V2.cy - frame.intrinsics.cy
    assert (left, top) == pytest.approx(corner or (round(V2.cx - 64), round(V2.cy - 64)))


def test_a_crop_larger_than_the_image_is_refused(context: Context) -> None:
    with pytest.raises(ConfigError, match=r"output.crop 425 is larger than the sensor's 512x424"):
        frames_of(context, settings_for(output={"crop": 425}), COARSE)


class Mixed(OneMesh):
    """Good faces, and one bad face of each kind."""

    _NAN = Mesh(np.full((3, 3), np.nan, np.float32), np.array([[0, 1, 2]], np.int32))
    _AWAY = Mesh(plate().vertices_mm + np.array([9000, 0, 0], np.float32), plate().faces)

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:  # type: ignore[override]
        for key in keys:
            if key.frame % 4 == 1:
                yield BadFace(key, MeshError("cannot be read"))
            else:
                yield Face(key, (self._mesh, plate(), self._NAN, self._AWAY)[key.frame % 4])


@pytest.mark.parametrize("crop", [None, 64])
def test_bad_faces_are_skipped_in_order_or_stop(context: Context, crop: int | None) -> None:
    settings = settings_for(
        source={"kind": "folder", "frames_per_subject": 6}, output={"crop": crop}
    )
    results = list(simulate(settings, sources=[Mixed(COARSE)], context=context))
    assert [result.key.frame for result in results] == list(range(6))
    assert [isinstance(result, Skipped) for result in results] == [False, *[True] * 3, False, True]
    why = [result.why for result in results if isinstance(result, Skipped)]
    assert why[0] == why[3] == "cannot be read"
    assert "vertices are NaN" in why[1]
    assert "out of view" in why[2]
    strict = settings.model_copy(update={"strict": True})
    with pytest.raises(MeshError, match="cannot be read"):
        list(simulate(strict, sources=[Mixed(COARSE)], context=context))
    several = frames(settings, sources=[Mixed(COARSE)], context=context)
    assert fingerprint(next(several)) == fingerprint(results[0])
    with pytest.raises(MeshError, match="cannot be read"):
        next(several)


@pytest.mark.parametrize("crop", [None, 64])
def test_a_face_at_the_camera_is_skipped(context: Context, crop: int | None) -> None:
    settings = settings_for(pose={"distance_mm": 50}, output={"crop": crop})
    (result,) = simulate(settings, sources=[OneMesh(plate())], context=context)
    assert "behind the camera or nearer than 100 mm" in result.why
    for distance_mm in (0, -500, 1e6):
        with pytest.raises(ConfigError, match=r"distance_mm may be .* must lie in .* mm$"):
            settings_for(pose={"distance_mm": distance_mm})


def test_a_data_set_of_nobody_is_an_error() -> None:
    with pytest.raises(ConfigError, match=r"source 'folder' needs --root"):
        next(simulate(load_settings(overrides={"source": {"kind": "folder"}})))


def test_a_mesh_wound_inside_out_is_skipped_not_empty(context: Context) -> None:
    mesh = face_mesh()
    inside_out = Mesh(mesh.vertices_mm, np.ascontiguousarray(mesh.faces[:, ::-1]))
    settings = load_settings(overrides={"source": {"subjects": 1, "frames_per_subject": 1}})
    (result,) = simulate(settings, sources=[OneMesh(inside_out)], context=context)
    assert "inside out" in result.why


def test_settings_are_held_within_a_sequence_and_noise_is_not(context: Context) -> None:
    tree = {
        "sensor": "kinect-v2-fast",
        "pose": {"distance_mm": {"uniform": [800, 1200]}, "motion": 0},
        "variation": {"shape_mm": {"uniform": [1, 3]}, "per": "frame"},
        "stage": {"tof_fast": {"gain": {"uniform": [1000, 3000]}}},
        "output": {"crop": 64},
    }
    drawn = {}
    for redraw in (None, "sequence"):
        settings = load_settings(overrides=tree | ({"redraw": redraw} if redraw else {}))
        sources, tasks = plan_of(settings)
        frames = list(simulate(settings, tasks, sources=sources, context=context))
        assert all(isinstance(frame, Frame) for frame in frames)
        drawn[redraw] = frames
    held: dict[str, list[Frame]] = {}
    for frame in drawn["sequence"]:
        assert isinstance(frame, Frame)
        held.setdefault(frame.key.sequence, []).append(frame)
    assert len(held) == 2
    for first, *others in held.values():
        for other in others:
            assert other.pose == first.pose
            assert other.parameters == first.parameters
            np.testing.assert_array_equal(other.clean, first.clean)
            assert not np.array_equal(other.noisy, first.noisy)
            assert other.seed != first.seed
    one, other = (sequence[0] for sequence in held.values())
    assert one.pose != other.pose
    assert one.parameters != other.parameters
    free = drawn[None]
    assert len({json.dumps(dict(f.pose), sort_keys=True) for f in free}) == len(free)
