"""A device is recorded, fitted, and simulated with its own fixed pattern."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from moderngl import Context

import glsim
from glsim.bench import scenes
from glsim.cli import main
from glsim.core.array_types import Array
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.planted_frames import encoded
from tests.support.recordings import write_frames
from tests.support.stage_harness import Z_MAX, z_correlation

RECORDED, SIMULATED = 24, 6
#: The part of the image that is compared: well lit, and away from the border.
PART = np.s_[60:364, 80:432]


def mean_error(camera: VirtualCamera, frames: int, **options: Any) -> Array:
    """Mean error of a wall at 1.1 m, without what is smooth: wiggling and the device's offset."""
    shot = camera.capture(scenes.wall(1100), frames, None, scene="again", **options)
    return flattened((shot.measured_mm - shot.truth_mm).mean(axis=0))


def flattened(image: Array) -> Array:
    part = image[PART]
    return np.asarray(part - cv2.blur(part, (31, 31)))


def pixels(error: Array) -> Array:
    """The part of single pixels, every third along both axes: nearer ones share their noise."""
    own = error - error.mean(axis=1, keepdims=True)
    return np.asarray((own - own.mean(axis=0))[::3, ::3])


@pytest.mark.long
def test_a_fitted_sensor_has_the_devices_own_pattern(context: Context, tmp_path: Path) -> None:
    device = VirtualCamera("kinect-v2-fast", context, seed=3)
    recorded = device.capture(scenes.wall(900), RECORDED, None, scene="recording")
    write_frames(tmp_path / "frames", encoded(recorded))
    fitted = tmp_path / "mine.toml"
    assert main(["fit", str(tmp_path / "frames"), "-o", str(fitted), "--quiet", "--no-proof"]) == 0

    # The device's own pattern, without temporal noise, at another distance than the recording's.
    off = {"tof_fast": {"sigma_mm": 0.0, "read_variance": 0.0, "shot_variance": 0.0}}
    truth = mean_error(device, 1, changes=off)
    simulated = mean_error(VirtualCamera(str(fitted), context, seed=99), SIMULATED)
    stranger = mean_error(VirtualCamera("kinect-v2-fast", context, seed=99), SIMULATED)
    # Rows alternate in every device, so that single pixels decide.
    assert z_correlation(pixels(simulated), pixels(truth)) > 3 * Z_MAX
    assert abs(z_correlation(pixels(stranger), pixels(truth))) < Z_MAX
    # The whole pattern of 0.87 mm, beside temporal noise of 0.5 mm in the mean of 6 frames and of
    # 0.25 mm in the map: at most 0.83. A twentieth of the pixels is unknown and drawn.
    assert np.corrcoef(simulated.ravel(), truth.ravel())[0, 1] > 0.6

    # What was fitted can be taken from the device's frames.
    own = glsim.load_sensor(str(fitted)).pattern_map
    once = device.capture(scenes.wall(1100), 1, None, changes=off).measured_mm[0]
    left = glsim.remove_fixed_pattern(once, own.values).astype(np.float64)
    assert flattened(left).var() < 0.3 * flattened(once).var()


@pytest.mark.long
def test_a_short_recording_gives_no_pattern_and_the_sensor_that_made_it_is_recommended(
    context: Context, tmp_path: Path
) -> None:
    device = VirtualCamera("kinect-v2-fast", context, seed=3)
    write_frames(tmp_path / "frames", encoded(device.capture(scenes.wall(900), 8, None)))
    fitted = tmp_path / "mine.toml"
    assert main(["fit", str(tmp_path / "frames"), "-o", str(fitted), "--quiet"]) == 1
    assert "# AUC of planes" in fitted.read_text()
    assert "kinect-v2-fast is recommended" in fitted.read_text()
    assert "too noisy to add to frames" in fitted.read_text()
    assert glsim.load_sensor(str(fitted)).pattern_map is None
