"""Checks 9 to 11: phase noise before and after the decoder's filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from glsim.bench.measures import stacks as measure
from glsim.bench.measures.stacks import Array
from glsim.bench.validate import scenes
from glsim.bench.validate.captures import INTERNAL, PHASES, Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.bench.validate.virtual_camera import Changes
from glsim.core.depth_frame import Frames
from glsim.sensors.kinect_v2 import (
    COUNTS_PER_AMPLITUDE,
    FREQUENCIES_MHZ,
    FUSION_MM_PER_RAD,
)

#: Distance of the walls; it gives amplitudes of up to 120, and of 10 with a dark albedo.
_WALL_MM = 1500.0


#: Measurement phase noise of a Kinect V2 (Jaeremo Lawin, Forssen, Ovren, ECCV 2016; constants of
#: libfreenect2's opencl_kde_depth_packet_processor.cl): 1 / sigma = c1 a + c2 a^2 + c0.
_KDE = np.array(
    [
        [-3.088285897, 0.7919451669, -0.002363097609],
        [-3.863119924, 1.214266794, -0.00581082634],
        [-2.84614442, 0.6101457464, -0.00113679233],
    ]
)


def _measure_wall(
    captures: Captures, albedo: float, raw: Changes, filtered: Changes
) -> tuple[float, Array, Array, float, float]:
    """Measure a wall: amplitude, (3,) raw and filtered phase sigma, rad, and depth sigma, mm."""

    def capture_wall(changes: Changes) -> Frames:
        return captures.camera.capture(
            scenes.wall(_WALL_MM, albedo),
            changes=changes,
            scene=f"phases {albedo:.4f}",
            extra=PHASES,
        ).centre()

    with_noise, smooth = capture_wall(raw), capture_wall(filtered)
    phasors = _phasors(with_noise, PHASES)
    return (
        float(np.abs(phasors.mean(axis=1)).mean()),
        _phase_sigma(phasors),
        _phase_sigma(_phasors(smooth, PHASES)),
        measure.sigma_temporal(with_noise.measured_mm),
        measure.sigma_temporal(smooth.measured_mm),
    )


def _phase_sigma(phasors: Array) -> Array:
    """Compute the (3,) standard deviation of the phase over time, rad."""
    mean = phasors.mean(axis=1, keepdims=True)
    count = phasors.shape[1]
    # Angles are relative to each pixel's mean phasor, so that none wraps.
    angle = np.angle(phasors * np.conj(mean))
    return np.asarray(np.sqrt((angle**2).mean(axis=(1, 2, 3)) * count / (count - 1)))


def _phasors(capture: Frames, layers: tuple[str, ...]) -> Array:
    """Compute the complex phasors at 80, 16 and 120 MHz: (3, T, H, W)."""
    a, b = (capture.stack(name).astype(np.float64) for name in layers)
    parts = np.stack([a[..., 0], a[..., 2], b[..., 0]]), np.stack([a[..., 1], a[..., 3], b[..., 1]])
    return np.asarray(parts[0] + 1j * parts[1])


@validation_check("kinect-v2")
def phase_noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 9 to 11: phase noise, the depth noise it causes, gain of the filter."""
    white, off = captures.ablation("white"), captures.ablation("no_filters")
    if white is None or off is None:
        return {n: Measurement(why_not=INTERNAL) for n in ("9", "10", "11")}
    bright = captures.wall(_WALL_MM).stack("infrared").mean() / COUNTS_PER_AMPLITUDE
    walls = [
        _measure_wall(captures, float(a / bright), {**white, **off}, white)
        for a in (10.0, 20.0, 30.0, 50.0, 100.0)
    ]
    amplitude, raw, filtered, raw_mm, filtered_mm = (
        np.array(values) for values in zip(*walls, strict=True)
    )
    sigma = {
        f"{mhz} MHz @{a}": float(filtered[i, k])
        for k, mhz in enumerate(FREQUENCIES_MHZ)
        for a, i in ((20, 1), (50, 3), (100, 4))
    }
    low = filtered[0] / kde_phase_sigma_rad(amplitude[0])
    fusion = (raw_mm / (FUSION_MM_PER_RAD * np.sqrt((raw**2).sum(axis=1))))[2:]
    gain = (raw_mm / filtered_mm)[2:]
    return {
        "9": Measurement(
            sigma,
            f"not checked below 20: at {amplitude[0]:.0f} the phases have "
            f"{', '.join(f'{share:.2f}' for share in low)} of the published fit",
        ),
        "10": Measurement({"least": float(fusion.min()), "most": float(fusion.max())}),
        "11": Measurement({"least": float(gain.min()), "most": float(gain.max())}),
    }


def kde_phase_sigma_rad(amplitude: ArrayLike) -> Array:
    """Compute the (3, ...) noise of filtered phases, rad, limited to pi / 2.

    amplitude: libfreenect2's infrared units. The fit holds from 18 to 104: below phases wrap, above
    the polynomial of 16 MHz turns back.
    """
    a = np.asarray(amplitude, np.float64)
    inverse = np.stack([c0 + c1 * a + c2 * a**2 for c0, c1, c2 in _KDE])
    return np.asarray(1.0 / np.maximum(inverse, 2.0 / np.pi))
