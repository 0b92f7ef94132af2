"""Constants of the Kinect V2 besides its TOML file: frequencies, phase fusion, tap noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from glsim.core.array_types import Array

#: Infrared counts per unit of the mean amplitude, as in libfreenect2.
COUNTS_PER_AMPLITUDE = 16.0
#: Modulation frequencies of the Kinect V2, MHz, in the order of all phase arrays of this module.
FREQUENCIES_MHZ = (80, 16, 120)
#: Depth noise after libfreenect2's fusion, mm, per rad of the root of the summed phase variances.
#: Derived: c / 2 / 216 MHz for the mean of the three cycle counts, divided by 2 pi.
FUSION_MM_PER_RAD = 110.5
#: Tap noise fitted to the depth noise above, as the noise of unfiltered phases. The variance of a
#: tap is read + shot times the raw amplitude, LSB^2. The raw amplitude is the amplitude over its
#: frequency's multiplier. The fit holds above an amplitude of 120, too.
TAP_READ_LSB2 = 1.755
TAP_SHOT_LSB = 0.0166
AMPLITUDE_MULTIPLIERS = (1.3226, 1.0, 1.6129)


def tap_phase_sigma_rad(
    amplitude: ArrayLike,
    rounding_lsb2: float = 0.0,
    read_lsb2: float = TAP_READ_LSB2,
    shot_lsb: float = TAP_SHOT_LSB,
) -> Array:
    """Compute the phase noise, rad, that read noise and shot noise of the three taps cause.

    Args:
        amplitude: libfreenect2's infrared units, any shape.
        rounding_lsb2: variance that rounding adds to a tap, LSB^2.
        read_lsb2: variance of a tap without light, LSB^2.
        shot_lsb: growth of a tap's variance per LSB of light, LSB.

    Returns (3, ...) phase noise of each frequency, rad.
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
    """Compute the depth noise, mm, from phase noise alone, after a filter with ``gain``.

    See ``tap_phase_sigma_rad`` for the other arguments.
    """
    phases = tap_phase_sigma_rad(amplitude, rounding_lsb2, read_lsb2, shot_lsb)
    squares = (phases**2).sum(axis=0)
    return np.asarray(FUSION_MM_PER_RAD / gain * np.sqrt(squares))
