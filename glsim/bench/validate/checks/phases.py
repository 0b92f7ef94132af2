"""Checks 9 to 11: phase noise before and after the decoder's filter."""

from __future__ import annotations

import numpy as np

from glsim.bench import scenes
from glsim.bench.validate.captures import INTERNAL, PHASES, Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.array_types import Array
from glsim.core.depth_frame import Frames
from glsim.measures import stacks as measure
from glsim.sensors.kinect_v2 import COUNTS_PER_AMPLITUDE, FREQUENCIES_MHZ, FUSION_MM_PER_RAD
from glsim.simulation.virtual_camera import Changes

#: Distance of the walls, at which amplitude is up to 120, and 20 with a dark albedo.
_WALL_MM = 1500.0


def _measure_wall(
    captures: Captures, albedo: float, raw: Changes, filtered: Changes
) -> tuple[Array, Array, float, float]:
    """Measure a wall: (3,) phase sigma, raw and filtered, rad; depth sigma of both, mm."""

    def capture_wall(changes: Changes) -> Frames:
        return captures.camera.capture(
            scenes.wall(_WALL_MM, albedo),
            changes=changes,
            scene=f"phases {albedo:.4f}",
            extra=PHASES,
        ).centre()

    shots = capture_wall(raw), capture_wall(filtered)
    sigma_mm = [measure.sigma_temporal(shot.measured_mm) for shot in shots]
    return _phase_sigma(shots[0]), _phase_sigma(shots[1]), sigma_mm[0], sigma_mm[1]


def _phase_sigma(capture: Frames) -> Array:
    """Compute the (3,) standard deviation over time of the phase at 80, 16 and 120 MHz, rad."""
    a, b = (capture.stack(name).astype(np.float64) for name in PHASES)
    parts = np.stack([a[..., 0], a[..., 2], b[..., 0]]), np.stack([a[..., 1], a[..., 3], b[..., 1]])
    phasors = parts[0] + 1j * parts[1]
    mean = phasors.mean(axis=1, keepdims=True)
    count = phasors.shape[1]
    # Angles are measured from each pixel's mean phasor, so that no angle wraps.
    angle = np.angle(phasors * np.conj(mean))
    return np.asarray(np.sqrt((angle**2).mean(axis=(1, 2, 3)) * count / (count - 1)))


@validation_check("kinect-v2")
def phase_noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 9 to 11: phase noise, the depth noise it causes, gain of the filter."""
    white, off = captures.ablation("white"), captures.ablation("no_filters")
    if white is None or off is None:
        return {n: Measurement(why_not=INTERNAL) for n in ("9", "10", "11")}
    bright = captures.wall(_WALL_MM).stack("infrared").mean() / COUNTS_PER_AMPLITUDE
    walls = [
        _measure_wall(captures, float(a / bright), {**white, **off}, white)
        for a in (20.0, 30.0, 50.0, 100.0)
    ]
    raw, filtered, raw_mm, filtered_mm = (np.array(values) for values in zip(*walls, strict=True))
    sigma = {
        f"{mhz} MHz @{a}": float(filtered[i, k])
        for k, mhz in enumerate(FREQUENCIES_MHZ)
        for a, i in ((20, 0), (50, 2), (100, 3))
    }
    fusion = (raw_mm / (FUSION_MM_PER_RAD * np.sqrt((raw**2).sum(axis=1))))[1:]
    gain = (raw_mm / filtered_mm)[1:]
    return {
        "9": Measurement(sigma),
        "10": Measurement({"least": float(fusion.min()), "most": float(fusion.max())}),
        "11": Measurement({"least": float(gain.min()), "most": float(gain.max())}),
    }
