"""Checks of the phases before and after the decoder's filter (9 to 11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glsim.validate import curves, measure, scenes
from glsim.validate.bench import Changes, Shots
from glsim.validate.depth import COUNTS_PER_AMPLITUDE
from glsim.validate.lab import INTERNAL, Lab
from glsim.validate.measure import Array
from glsim.validate.report import Measured

#: Where the walls of these checks stand: bright enough for 120, dark enough for 10.
_WALL_MM = 1500.0


@dataclass(frozen=True, eq=False)
class PhaseNoise:
    """What phases and depths do at some amplitudes, filters off.

    amplitude: (N,) infrared units, as measured. sigma_rad: (3, N) at 80, 16 and 120 MHz.
    raw_mm, filtered_mm: (N,) temporal sigma of the depth without and with the filters, both
    without floor and rounding.
    """

    amplitude: Array
    sigma_rad: Array
    raw_mm: Array
    filtered_mm: Array


def phase_noise(lab: Lab, amplitudes: Array) -> PhaseNoise | None:
    """Walls whose albedo gives the amplitudes; None for a chain without phases."""
    white, off = lab.knobs.white, lab.knobs.no_filters
    if white is None or off is None or not lab.knobs.phases:
        return None
    bright = lab.wall(_WALL_MM).infrared.mean() / COUNTS_PER_AMPLITUDE
    found = [_at(lab, float(a / bright), {**white, **off}, white) for a in amplitudes]
    return PhaseNoise(
        np.array([f[0] for f in found]),
        np.stack([f[1] for f in found], axis=1),
        np.array([f[2] for f in found]),
        np.array([f[3] for f in found]),
    )


def _at(
    lab: Lab, albedo: float, raw: Changes, filtered: Changes
) -> tuple[float, Array, float, float]:
    def shoot(changes: Changes) -> Shots:
        return lab.bench.shoot(
            scenes.wall(_WALL_MM, albedo), at_mm=(0, 0, _WALL_MM), changes=changes,
            scene=f"phases {albedo:.4f}", extra=lab.knobs.phases,
        ).centre()  # fmt: skip

    shots = shoot(raw)
    phasors = _phasors(shots, lab.knobs.phases)
    mean = phasors.mean(axis=1, keepdims=True)
    count = phasors.shape[1]
    # Angles about each pixel's own mean phasor, so that none wraps.
    angle = np.angle(phasors * np.conj(mean))
    sigma = np.sqrt((angle**2).mean(axis=(1, 2, 3)) * count / (count - 1))
    return (
        float(np.abs(mean).mean()),
        np.asarray(sigma),
        measure.sigma_temporal(shots.fine_mm),
        measure.sigma_temporal(shoot(filtered).fine_mm),
    )


def _phasors(shots: Shots, layers: tuple[str, ...]) -> Array:
    """(3, T, H, W) complex, at 80, 16 and 120 MHz."""
    a, b = (shots.extra[name].astype(np.float64) for name in layers)
    parts = np.stack([a[..., 0], a[..., 2], b[..., 0]]), np.stack([a[..., 1], a[..., 3], b[..., 1]])
    return np.asarray(parts[0] + 1j * parts[1])


def phases(lab: Lab) -> dict[str, Measured]:
    """Checks 9 to 11."""
    found = phase_noise(lab, np.array([15.0, 20.0, 30.0, 50.0, 100.0]))
    if found is None:
        return {n: Measured(why_not=INTERNAL) for n in ("9", "10", "11")}
    wanted = {20: 1, 50: 3, 100: 4}
    sigma = {
        f"{mhz} MHz @{a}": float(found.sigma_rad[k, i])
        for k, mhz in enumerate(curves.FREQUENCIES_MHZ)
        for a, i in wanted.items()
    }
    fusion = found.raw_mm / (curves.FUSION_MM_PER_RAD * np.sqrt((found.sigma_rad**2).sum(axis=0)))
    gain = (found.raw_mm / found.filtered_mm)[2:]
    return {
        "9": Measured(sigma),
        "10": Measured({"least": float(fusion.min()), "most": float(fusion.max())}),
        "11": Measured({"least": float(gain.min()), "most": float(gain.max())}),
    }
