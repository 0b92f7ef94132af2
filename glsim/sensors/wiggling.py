"""Wiggling of a time-of-flight device: its systematic depth error, periodic in distance.

Harmonics in the correlation shift each phase; the decoder's depth is the mean over the frequencies.
A sensor file states the device's harmonics, as ``glsim fit`` measures them:

    [[rig.wiggling]]          one wave per harmonic and modulation frequency
    harmonic = 2              2 or 5: 3 or 6 periods per half wavelength
    modulation_mhz = 80
    size = 0.0109             relative to the fundamental
    phase_deg = 57.3
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from glsim.core.array_types import Floats
from glsim.core.units import M_PER_MM
from glsim.noise.rig_checks import SPEED_OF_LIGHT

#: Harmonic -> its number of periods per half wavelength after aliasing by three taps.
CYCLES: Final[Mapping[int, int]] = {2: 3, 5: 6}
#: Number of fixed-point steps that find the true distance, of which the error is a function. The
#: error changes by at most 0.08 mm per mm (harmonics of 1.5 % and 0.6 %): an error of 5 mm is then
#: known within 0.003 mm.
_STEPS: Final = 3


class Wave(BaseModel):
    """A harmonic of the correlation at one modulation frequency: a [[rig.wiggling]] table."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    harmonic: Literal[2, 5]
    modulation_mhz: float = Field(ge=1)
    size: float = Field(ge=0, le=0.2)
    phase_deg: float = Field(ge=-180, le=180)


def wiggling_mm(
    distance_m: NDArray[np.floating], waves: Sequence[Wave], modulation_mhz: Sequence[float]
) -> NDArray[np.float64]:
    """Compute the wiggling error at each distance, mm; positive if the decoder measures too far.

    Args:
        distance_m: half the length of the path emitter, surface, camera, metres.
        modulation_mhz: all frequencies of the device; the decoder takes the mean over them.
    """
    distance = np.asarray(distance_m, np.float64)
    total = np.zeros_like(distance)
    for mhz in {wave.modulation_mhz for wave in waves}:
        phase = 4e6 * math.pi * mhz / SPEED_OF_LIGHT * distance
        # The light's phasor is exp(i phase); harmonic n adds size exp(i (its phase - n phase)).
        bent = np.ones(distance.shape, np.complex128)
        for wave in waves:
            if wave.modulation_mhz == mhz:
                own = math.radians(wave.phase_deg) - CYCLES[wave.harmonic] * phase
                bent += wave.size * np.exp(1j * own)
        total += np.angle(bent)
    return total / (2 * math.pi) * SPEED_OF_LIGHT / 2e3 / sum(modulation_mhz)


def remove_wiggling(
    depth_mm: NDArray[np.number],
    waves: Sequence[Wave],
    modulation_mhz: Sequence[float],
    rays: Floats,
    emitter_m: tuple[float, float, float],
) -> NDArray[np.float32]:
    """Subtract a device's wiggling from a depth map; return float32 mm of the same shape.

    Args:
        depth_mm: (H, W), 0 = no depth, which stays 0.
        rays: (H, W, 2) x/z and y/z of the same pixels.
        emitter_m: start of the light's path in the decoder (``SensorRig.emitter_m``).
    """
    measured = np.asarray(depth_mm, np.float32)
    known = measured > 0
    z_mm, x, y = (np.asarray(a[known], np.float64) for a in (measured, rays[..., 0], rays[..., 1]))
    stretch = np.sqrt(x * x + y * y + 1.0)
    true_mm = z_mm
    for _ in range(_STEPS):
        z = M_PER_MM * true_mm
        back = [z * x - emitter_m[0], z * y - emitter_m[1], z - emitter_m[2]]
        way = np.sqrt(back[0] ** 2 + back[1] ** 2 + back[2] ** 2)
        per_depth = 0.5 * (stretch + (back[0] * x + back[1] * y + back[2]) / way)
        error = wiggling_mm(0.5 * (z * stretch + way), waves, modulation_mhz)
        true_mm = z_mm - error / per_depth
    result = measured.copy()
    result[known] = true_mm
    return result
