"""The decoder: fusion, filters, unwrapping, thresholds, geometry; without each filter."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.numpy_twins.tof_light import unwrapped_cycles
from tests.support.tof_harness import QUIET, Camera, Image, merged, quad

CROP = Rect(215, 165, 80, 80)
#: Only the noise of the light; exact depth.
LIGHT = {name: {"enabled": 0.0} for name in ("tof_floor", "fixed_pattern", "millimetre_quantise")}
UNFILTERED = {"tof_bilateral": {"enabled": 0.0}, "tof_edge": {"enabled": 0.0}}


def depths(
    cam: Camera, z_mm: float, changes: dict[str, dict[str, float]], frames: int, albedo: float = 1.0
) -> Image:
    """(frames, h, w) mm of a wall, without the rim of the window."""
    shots = [
        cam.shoot([quad(z_mm, albedo=albedo)], changes, seed=seed, crop=CROP)["depth"]
        for seed in range(frames)
    ]
    return 1000 * np.stack(shots)[:, 12:-12, 12:-12]


def test_fusion_and_filter_gain(context: moderngl.Context) -> None:
    """Three phases with weights of one: 110.5 mm a radian; the filter divides by almost three."""
    cam = Camera.open(context)
    for z_mm in (1500.0, 3000.0):
        raw = depths(cam, z_mm, merged(LIGHT, UNFILTERED), 10)
        filtered = depths(cam, z_mm, LIGHT, 10)
        amplitude = 1894 / (z_mm / 1000) ** 2
        m = np.array([1.322581, 1.0, 1.612903])
        sigma_phase = m * np.sqrt(2 / 3 * (16.5 + 0.0166 * amplitude / m)) / amplitude
        expected = 110.5 * np.linalg.norm(sigma_phase)
        sigma = np.sqrt(raw.var(axis=0, ddof=1).mean())
        assert 0.95 < sigma / expected < 1.05
        assert 2.8 < sigma / np.sqrt(filtered.var(axis=0, ddof=1).mean()) < 3.05


def test_any_distance_is_unwrapped() -> None:
    """Up to the distance after which all phases repeat, 18.75 m, with errors of 0.1 of a phase."""
    f = np.array([80.0, 16.0, 120.0], np.float32)
    distance = np.linspace(0.3, 18.4, 40_000)
    cycles = distance[:, None] * f / 150.0
    error = np.random.default_rng(0).normal(0, 0.02, cycles.shape)
    phase = np.mod(cycles + error, 1.0).astype(np.float32)
    fast, slow, third = unwrapped_cycles(phase, f)
    found = (fast + slow + third) * 150.0 / f.sum()
    assert (np.abs(found - distance) < 0.2).mean() > 0.999


@pytest.mark.parametrize("z_mm", [600.0, 1500.0, 4200.0])
def test_geometry_of_the_emitter_is_undone(context: moderngl.Context, z_mm: float) -> None:
    """A wall stays flat to the corners: the path over the emitter is 45 mm off centre."""
    cam = Camera.open(context)
    bright = {
        "tof_light": {"tail": 1.0, "gain": 1000.0},
        "tof_taps": {"psf_sigma_px": 0.0, "halo": 0.0, "haze": 0.0},  # they mix directions
    }
    layers = cam.shoot([quad(z_mm)], merged(QUIET, bright))
    error = 1000 * layers["depth"][2:-2, 2:-2] - z_mm  # filters end at the border
    assert np.abs(error).max() < 0.02 + 2e-5 * z_mm


@pytest.mark.parametrize(("amplitude", "low", "high"), [(2.0, 0.0, 0.2), (40.0, 0.99, 1.0)])
def test_validity_depends_on_the_amplitude(
    context: moderngl.Context, amplitude: float, low: float, high: float
) -> None:
    cam = Camera.open(context)
    albedo = amplitude / 1894
    found = [cam.shoot([quad(1000.0, albedo=albedo)], seed=s, crop=CROP) for s in range(4)]
    valid = np.mean([shot["depth"][12:-12, 12:-12] > 0 for shot in found])
    assert low <= valid <= high
    codes = np.unique([shot["reason"][12:-12, 12:-12] for shot in found])
    assert set(codes) <= {Reason.VALID, Reason.LOW_SIGNAL, Reason.UNWRAP, Reason.OUT_OF_RANGE,
                          Reason.MIXED, Reason.EDGE}  # fmt: skip


def test_every_stage_may_be_left_out(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    scene = [quad(900.0, (-100, 100), (-120, 120), albedo=0.6), quad(1500.0)]
    whole = cam.shoot(scene)
    for stage in ("tof_bilateral", "tof_edge", "tof_floor", "fixed_pattern", "range_gate",
                  "millimetre_quantise"):  # fmt: skip
        without = cam.shoot(scene, {stage: {"enabled": 0.0}})
        if stage != "range_gate":  # everything is within the range
            assert (without["depth"] != whole["depth"]).any(), stage
        valid = (without["depth"] > 0) & (whole["depth"] > 0)
        assert valid.mean() > 0.9
        assert np.median(np.abs(without["depth"] - whole["depth"])[valid]) < 0.004, stage
