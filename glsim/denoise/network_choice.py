"""Choice of the shipped network by the noise of the maps, and recognition of their camera."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.depth_map import FLYING_MM
from glsim.core.units import MM_PER_M
from glsim.data.recording import Recording
from glsim.data.recordings.camera_file import SENSORS_OF_SIZE
from glsim.denoise.registry import SHIPPED, load_denoiser
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
#: First words of the names of sensors of active stereo.
_STEREO: Final = ("realsense", "truedepth", "oak")
#: Number of maps on which both networks are tried, and side of their middle, px.
_TRIED, _TRIED_PX = 4, 256
#: WIDE is taken if what it takes away from surfaces has at least this correlation over _LAG_PX, and
#: at least this multiple of the size of what SHIPPED takes away: then it is noise, not form.
#: Measured: RealSense, two real and seven simulated recordings, 0.41 to 0.72 and 2.3 to 6.5;
#: TrueDepth 0.28 to 0.50 and 1.1 to 1.6; stereo with noise 2 px wide 0.25 and 2.7: form.
_LEAST_CORRELATION, _LEAST_RATIO, _LAG_PX = 0.35, 2.2, 4
#: Side of the windows of measured pixels in which the size is taken, px, and least number of them.
_WINDOW_PX, _LEAST_WINDOWS = 11, 200

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
    middles = [_middle(depth_mm) for depth_mm in recording.votes.maps_mm[:_TRIED]]
    if not sensor.startswith(_STEREO):
        return _for_width(middles)
    wide, narrow = (_taken_away(name, middles) for name in (WIDE, SHIPPED))
    if wide is None or narrow is None:
        return SHIPPED, "the maps show too little of a surface to measure their noise"
    (wide_mm, correlation), (narrow_mm, _) = wide, narrow
    ratio = wide_mm / narrow_mm if narrow_mm else 0.0
    noise = (
        f"like {sensor}, because {because}; {WIDE} takes away {ratio:.1f} times as much as "
        f"{SHIPPED}, of a correlation of {correlation:.2f} over {_LAG_PX} px"
    )
    if correlation >= _LEAST_CORRELATION and ratio >= _LEAST_RATIO:
        return WIDE, noise
    return SHIPPED, f"{noise}: form, not noise"


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


def _taken_away(name: str, maps_mm: Iterable[Depth]) -> tuple[float, float] | None:
    """Measure what a network takes away from surfaces; None with too few windows.

    Returns its median size, mm, and its correlation over _LAG_PX.
    """
    denoiser = load_denoiser(name)
    sizes_mm, product, square = [np.zeros(0, np.float32)], 0.0, 0.0
    for noisy_mm in maps_mm:
        change_mm = denoiser(noisy_mm).depth_mm - noisy_mm
        known = (noisy_mm > 0) & (np.abs(change_mm) < FLYING_MM)
        change_mm = np.where(known, change_mm, 0)
        whole = cv2.erode(known.astype(np.uint8), np.ones((_WINDOW_PX, _WINDOW_PX)), borderValue=0)
        sizes_mm.append(np.sqrt(cv2.blur(change_mm**2, (_WINDOW_PX, _WINDOW_PX))[whole > 0]))
        beside = change_mm[:, _LAG_PX:] * change_mm[:, :-_LAG_PX]
        both = known[:, _LAG_PX:] & known[:, :-_LAG_PX]
        product += float(beside[both].sum() / max(both.sum(), 1))
        square += float((change_mm[known] ** 2).sum() / max(known.sum(), 1))
    sizes = np.concatenate(sizes_mm)
    if sizes.size < _LEAST_WINDOWS:
        return None
    return float(np.median(sizes)), product / square if square else 0.0


def _middle(depth_mm: NDArray[Any]) -> Depth:
    """Cut the middle of a map, at most _TRIED_PX on each side."""
    top, left = (max(size - _TRIED_PX, 0) // 2 for size in depth_mm.shape)
    middle = depth_mm[top : top + _TRIED_PX, left : left + _TRIED_PX]
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
