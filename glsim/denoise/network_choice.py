"""Choice of the shipped network by camera and noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.data.recording import Recording
from glsim.denoise.registry import SHIPPED
from glsim.networks.safeguards import clean_noise_mm, estimate_noise_mm

#: The network for noise that is alike over many pixels, as that of active stereo.
WIDE: Final = "face-stereo"
#: For noise that neighbours share a little, as that of Azure Kinects.
SHARED: Final = "face-azure-kinect"
#: Bounds of noise between neighbours, divided by that over 2 px (1 is white), and most noise
#: between neighbours, mm, for SHARED. Measured, 40 sets of heads: Azure Kinect and Femto Bolt 0.74
#: to 0.79 and 0.24 to 0.32 mm (real 0.73); white noise 0.90 to 1.03, Kinect V2 0.36 to 0.48.
_SHARED_RATIOS, _SHARED_MOST_MM = (0.62, 0.85), 0.5
#: First words of the names of sensors of active stereo. Measured, RMSE within 30 mm, 256 px around
#: six simulated heads: WIDE is 13 to 22 % below SHIPPED (seven sensors; TrueDepth 6.4, 7.6 mm), of
#: truedepth-filtered equal, of a Kinect V1, whose noise is narrow, 10 % above.
_STEREO: Final = ("realsense", "truedepth", "oak")
#: Number of maps whose noise is measured, and side of their middle, px.
_MAPS, _MIDDLE_PX = 4, 256


def choose_network(recording: Recording) -> tuple[str, str]:
    """Choose a shipped network for a recording; return its name and the reason."""
    sensor, because, _ = recording.recognised
    if not sensor and recording.stated.baseline_m:
        sensor, because = "realsense", f"{recording.stated_by} states a baseline"
    if sensor.startswith(_STEREO):
        return WIDE, f"like {sensor}, because {because}"
    near_mm, ratio = noise_of(recording.votes.maps_mm)
    if near_mm == 0:
        seen = recording.votes.deepest_mm > 0
        shown = "show no noise on surfaces that tells more" if seen else "have no depth"
        return SHIPPED, f"the maps {shown}"
    shared = _SHARED_RATIOS[0] <= ratio < _SHARED_RATIOS[1] and near_mm <= _SHARED_MOST_MM
    noise = f"{near_mm:.2g} mm between neighbours, {ratio:.2f} of that over 2 px"
    return SHARED if shared else SHIPPED, f"its noise is {noise}"


def noise_of(maps_mm: Sequence[Depth]) -> tuple[float, float]:
    """Return noise between neighbours, mm, and its ratio to that over 2 px; 0 if none is seen."""
    middles_mm = [_middle(depth_mm) for depth_mm in maps_mm[:_MAPS]]
    noisy_mm = [depth_mm for depth_mm in middles_mm if clean_noise_mm(depth_mm) is None]
    sizes_mm = [[estimate_noise_mm(depth_mm, step) for step in (1, 2)] for depth_mm in noisy_mm]
    known = [(near_mm, near_mm / far_mm) for near_mm, far_mm in sizes_mm if near_mm and far_mm]
    near_mm, ratio = np.median(known, axis=0) if known else (0.0, 0.0)
    return float(near_mm), float(ratio)


def _middle(depth_mm: NDArray[Any]) -> Depth:
    """Cut the middle of a map, at most _MIDDLE_PX on each side."""
    top, left = (max(size - _MIDDLE_PX, 0) // 2 for size in depth_mm.shape)
    middle = depth_mm[top : top + _MIDDLE_PX, left : left + _MIDDLE_PX]
    return np.ascontiguousarray(middle, np.float32)
