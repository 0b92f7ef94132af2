"""Time-of-flight sensors: twins agree, frames repeat, crops are exact, shortcuts are accurate."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.core.rect import Rect
from tests.support.tof_harness import QUIET, Camera, face_scenes, quad

SENSORS = ["kinect-v2", "kinect-v2-fast", "azure-kinect", "azure-kinect-wfov"]


@pytest.mark.parametrize(
    ("sensor", "faces"),
    [*((name, 6) for name in SENSORS), pytest.param("kinect-v2", 100, marks=pytest.mark.long)],
)
def test_twin_and_shader_agree(context: moderngl.Context, sensor: str, faces: int) -> None:
    cam = Camera.open(context, sensor, expected=True)
    same, pixels, close, both = 0, 0, 0, 0
    # A frame with a wall takes ten times as long as one without.
    for seed, scene in enumerate(face_scenes(faces, wall_every=14)):
        drawn, computed = cam.shoot(scene, seed=seed), cam.twin(scene, seed=seed)
        one, other = drawn["depth"] > 0, computed["depth"] > 0
        same, pixels = same + (one == other).sum(), pixels + one.size
        apart = np.abs(drawn["depth"] - computed["depth"])[one & other]
        close, both = close + (apart <= 0.00101).sum(), both + len(apart)
        assert (drawn["reason"] == computed["reason"]).mean() >= 0.999
        assert np.abs(drawn["lit"] - computed["lit"]).mean() < 1e-4
        assert np.abs(drawn["expected"] - computed["expected"]).max() < 2e-5
        typical = np.abs(drawn["infrared"] - computed["infrared"])
        assert (typical > 0.01 * drawn["infrared"] + 1).mean() < 1e-3
    assert both > 20_000
    assert same >= 0.999 * pixels
    assert close >= 0.999 * both


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_frame_repeats_and_another_differs(context: moderngl.Context, sensor: str) -> None:
    cam, scene = Camera.open(context, sensor), face_scenes(1)[0]
    first = cam.shoot(scene, seed=1)
    cam.shoot([quad(1000.0)], seed=9)
    again, other = cam.shoot(scene, seed=1), cam.shoot(scene, seed=2)
    for name, image in first.items():
        assert image.tobytes() == again[name].tobytes(), name
    valid = (first["depth"] > 0) & (other["depth"] > 0)
    assert (first["depth"] != other["depth"])[valid].mean() > 0.5


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_crop_is_a_part_of_the_frame(context: moderngl.Context, sensor: str) -> None:
    """Byte for byte: the margin of a crop is wider than the chain's reach."""
    cam = Camera.open(context, sensor)
    scene = [*face_scenes(1)[0], quad(2000.0)]
    image = cam.sensor.rig.intrinsics
    crop = Rect(image.width // 2 - 70, image.height // 2 - 60, 140, 120)
    whole, part = cam.shoot(scene), cam.shoot(scene, crop=crop)
    with cam.renderer.render(scene, crop) as rendered:
        window = rendered.window
    inner = Rect(crop.left - window.left, crop.top - window.top, crop.width, crop.height)
    for name in ("depth", "reason", "infrared"):
        np.testing.assert_array_equal(whole[name][crop.slices], part[name][inner.slices], name)


def test_a_lens_that_distorts_keeps_planes_plane(context: moderngl.Context) -> None:
    cam = Camera.open(context, deliver="raw")
    layers = cam.shoot([quad(1200.0)], QUIET)
    depth = layers["depth"][40:-40, 40:-40]
    assert (depth > 0).all()
    assert 1000 * np.abs(depth - 1.2).max() < 0.5
