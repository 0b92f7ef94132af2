"""Choice of the shipped network by camera and noise, and recognition of the camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.units import MM_PER_M
from glsim.data.recording import Recording
from glsim.data.recordings.camera_file import SENSORS_OF_SIZE
from glsim.denoise.registry import SHIPPED
from glsim.measures.lattice import distinct_values, estimate_lattice
from glsim.networks.safeguards import clean_noise_mm, estimate_noise_mm
from glsim.sensors.sensor import load_sensor, sensor_names

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

#: Sensors that deliver depth in steps of disparity.
_IN_STEPS: Final = (
    *("realsense-d435", "realsense-d455", "realsense-d415", "realsense-d405"),
    *("oak-d-pro", "kinect-v1-pattern"),
)


def choose_network(recording: Recording) -> tuple[str, str]:
    """Choose a shipped network for a recording; return its name and the reason."""
    sensor, because = camera_of(recording)
    if not sensor and recording.stated.baseline_m:
        sensor, because = "realsense", f"{recording.stated_by} states a baseline"
    if sensor.startswith(_STEREO):
        return WIDE, f"like {sensor}, because {because}"
    return _for_width([_middle(depth_mm) for depth_mm in recording.votes.maps_mm[:_MAPS]])


def _for_width(maps_mm: Sequence[Depth]) -> tuple[str, str]:
    """Choose the network for noise of few pixels by the ratio of its size over 1 and over 2 px."""
    noisy_mm = [depth_mm for depth_mm in maps_mm if clean_noise_mm(depth_mm) is None]
    sizes_mm = [[estimate_noise_mm(depth_mm, step) for step in (1, 2)] for depth_mm in noisy_mm]
    known = [(near_mm, near_mm / far_mm) for near_mm, far_mm in sizes_mm if near_mm and far_mm]
    if not known:
        seen = any(depth_mm.any() for depth_mm in maps_mm)
        shown = "show no noise on surfaces that tells more" if seen else "have no depth"
        return SHIPPED, f"the maps {shown}"
    near_mm, ratio = (float(np.median(values)) for values in zip(*known, strict=True))
    shared = _SHARED_RATIOS[0] <= ratio < _SHARED_RATIOS[1] and near_mm <= _SHARED_MOST_MM
    noise = f"{near_mm:.2g} mm between neighbours, {ratio:.2f} of that over 2 px"
    return SHARED if shared else SHIPPED, f"its noise is {noise}"


def _middle(depth_mm: NDArray[Any]) -> Depth:
    """Cut the middle of a map, at most _MIDDLE_PX on each side."""
    top, left = (max(size - _MIDDLE_PX, 0) // 2 for size in depth_mm.shape)
    middle = depth_mm[top : top + _MIDDLE_PX, left : left + _MIDDLE_PX]
    return np.ascontiguousarray(middle, np.float32)


class Camera(NamedTuple):
    """The shipped sensor that resembles a camera ("" if unknown), and the evidence for it."""

    sensor: str
    because: str


def camera_of(recording: Recording) -> Camera:
    """Recognise a camera: by its stated sensor or name, the size of its images, or their values."""
    votes, stated = recording.votes, recording.stated
    named = stated.name.lower().replace(" ", "-")
    known = sorted((name for name in sensor_names() if name in named), key=len)
    if sensor := stated.sensor or (known[-1] if known else ""):
        return Camera(sensor, f"{recording.stated_by} states it")
    size = width, height = votes.maps_mm[0].shape[::-1]
    if (sized := SENSORS_OF_SIZE.get(size)) is not None:
        return Camera(sized, f"its images have {width} x {height} pixels")
    if votes.step_mm > 0:
        lattice = estimate_lattice(distinct_values(votes.maps_mm, votes.step_mm))
        if lattice is not None and lattice.accepted:
            steps_mm = lattice.constant * votes.step_mm
            _, sensor, steps = min(
                (
                    abs(math.log(steps_mm / (MM_PER_M * s.rig.baseline_m * s.steps_per_px * f)))
                    + ((w, h) != size),
                    s.name,
                    s.steps_per_px,
                )
                for s in map(load_sensor, _IN_STEPS)
                for w, h, f in s.modes
            )
            product = f"f B = {steps_mm / steps:,.0f} px mm"
            return Camera(sensor, f"its depths lie on a lattice of disparities of {product}")
    return Camera("", "neither a file nor the maps say what made them")
