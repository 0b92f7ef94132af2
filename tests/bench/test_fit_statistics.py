"""What glsim fit fits and compares: values that were planted come back within their errors."""

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.bench.fit import figures
from glsim.bench.fit.stereo_sensor import Trials
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.rect import Rect
from glsim.measures.static import mask_moving
from glsim.noise.stereo_matching import _device_error
from glsim.sensors.sensor import load_sensor
from tests.support.planted_frames import frames_of
from tests.support.real_cameras import box_noise

Array = NDArray[np.float64]
SHAPE = (400, 640)
BASE = {"device_sigma_px": 0.06, "device_grain_px": 7.0, "device_fine": 0.008}


def planes(seed: int, values: dict[str, float]) -> figures.Figures:
    """Figures of three frames of a plane: a device's own error, and white noise in time."""
    rng, whole = np.random.default_rng(seed), Rect(0, 0, SHAPE[1], SHAPE[0])
    grain, fine = values["device_grain_px"], values["device_fine"]
    own = values["device_sigma_px"] * _device_error(seed, whole, False, grain, fine, 0.3, 0.0, 0.3)
    own = own + 20.0 + 0.01 * np.arange(SHAPE[1])
    frames = [19_590.0 / (own + rng.normal(0, 0.05, SHAPE)) for _ in range(3)]
    return figures.disparity_figures(frames_of("planes", frames), 19_590.0)


class PlantedTrials(Trials):
    """Trials of other devices whose noise is drawn by a formula, and that render nothing."""

    def __init__(self, real: figures.Figures) -> None:
        self.sensor, self.values = load_sensor("realsense-d435-vga"), {}
        self.moved, self.results, self.real, self.drawn = set(), {}, real, 77
        self.base = self.now = self.trial()

    def trial(self, name: str = "", value: float = 0.0) -> figures.Figures:
        self.drawn += 1
        own = {key.partition(".")[2]: v for key, v in self.values.items()}
        one = {name.partition(".")[2]: value} if name else {}
        both = [planes(self.drawn + 100 * k, BASE | own | one) for k in (0, 1)]
        return figures.mean_figures(both)


def fitted(planted: dict[str, float], seed: int) -> PlantedTrials:
    trials = PlantedTrials(planes(seed, BASE | planted))
    trials.solve("match_stereo.device_grain_px", figures.WAVES, -2.0)
    trials.solve("match_stereo.device_fine", figures.FINE, 1.0)
    trials.solve("match_stereo.device_sigma_px", figures.STATIC, 2.0, 2.0)
    return trials


COARSE = {"device_grain_px": 4.0, "device_sigma_px": 0.09, "device_fine": 0.05}
FINE = pytest.param({"device_fine": 0.2, "device_sigma_px": 0.1}, marks=pytest.mark.long)


@pytest.mark.parametrize("planted", [FINE, COARSE])
def test_a_devices_own_error_comes_back(planted: dict[str, float]) -> None:
    fit = fitted(planted, 31)
    for name, expected in (BASE | planted).items():
        text = fit.results[f"match_stereo.{name}"]
        if (said := re.match(r"(\S+) \+- (\S+) \(base", text)) is not None:
            value, error = map(float, said.groups())
            assert abs(value - expected) < 2 * np.hypot(error, 0.04 * expected), (name, text)
        else:
            assert name not in planted, text
            assert f"match_stereo.{name}" not in fit.values


def test_what_agrees_with_the_base_stays_the_bases() -> None:
    fit = fitted({}, 33)
    assert not fit.values
    assert all("the base's" in text for text in fit.results.values())


def wall(seed: int, time_mm: float = 2.0, gap_px: int = 6, holes: float = 1e-3) -> Frames:
    """Five bars before a wall: boxes of 3 px of noise, gaps on their right, single holes."""
    rng = np.random.default_rng(seed)
    clean = np.full(SHAPE, 1500.0)
    for left in range(20, 640, 128):
        clean[:, left : left + 60] = 1000.0
    frames = []
    for change in box_noise(rng, 3, SHAPE, 3, time_mm):
        depth = clean + change
        for left in range(20, 640, 128):
            depth[:, left + 60 : left + 60 + gap_px] = 0.0
        depth[rng.random(SHAPE) < holes] = 0.0
        frames.append(depth)
    return frames_of("wall", frames, camera=Intrinsics(640, 400, 390.4, 390.4, 320.0, 200.0))


def test_planted_noise_gaps_and_holes_come_with_their_errors() -> None:
    first, second, other = (
        figures.values_with_errors(w) for w in (wall(1), wall(2), wall(3, 3.0, 9, 3e-3))
    )
    for name, expected in ((figures.HOLES, (0.1, 0.3)), (figures.GAPS[1], (6.0, 9.0))):
        assert (first[name][0], other[name][0]) == pytest.approx(expected, rel=0.15)
        assert other[name][0] - first[name][0] > 2 * np.hypot(first[name][1], other[name][1])
    pulls = [
        (value - second[name][0]) / np.hypot(error, second[name][1])
        for name, (value, error) in first.items()
        if np.isfinite([value, error, *second.get(name, (np.nan, np.nan))]).all() and error > 0
    ]
    assert len(pulls) > 10
    assert np.mean(np.abs(pulls) > 3.0) < 0.2  # two draws of one camera, errors of five parts


def test_gaps_beside_rims_that_flicker_keep_their_width() -> None:
    first, second, third = wall(1)
    moved = second.changed({"noisy_mm": np.roll(second.noisy_mm, 4, axis=1)})
    still, _ = mask_moving([first, moved, third])
    assert (still[1].noisy_mm == 0).mean() > (moved.noisy_mm == 0).mean() + 0.1
    found = figures.values_with_errors(Frames.of(still))
    assert found[figures.GAPS[1]][0] == pytest.approx(6.0, abs=0.2)
