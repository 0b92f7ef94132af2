"""Measurements of the time-of-flight pixels: taps, phases, amplitudes, infrared."""

from __future__ import annotations

from functools import lru_cache

import moderngl
import numpy as np
import pytest

from glsim.geometry.rect import Rect
from glsim.noise.numpy_twins.tof_taps import CONTRAST_MULTIPLIER, companded
from glsim.reason import Reason
from tests.support.stage_harness import Z_MAX, z_mean, z_sd
from tests.support.tof_harness import QUIET, Camera, Image, centre, merged, quad

#: A crop around the principal point; the window is a little larger.
CROP = Rect(216, 172, 80, 64)
#: Distance of a wall whose amplitude at the centre is 391 / z^2.
GAIN = 391.0
RAW = {"tof_bilateral": {"enabled": 0.0}, "tof_edge": {"enabled": 0.0}}


@lru_cache(maxsize=1)
def camera(context: moderngl.Context) -> Camera:
    return Camera.open(context)


def phasors(layers: dict[str, Image]) -> np.ndarray:
    """(h, w, 3) complex phasors of the window without its rim."""
    a, b = layers["phasor_a"][8:-8, 8:-8], layers["phasor_b"][8:-8, 8:-8]
    return np.stack(
        [a[..., 0] + 1j * a[..., 1], a[..., 2] + 1j * a[..., 3], b[..., 0] + 1j * b[..., 1]], -1
    )


@pytest.mark.parametrize("z_mm", [900.0, 2500.0])
def test_noise_of_the_taps_has_its_variance(context: moderngl.Context, z_mm: float) -> None:
    cam = camera(context)
    changes = merged(RAW, {"tof_taps": {"companding": 0.0}})
    pure = phasors(cam.shoot([quad(z_mm)], merged(changes, QUIET), crop=CROP))
    wiggle = {"tof_light": {"harmonic_2": 0.0, "harmonic_5": 0.0}}
    for k in range(3):
        amplitude = np.abs(pure[..., k]).mean() / CONTRAST_MULTIPLIER[k]
        sigma = np.sqrt(2 / 3 * (1.755 + 0.0166 * amplitude)) * CONTRAST_MULTIPLIER[k]
        noise = [
            (phasors(cam.shoot([quad(z_mm)], merged(changes, wiggle), seed=s, crop=CROP)) - pure)
            for s in range(6)
        ]
        for part in (np.real(noise)[..., k], np.imag(noise)[..., k]):
            assert abs(z_mean(part)) < Z_MAX
            # The amplitude, and with it sigma, changes by 3 % over the window.
            assert abs(z_sd(part, sigma)) < Z_MAX + 0.01 * np.sqrt(2 * part.size)
        both = np.array([np.real(noise)[..., k].ravel(), np.imag(noise)[..., k].ravel()])
        assert abs(np.corrcoef(both)[0, 1]) < 0.02


@pytest.mark.parametrize(
    ("amplitude", "expected"),
    [(20, (0.085, 0.055, 0.112)), (50, (0.033, 0.024, 0.040)), (100, (0.019, 0.017, 0.021))],
)
def test_phase_noise_is_that_of_a_kinect(
    context: moderngl.Context, amplitude: float, expected: tuple[float, ...]
) -> None:
    """Standard deviations of the phases as measured by Jaremo Lawin et al., ECCV 2016; 20 %."""
    z_mm = 1000 * np.sqrt(GAIN / amplitude)
    cam = camera(context)
    shots = np.stack([phasors(cam.shoot([quad(z_mm)], RAW, seed=s, crop=CROP)) for s in range(8)])
    phase = np.angle(shots * np.conj(shots.mean(axis=0)))
    sigma = phase.std(axis=(0, 1, 2)) * np.sqrt(8 / 7)
    np.testing.assert_allclose(sigma, expected, rtol=0.2)


def test_infrared_is_the_amplitude(context: moderngl.Context) -> None:
    cam = camera(context)

    def counts(z_mm: float, albedo: float = 1.0) -> float:
        layers = cam.shoot([quad(z_mm, albedo=albedo)], QUIET, crop=CROP)
        return float(centre(layers["infrared"], 8, (layers["infrared"].shape[0] // 2, 47)).mean())

    assert counts(900) == pytest.approx(16 * GAIN / 0.9**2, rel=0.01)
    assert counts(900) / counts(1800) == pytest.approx(4.0, abs=0.05)
    for albedo in (0.1, 0.3, 0.6):
        assert counts(900, albedo) / counts(900) == pytest.approx(albedo, rel=1e-3)


def test_companding_is_the_code_of_the_kinect() -> None:
    steps = np.repeat([1, 1, 2, 4, 8, 16, 32, 64], 128)
    table = np.concatenate([[0], np.cumsum(steps)])[:1024].astype(np.float32)
    assert table[-1] == 16320
    np.testing.assert_array_equal(companded(table), table)
    np.testing.assert_array_equal(companded(-table), -table)
    taps = np.random.default_rng(0).uniform(-17000, 17000, 20000).astype(np.float32)
    nearest = table[np.abs(np.abs(taps)[:, None] - table).argmin(axis=1)]
    error = np.abs(np.abs(companded(taps)) - np.minimum(np.abs(taps), 16320))
    assert (error <= np.abs(nearest - np.minimum(np.abs(taps), 16320)) + 1e-3).all()


def test_much_light_saturates(context: moderngl.Context) -> None:
    cam = camera(context)
    layers = cam.shoot([quad(900)], {"tof_taps": {"saturation_lsb": 300.0}}, crop=CROP)
    inner = layers["reason"][8:-8, 8:-8]
    assert (inner == Reason.SATURATED).all()
    assert (layers["infrared"][8:-8, 8:-8] == 65535).all()
    assert not layers["depth"][8:-8, 8:-8].any()


def test_ambient_light_only_adds_noise(context: moderngl.Context) -> None:
    cam = camera(context)
    dark, bright = (
        np.stack([
            phasors(cam.shoot([quad(1500)], merged(RAW, {"tof_taps": {"ambient_lsb": lsb}}),
                              seed=s, crop=CROP)) for s in range(6)
        ])
        for lsb in (0.0, 2000.0)
    )  # fmt: skip
    ratio = bright[..., 1].std(axis=0).mean() / dark[..., 1].std(axis=0).mean()  # at 16 MHz
    amplitude = GAIN / 1.5**2
    expected = np.sqrt(1 + 0.0166 * 2000 / (1.755 + 0.0166 * amplitude))
    assert ratio == pytest.approx(expected, rel=0.05)
    assert abs(bright.mean() - dark.mean()) < 0.01 * amplitude
