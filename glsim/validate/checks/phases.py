"""Checks 9 to 11: phase noise before and after the decoder's filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glsim.measures import stacks as measure
from glsim.measures.stacks import Array
from glsim.validate import published_curves, scenes
from glsim.validate.captures import INTERNAL, Captures
from glsim.validate.checks.depth import COUNTS_PER_AMPLITUDE
from glsim.validate.report import Band, Check, Measurement, validation_check
from glsim.validate.sources import KDE, LF2, OWN, REAL
from glsim.validate.virtual_camera import Capture, Changes

#: Distance of the walls; it gives amplitudes of up to 120, and of 10 with a dark albedo.
_WALL_MM = 1500.0


#: Phase noise after the filter at amplitudes of 20, 50 and 100, rad, per frequency in MHz (Jaremo
#: Lawin 2016).
_KDE_RAD = {80: (0.085, 0.033, 0.019), 16: (0.055, 0.024, 0.017), 120: (0.112, 0.040, 0.021)}
#: Depth noise of real frames at these amplitudes, 4600 mm / infrared, over that of the fit above.
_REAL_SHARE = {20: 0.86, 50: 0.91, 100: 0.79}


@dataclass(frozen=True, eq=False)
class PhaseNoise:
    """Noise of phases and depth at N amplitudes.

    Args:
        amplitude: (N,) measured, infrared units.
        sigma_rad: (3, N) phase noise at 80, 16 and 120 MHz after the bilateral filter.
        raw_sigma_rad: filters off.
        raw_mm, filtered_mm: (N,) temporal sigma of the depth without and with the filters, both
            without floor and rounding.
    """

    amplitude: Array
    sigma_rad: Array
    raw_sigma_rad: Array
    raw_mm: Array
    filtered_mm: Array


def measure_phase_noise(captures: Captures, amplitudes: Array) -> PhaseNoise | None:
    """Measure walls whose albedos give (N,) amplitudes; None for a chain without phases."""
    white, off = captures.ablations.white, captures.ablations.no_filters
    if white is None or off is None or not captures.ablations.phases:
        return None
    bright = captures.wall(_WALL_MM).infrared.mean() / COUNTS_PER_AMPLITUDE
    walls = [
        _measure_wall(captures, float(a / bright), {**white, **off}, white) for a in amplitudes
    ]
    return PhaseNoise(
        np.array([wall[0] for wall in walls]),
        np.stack([wall[2] for wall in walls], axis=1),
        np.stack([wall[1] for wall in walls], axis=1),
        np.array([wall[3] for wall in walls]),
        np.array([wall[4] for wall in walls]),
    )


def _measure_wall(
    captures: Captures, albedo: float, raw: Changes, filtered: Changes
) -> tuple[float, Array, Array, float, float]:
    """Measure one wall: amplitude, (3,) raw and filtered phase sigma, rad, and depth sigma, mm."""

    def capture_wall(changes: Changes) -> Capture:
        return captures.camera.capture(
            scenes.wall(_WALL_MM, albedo), at_mm=(0, 0, _WALL_MM), changes=changes,
            scene=f"phases {albedo:.4f}", extra=captures.ablations.phases,
        ).centre()  # fmt: skip

    with_noise, smooth = capture_wall(raw), capture_wall(filtered)
    phasors = _phasors(with_noise, captures.ablations.phases)
    return (
        float(np.abs(phasors.mean(axis=1)).mean()),
        _phase_sigma(phasors),
        _phase_sigma(_phasors(smooth, captures.ablations.phases)),
        measure.sigma_temporal(with_noise.fine_mm),
        measure.sigma_temporal(smooth.fine_mm),
    )


def _phase_sigma(phasors: Array) -> Array:
    """Compute the (3,) standard deviation of the phase over time, rad."""
    mean = phasors.mean(axis=1, keepdims=True)
    count = phasors.shape[1]
    # Angles are relative to each pixel's mean phasor, so that none wraps.
    angle = np.angle(phasors * np.conj(mean))
    return np.asarray(np.sqrt((angle**2).mean(axis=(1, 2, 3)) * count / (count - 1)))


def _phasors(capture: Capture, layers: tuple[str, ...]) -> Array:
    """Return (3, T, H, W) complex phasors at 80, 16 and 120 MHz."""
    a, b = (capture.extra[name].astype(np.float64) for name in layers)
    parts = np.stack([a[..., 0], a[..., 2], b[..., 0]]), np.stack([a[..., 1], a[..., 3], b[..., 1]])
    return np.asarray(parts[0] + 1j * parts[1])


@validation_check(
    "kinect-v2",
    Check("9", "phase noise after the filter at amplitudes 20, 50, 100 (80, 16, 120 MHz)",
          tuple(Band(f"{mhz} MHz @{a}", round(0.8 * _REAL_SHARE[a] * s, 4), round(1.2 * s, 4),
                     "rad")
                for mhz, row in _KDE_RAD.items() for a, s in zip((20, 50, 100), row, strict=True)),
          f"{KDE} +20 %; {REAL}: noise over infrared -20 %", "measured"),
    # The formula is that of small errors: below an amplitude of 30 raw phases have more than 0.2
    # rad (three times the filtered ones of check 9), and some wrap.
    Check("10", "fusion: depth noise / (110.5 mm sqrt(sum of phase variances)), a >= 30",
          (Band("least", 0.97, 1.03), Band("most", 0.97, 1.03)), f"{LF2}; {OWN}", "derived"),
    Check("11", "filter: sigma before / after, a >= 30",
          (Band("least", 2.8, 3.05), Band("most", 2.8, 3.05)), f"{LF2}; {OWN}", "derived"),
)  # fmt: skip
def phase_noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 9 to 11: phase noise, its fusion into depth noise, gain of the filter."""
    noise = measure_phase_noise(captures, np.array([10.0, 20.0, 30.0, 50.0, 100.0]))
    if noise is None:
        return {n: Measurement(why_not=INTERNAL) for n in ("9", "10", "11")}
    index_of_amplitude = {20: 1, 50: 3, 100: 4}
    sigma = {
        f"{mhz} MHz @{a}": float(noise.sigma_rad[k, i])
        for k, mhz in enumerate(published_curves.FREQUENCIES_MHZ)
        for a, i in index_of_amplitude.items()
    }
    low = noise.sigma_rad[:, 0] / published_curves.kde_phase_sigma_rad(noise.amplitude[0])
    phase_sigma_rad = np.sqrt((noise.raw_sigma_rad**2).sum(axis=0))
    fusion = (noise.raw_mm / (published_curves.FUSION_MM_PER_RAD * phase_sigma_rad))[2:]
    gain = (noise.raw_mm / noise.filtered_mm)[2:]
    return {
        "9": Measurement(
            sigma,
            f"not checked below 20: at {noise.amplitude[0]:.0f} the phases have "
            f"{', '.join(f'{share:.2f}' for share in low)} of the published fit",
        ),
        "10": Measurement({"least": float(fusion.min()), "most": float(fusion.max())}),
        "11": Measurement({"least": float(gain.min()), "most": float(gain.max())}),
    }
