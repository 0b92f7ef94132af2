"""Depth registered to the colour camera: where pixels land, what is lost, and what agrees."""

from pathlib import Path

import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.core.camera import ColourCamera, Intrinsics
from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import Settings, with_assignments
from glsim.simulation.depth_noise import DepthNoise
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import frames
from glsim.simulation.registration import register

PERSON = [{"kind": "procedural", "subjects": 1, "frames_per_subject": 1}]
#: A camera without noise whose colour camera stands 50 mm beside it and is turned.
TURNED = """
extends = "ideal"
title = "no noise, registered"
[rig]
deliver = "colour"
[rig.colour]
width = 640
height = 400
focal_px = [520, 530]
centre_px = [310, 190]
position_m = [0.05, -0.01, 0.004]
turn_deg = [3, -5, 2]
"""


def drawn(context: Context, sensor: str, **values: object) -> Frame:
    given = {"sensor": sensor, "source": PERSON, "pose.distance_mm": 700, "pose.yaw_deg": 20}
    settings = with_assignments(
        Settings(), given | {k.replace("__", "."): v for k, v in values.items()}
    )
    return next(iter(frames(settings, context=context, layers=("clean", "noisy", "regions"))))


@pytest.fixture
def turned(tmp_path: Path) -> str:
    file = tmp_path / "turned.toml"
    file.write_text(TURNED)
    return str(file)


def as_librealsense(
    depth_mm: NDArray[np.uint16], image: Intrinsics, colour: ColourCamera
) -> NDArray[np.uint16]:
    """Align depth to colour by librealsense's published rule: corners are rounded to pixels."""
    seen, matrix = colour.intrinsics, colour.from_depth()
    aligned = np.zeros((seen.height, seen.width), np.uint16)
    for row, column in zip(*np.nonzero(depth_mm), strict=True):
        near, z = depth_mm[row, column], depth_mm[row, column] / 1000.0
        ends = []
        for off in (-0.5, 0.5):
            x = (column + off - (image.cx - 0.5)) / image.fx * z
            y = (row + off - (image.cy - 0.5)) / image.fy * z
            point = matrix[:3, :3] @ (x, y, z) + matrix[:3, 3]
            u = seen.fx * point[0] / point[2] + seen.cx - 0.5
            v = seen.fy * point[1] / point[2] + seen.cy - 0.5
            ends.append((int(u + 0.5), int(v + 0.5)))
        (left, top), (right, bottom) = ends
        if left < 0 or top < 0 or right >= seen.width or bottom >= seen.height:
            continue
        part = aligned[top : bottom + 1, left : right + 1]
        np.copyto(part, np.where(part > 0, np.minimum(part, near), near))
    return aligned


@pytest.mark.long
def test_pixels_land_where_librealsense_puts_them(context: Context) -> None:
    noisy = drawn(context, "realsense-d435", scene__wall_mm=1500).noisy
    rig = load_sensor("realsense-d435", rig_overrides={"deliver": "colour"}).rig
    assert rig.colour is not None
    layers = {"depth": noisy / np.float32(1000.0), "clean": np.zeros(noisy.shape, np.float32)}
    layers["reason"] = np.zeros(noisy.shape, np.float32)
    whole = Rect(0, 0, rig.delivered.width, rig.delivered.height)
    true = {"clean": np.ones((whole.height, whole.width), np.float32)}
    all_of_depth = Rect(0, 0, rig.intrinsics.width, rig.intrinsics.height)
    ours = register(layers, all_of_depth, rig.intrinsics, rig.colour, true, whole)["depth"]
    theirs = as_librealsense(noisy, rig.intrinsics, rig.colour)
    assert (theirs > 0).mean() > 0.8
    inside = np.s_[2:-2, 2:-2]  # librealsense drops pixels that reach over the border
    assert (np.rint(ours * 1000)[inside] == theirs[inside]).mean() > 0.999


def test_a_pixel_covers_what_its_corners_span_or_one_pixel() -> None:
    image, seen = (Intrinsics(20, 20, f, f, 10.0, 10.0) for f in (50.0, 100.0))
    layers = dict.fromkeys(("depth", "clean", "reason"), np.ones((20, 20), np.float32))
    for covers, share in (("corners", 1.0), ("centre", 0.25)):
        colour, whole = ColourCamera(seen, (0.0, 0.0, 0.0), covers=covers), Rect(0, 0, 20, 20)
        assert (register(layers, whole, image, colour, layers, whole)["depth"] > 0).mean() == share


def test_what_the_depth_camera_sees_agrees_with_the_colour_camera(
    context: Context, turned: str
) -> None:
    frame = drawn(context, turned, output__landmarks=True, scene__wall_mm=1200)
    assert (frame.intrinsics.width, frame.intrinsics.fx) == (640, 520)
    face = frame.regions > 0
    off_mm = (frame.noisy.astype(int) - frame.clean)[face & (frame.noisy > 0)]
    assert np.abs(np.median(off_mm)) <= 1
    assert np.percentile(np.abs(off_mm), 90) <= 4, "a pixel's footprint takes its nearest depth"
    hidden = (frame.clean > 0) & (frame.noisy == 0)
    assert 0.005 < hidden.sum() / (frame.clean > 0).sum() < 0.1, "the wall beside the head"
    assert (frame.reason[hidden] == Reason.SHADOW).all()
    assert frame.landmarks.visible.sum() > 30, "landmarks lie on the clean surface of this view"
    turn = frame.head_to_camera[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-5)


def test_a_crop_is_a_part_of_the_whole_frame(context: Context, turned: str) -> None:
    whole, crop = drawn(context, turned), drawn(context, turned, output__crop=128)
    top = round(whole.intrinsics.cy - crop.intrinsics.cy)
    left = round(whole.intrinsics.cx - crop.intrinsics.cx)
    for layer in ("clean", "noisy", "reason"):
        part = whole.image(layer)[top : top + 128, left : left + 128]
        np.testing.assert_array_equal(crop.image(layer), part)


def test_what_cannot_be_registered_is_refused(
    context: Context, turned: str, tmp_path: Path
) -> None:
    bare = tmp_path / "bare.toml"
    bare.write_text(TURNED.partition("[rig.colour]")[0])
    settings = with_assignments(Settings(), {"sensor": turned, "source": PERSON})
    with pytest.raises(ConfigError, match=r"no layer 'expected'"):
        next(iter(frames(settings, context=context, layers=("clean", "noisy", "expected"))))
    with pytest.raises(ConfigError, match=r"registers depth to colour"):
        DepthNoise(settings).rig((64, 64))
    with pytest.raises(ConfigError, match=r"needs the camera of a table \[rig.colour\]"):
        load_sensor(str(bare))
