"""Published curves of depth noise that sensors are compared with. Depths in m, sigmas in mm."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Modulation frequencies of the Kinect V2, MHz, in the order of all phase arrays here.
FREQUENCIES_MHZ = (80, 16, 120)

#: Depth noise of libfreenect2's fusion, mm per rad of the root of the summed phase variances.
#: Derived: c / 2 / 216 MHz for the mean of the three cycle counts, over 2 pi.
FUSION_MM_PER_RAD = 110.5

#: Measurement phase noise of a Kinect V2 (Jaeremo Lawin, Forssen, Ovren, ECCV 2016; constants of
#: libfreenect2's opencl_kde_depth_packet_processor.cl): 1 / sigma = c1 a + c2 a^2 + c0.
_KDE = np.array(
    [
        [-3.088285897, 0.7919451669, -0.002363097609],
        [-3.863119924, 1.214266794, -0.00581082634],
        [-2.84614442, 0.6101457464, -0.00113679233],
    ]
)


def fankhauser_mm(z_m: ArrayLike, angle_rad: ArrayLike = 0.0) -> Array:
    """Sigma of a Kinect V2 indoors, mm (Fankhauser et al., ICAR 2015)."""
    z, angle = np.asarray(z_m, np.float64), np.asarray(angle_rad, np.float64)
    tilt = angle**2 / (np.pi / 2 - angle) ** 2
    return np.asarray(1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * tilt)


def nguyen_mm(z_m: ArrayLike) -> Array:
    """Sigma of a Kinect V1 that faces a wall, mm (Nguyen, Izadi, Lovell, 3DIMPVT 2012)."""
    return np.asarray(1.2 + 1.9 * (np.asarray(z_m, np.float64) - 0.4) ** 2)


def kde_phase_sigma_rad(amplitude: ArrayLike) -> Array:
    """Return the (3, ...) noise of filtered phases, rad, at most pi / 2.

    amplitude: libfreenect2's infrared units, from KDE_LEAST_AMPLITUDE to KDE_MOST_AMPLITUDE; below
    phases wrap, above the polynomial of 16 MHz turns back.
    """
    a = np.asarray(amplitude, np.float64)
    inverse = np.stack([c0 + c1 * a + c2 * a**2 for c0, c1, c2 in _KDE])
    return np.asarray(1.0 / np.maximum(inverse, 2.0 / np.pi))


#: Range of amplitudes in which the fit holds (docs/validation.md).
KDE_LEAST_AMPLITUDE, KDE_MOST_AMPLITUDE = 18.0, 104.0

#: Tap noise fitted to the curve above, read as that of unfiltered phases: variance = read + shot
#: times the raw amplitude (amplitude over the multiplier of its frequency), LSB^2. It holds above
#: an amplitude of 120 too.
TAP_READ_LSB2 = 1.755
TAP_SHOT_LSB = 0.0166
AMPLITUDE_MULTIPLIERS = (1.3226, 1.0, 1.6129)


def tap_phase_sigma_rad(
    amplitude: ArrayLike,
    rounding_lsb2: float = 0.0,
    read_lsb2: float = TAP_READ_LSB2,
    shot_lsb: float = TAP_SHOT_LSB,
) -> Array:
    """Compute the phase noise of three taps with read and shot noise.

    Args:
        amplitude: libfreenect2's infrared units, any shape.
        rounding_lsb2: variance that rounding adds to a tap, LSB^2.
        read_lsb2: variance of a tap without light, LSB^2.
        shot_lsb: its growth per LSB of light, LSB.

    Returns:
        (3, ...) rad.

    """
    a = np.maximum(np.asarray(amplitude, np.float64), 1e-6)
    raw = np.stack([a / m for m in AMPLITUDE_MULTIPLIERS])
    return np.sqrt(2.0 / 3.0 * (read_lsb2 + rounding_lsb2 + shot_lsb * raw)) / raw


def white_sigma_mm(
    amplitude: ArrayLike,
    gain: float = 3.0,
    rounding_lsb2: float = 0.0,
    read_lsb2: float = TAP_READ_LSB2,
    shot_lsb: float = TAP_SHOT_LSB,
) -> Array:
    """Depth noise from the phases alone, mm, after a filter that divides it by ``gain``.

    See ``tap_phase_sigma_rad`` for the other arguments.
    """
    phases = tap_phase_sigma_rad(amplitude, rounding_lsb2, read_lsb2, shot_lsb)
    squares = (phases**2).sum(axis=0)
    return np.asarray(FUSION_MM_PER_RAD / gain * np.sqrt(squares))


def shadow_px(baseline_m: float, focal_px: float, occluder_m: float, background_m: float) -> float:
    """Width of the shadow that an occluder casts on a background, pixels."""
    return baseline_m * focal_px * (1.0 / occluder_m - 1.0 / background_m)
