"""The mode of a recording follows from its depths, its size and its focal length."""

import numpy as np
import pytest
from moderngl import Context

from glsim.bench.compare.replay import compare_replay
from glsim.bench.modes import find_lattice, possible_modes
from glsim.bench.scenes import room_corner
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError
from glsim.sensors.sensor import load_sensor
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.planted_frames import frames_of

D435, D455 = 50.17, 95.0


def ramp(size: tuple[int, int], product: float, focal: float, steps: int = 32) -> Frames:
    """A slanted wall whose depths are round(f B steps / n) mm; steps 0: whole mm of any depth."""
    rows, columns = np.mgrid[: size[1], : size[0]]
    depth = 500.0 + 2500.0 * columns / size[0] + 0.3 * rows
    if steps:
        depth = product * steps / np.rint(product * steps / depth)
    camera = Intrinsics(*size, focal, focal, size[0] / 2, size[1] / 2)
    return frames_of("wall", [np.rint(depth)], None, camera)


@pytest.mark.parametrize(
    ("size", "product", "focal", "sensor", "names"),
    [
        ((640, 480), 390.4 * D435, 390.4, "realsense-d435", ["its mode 640x480"]),
        ((640, 480), 390.4 * D435, 613.0, "realsense-d435", ["registered"]),
        ((640, 480), 423.8 * D435, 0.0, "realsense-d435", ["registered"]),
        ((640, 480), 390.4 * D435, 0.0, "realsense-d435-vga", ["its mode", "registered"]),
        ((1280, 720), 430.0 * D435, 920.0, "realsense-d4xx-fast", ["registered"]),
        ((424, 240), 433.1 * D455, 216.6, "realsense-d455", ["848x480, f 433 px, decimated by 2"]),
        (
            (428, 240),
            943.6 * 56.2,
            314.5,
            "realsense-d415",
            ["1280x720, f 944 px, decimated by 3", "regis"],
        ),
        ((640, 480), 569.5 * 75.0, 525.0, "kinect-v1-pattern", ["registered"]),
    ],
)
def test_modes(
    size: tuple[int, int], product: float, focal: float, sensor: str, names: list[str]
) -> None:
    frames = ramp(size, product, focal or 365.0, 8 if "v1" in sensor else 32)
    found = possible_modes(load_sensor(sensor), frames, focal > 0, find_lattice(frames))
    assert [mode.name[: len(name)] for mode, name in zip(found, names, strict=True)] == names
    own = load_sensor(sensor).rig.baseline_m * 1000 * found[0].depth.fx
    assert own == pytest.approx(product, rel=0.03)


@pytest.mark.parametrize(
    ("frames", "sensor", "message"),
    [
        (ramp((848, 480), 433.1 * D455, 433.1), "realsense-d435", "another camera"),
        (ramp((640, 360), 326.9 * D455, 326.9), "realsense-d435", "another camera"),
        (ramp((640, 480), 390.4 * D435, 390.4), "kinect-v2", "measures the time of flight"),
        (ramp((640, 480), 390.4 * D435, 390.4), "realsense-d415", "of this size has 629 px"),
        (
            ramp((512, 424), 1.0, 365.0, 0),
            "realsense-d435",
            "no mode of realsense-d435 has 512x424",
        ),
    ],
)
def test_a_sensor_that_cannot_have_made_the_frames_is_refused(
    frames: Frames, sensor: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        possible_modes(load_sensor(sensor), frames, True, find_lattice(frames))
    crop = Frames.of([f.changed(intrinsics=f.intrinsics) for f in frames]).centre(100)
    assert possible_modes(load_sensor("any-depth-camera"), crop, True, find_lattice(crop))


@pytest.mark.long
def test_frames_registered_to_colour_are_replayed_so(context: Context) -> None:
    """Without a stated focal length both modes are tried; the camera's own grid is far off."""
    camera = VirtualCamera("realsense-d435-vga", context, seed=3, rig={"deliver": "colour"})
    shot = camera.capture(room_corner(), 1, None, scene="corner")
    real = frames_of("aligned", [np.rint(f.noisy_mm) for f in shot])
    comparison, _, sentence = compare_replay(real, "realsense-d435-vga", False, print, seed=4)
    assert "taken for frames in registered to colour, f 613 px" in sentence
    assert comparison.told < 0.75
