"""Correlated noise of time-of-flight cameras comes back from the fitted sensor."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.bench import scenes
from glsim.bench.fit.recording_statistics import measure_recording
from glsim.bench.fit.smoothing import find_smoothing
from glsim.cli import main
from glsim.core.files.atomic import write_atomic
from glsim.measures.correlation import LAGS
from glsim.sensors.sensor import SENSOR_FOLDER
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.planted_frames import encoded, frames_of
from tests.support.recordings import write_frames


def _frames(context: Context, sensor: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    wall = scenes.depth_ramp(1500.0, 1400.0, 700.0)
    shot = VirtualCamera(sensor, context, seed=seed).capture(wall, 12, None, scene="ramp")
    return encoded(shot), shot.stack("infrared")


def _correlation(depths: np.ndarray) -> tuple[float, ...]:
    return measure_recording(frames_of("set", list(depths))).correlation


def test_the_narrow_filter_needs_no_other() -> None:
    even = [(max(3 - r, 0) * max(3 - c, 0)) / 9 for r, c in LAGS]
    assert find_smoothing(even) is None
    assert find_smoothing([0.5, 0.2, 0.0, 0.5, 0.2, 0.0, 0.3]) is None
    assert find_smoothing([float("nan")] * len(LAGS)) is None
    planted = find_smoothing([0.8, 0.67, 0.54, 0.74, 0.6, 0.47, 0.65])
    assert planted.width_px > 1.5
    np.testing.assert_allclose(planted.correlation[:3], (0.8, 0.65, 0.5), atol=0.06)


@pytest.mark.long
@pytest.mark.parametrize("width_px", [2.0, 4.0])
def test_frames_of_the_fitted_sensor_are_as_correlated(
    context: Context, tmp_path: Path, width_px: float
) -> None:
    text = (SENSOR_FOLDER / "kinect-v2.toml").read_text()
    text = text.replace('use = "tof_bilateral"', f'use = "tof_smooth"\nwidth_px = {width_px}')
    text = re.sub(r'(use = "tof_floor"\nsigma_mm = )[^\n]*', r"\g<1>0.3", text)
    camera = tmp_path / "camera.toml.d" / "mine.toml"
    write_atomic(text.encode(), camera)
    depths, lights = _frames(context, str(camera), 3)
    folder = write_frames(tmp_path / "recording", depths, lights)
    out = tmp_path / "fitted.toml"
    assert (
        main(["fit", str(folder), "-o", str(out), "-q", "--no-proof", "--base", "kinect-v2"]) == 0
    )
    stages = {s["use"]: s for s in tomllib.loads(out.read_text())["stage"]}
    assert "tof_bilateral" not in stages
    again, _ = _frames(context, str(out), 4)
    real, own = _correlation(depths), _correlation(again)
    assert real[2] > 0.15
    np.testing.assert_allclose(own[:6], real[:6], atol=0.08)
    noise = [np.nanmedian(np.std(d.astype(float), axis=0, ddof=1)) for d in (depths, again)]
    assert noise[1] == pytest.approx(noise[0], rel=0.2)
