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
#: The amplitude of a white wall at the centre is GAIN / z^2 (z in m).
GAIN = 1894.0
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
        sigma = np.sqrt(2 / 3 * (16.5 + 0.0166 * amplitude)) * CONTRAST_MULTIPLIER[k]
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
    ("amplitude", "expected", "within"),
    [
        (20, (0.085, 0.055, 0.112), 0.25),
        (50, (0.033, 0.024, 0.040), 0.25),
        (100, (0.019, 0.017, 0.021), 0.4),
    ],
)
def test_phase_noise_is_that_of_a_kinect(
    context: moderngl.Context, amplitude: float, expected: tuple[float, ...], within: float
) -> None:
    """Standard deviations of the phases as measured by Jaremo Lawin et al., ECCV 2016.

    After the decoder's filter. They measured more noise at an amplitude of 100 than real frames
    have, so that the fit is worse there.
    """
    scene = [quad(2000.0, albedo=amplitude / (GAIN / 4))]
    cam = camera(context)
    filtered = {"tof_edge": {"enabled": 0.0}}
    shots = np.stack([phasors(cam.shoot(scene, filtered, seed=s, crop=CROP)) for s in range(8)])
    phase = np.angle(shots * np.conj(shots.mean(axis=0)))
    sigma = phase.std(axis=(0, 1, 2)) * np.sqrt(8 / 7)
    np.testing.assert_allclose(sigma, expected, rtol=within)


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


def test_white_surfaces_nearer_than_065_m_are_lost(context: moderngl.Context) -> None:
    """Infrared is clipped at 65,535; real devices lose white surfaces there, and no darker ones."""
    cam = camera(context)
    for z_mm, albedo, kept in (
        (600, 1.0, False),
        (630, 1.0, False),
        (690, 1.0, True),
        (600, 0.6, True),
    ):
        layers = cam.shoot([quad(z_mm, albedo=albedo)], crop=CROP)
        valid = layers["depth"][8:-8, 8:-8] > 0
        assert valid.mean() > 0.99 if kept else valid.mean() < 0.01, z_mm
        if not kept:
            assert (layers["infrared"][8:-8, 8:-8] == 65535).all()


def test_depth_noise_follows_the_infrared(context: moderngl.Context) -> None:
    """Measured: the light's part is 4600 mm / infrared, after the decoder's filter; 10 %."""
    cam = camera(context)
    only = {
        name: {"enabled": 0.0} for name in ("tof_floor", "fixed_pattern", "millimetre_quantise")
    }
    for albedo in (0.1, 0.2, 0.8):
        shots = [
            cam.shoot([quad(2000.0, albedo=albedo)], only, seed=s, crop=CROP) for s in range(8)
        ]
        depth = 1000 * np.stack([shot["depth"] for shot in shots])[:, 12:-12, 12:-12]
        infrared = np.mean([shot["infrared"][12:-12, 12:-12] for shot in shots])
        depth[:, (depth <= 0).any(axis=0)] = np.nan
        sigma = np.sqrt(np.nanmean(depth.var(axis=0, ddof=1)))
        # Companding adds up to 10 % to the noise of bright pixels.
        assert sigma == pytest.approx(4600 / infrared, rel=0.12)


def test_light_spreads_as_measured(context: moderngl.Context) -> None:
    """A bright strip: the share of its light in the columns beside it, by halo and haze."""
    cam = camera(context)
    half = 1.5 * 900 / 365.456  # three columns, less what the rims miss
    scene = [quad(900.0, (-half, half)), quad(930.0, albedo=0.0)]
    spread = {"tof_taps": {"halo": 0.1, "haze": 0.0, "psf_sigma_px": 0.22}}
    sharp = {"tof_taps": {"halo": 0.0, "haze": 0.0, "psf_sigma_px": 0.0}}
    row, core = (
        np.abs(phasors(cam.shoot(scene, merged(RAW, QUIET, change))))[200, :, 1].astype(float)
        for change in (spread, sharp)
    )
    assert row.sum() == pytest.approx(core.sum(), rel=1e-3)
    centre = (np.arange(len(core)) * core).sum() / core.sum()
    variance = [((np.arange(len(v)) - centre) ** 2 * v).sum() / v.sum() for v in (row, core)]
    # A core of 0.22 px, and a halo whose variance along an axis is 0.30 + 0.71 px^2.
    assert variance[0] - variance[1] == pytest.approx(0.9 * 0.22**2 + 0.1 * 1.09, rel=0.1)


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
    expected = np.sqrt(1 + 0.0166 * 2000 / (16.5 + 0.0166 * amplitude))
    assert ratio == pytest.approx(expected, rel=0.05)
    assert abs(bright.mean() - dark.mean()) < 0.01 * amplitude
