"""Keep in the surfaces of a replay what is rougher than the camera's noise: cloth, hair, print.

Smoothing takes the noise of a frame, and with it everything that is finer than its window. What
varies more than the noise does on the smoothest surfaces with as much light belongs to the scene.
The noise is that of the real frames themselves, so that a sensor with too little of it gains
nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.measures.frame import DepthFrame

Array = NDArray[np.float64]
Labels = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Bounds of the classes of the noise: infrared, counts; depth, mm, without infrared. Chosen.
_CLASSES = np.geomspace(100.0, 65_000.0, 34)
#: The smoothest surfaces of a class are its lower quarter; chosen.
_SMOOTHEST = 0.25
#: Least pixels of a class; chosen.
_LEAST_PX = 500
#: Times the noise variance below which nothing is kept. The lower quarter is 0.8 of the variance of
#: noise alone in a window of 3 px, so that three quarters of a plane keep nothing; chosen.
_KEPT_ABOVE = 1.7
#: Distance from a rim within which nothing is kept, px: flying pixels are no relief. Chosen.
_RIM_PX = 2


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """Variance of what smoothing takes from the smoothest surfaces.

    Attributes:
        at: (N,) infrared, counts, or depth, mm, in the middle of each class.
        variance_mm2: (N,) of the difference from the smoothed depth, mm^2; empty without enough
            pixels.

    """

    at: Array
    variance_mm2: Array

    def variance(self, frame: DepthFrame) -> Array:
        """Return the (H, W) variance of a frame's noise, mm^2; infinite if nothing was measured."""
        if self.at.size == 0:
            return np.full(frame.depth_mm.shape, np.inf)
        driver = np.maximum(_driver(frame), _CLASSES[0])
        return np.asarray(np.interp(np.log(driver), np.log(self.at), self.variance_mm2))


def measure_noise_floor(
    frames: Sequence[DepthFrame], smoothed: Sequence[tuple[Labels, Array]], sigma_px: float
) -> NoiseFloor:
    """Measure the noise of the smoothest surfaces over infrared, or over depth without infrared.

    Args:
        frames: all with infrared, or all without.
        smoothed: (H, W) numbers of the surfaces of each, -1 = none, and its smoothed depth, mm.
        sigma_px: standard deviation of the Gaussian window, px.

    """
    variances, drivers = [], []
    for frame, (label, smooth) in zip(frames, smoothed, strict=True):
        variance = _local_variance(frame.depth_mm - smooth, label >= 0, sigma_px)
        inner = _far_from_rims(label)
        variances.append(variance[inner])
        drivers.append(_driver(frame)[inner])
    variance, driver = np.concatenate(variances), np.concatenate(drivers)
    place = np.digitize(driver, _CLASSES)
    at, floor = [], []
    for k in range(1, len(_CLASSES)):
        chosen = variance[place == k]
        if chosen.size >= _LEAST_PX:
            at.append(np.sqrt(_CLASSES[k - 1] * _CLASSES[k]))
            floor.append(np.quantile(chosen, _SMOOTHEST))
    return NoiseFloor(np.array(at), np.array(floor))


def keep_relief(
    depth_mm: NDArray[np.float32],
    smooth_mm: Array,
    label: Labels,
    variance_mm2: Array,
    sigma_px: float,
) -> Array:
    """Give smoothed depth the relief back that is rougher than noise.

    Args:
        depth_mm: (H, W) measured depth, mm.
        smooth_mm: (H, W) smoothed depth, mm, NaN where unknown.
        label: (H, W) number of the surface of each pixel; -1 = none.
        variance_mm2: (H, W) of the camera's noise, mm^2.
        sigma_px: standard deviation of the Gaussian window, px.

    Returns:
        (H, W) mm: the share of the difference that the variance beyond the noise's has of all.

    """
    difference = depth_mm - smooth_mm
    variance = _local_variance(difference, label >= 0, sigma_px)
    share = np.clip(1.0 - _KEPT_ABOVE * variance_mm2 / np.maximum(variance, 1e-9), 0.0, 1.0)
    return np.asarray(smooth_mm + np.where(_far_from_rims(label), share * difference, 0.0))


def _driver(frame: DepthFrame) -> Array:
    """Return what the noise of a frame depends on: (H, W) infrared, or depth without infrared."""
    source = frame.depth_mm if frame.infrared is None else frame.infrared
    return np.nan_to_num(source.astype(np.float64))


def _far_from_rims(label: Labels) -> Mask:
    """Return the (H, W) pixels around which all are of one surface."""
    window = np.ones((2 * _RIM_PX + 1, 2 * _RIM_PX + 1), np.uint8)
    image = label.astype(np.float32)  # a frame has fewer surfaces than 2^24
    return np.asarray((cv2.erode(image, window) == cv2.dilate(image, window)) & (label >= 0))


def _local_variance(difference_mm: Array, known: Mask, sigma_px: float) -> Array:
    """Return the (H, W) variance within a Gaussian window, of known pixels."""

    def blur(image: Array) -> Array:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT))

    weight = np.maximum(blur(known.astype(np.float64)), 1e-6)
    filled: Array = np.where(known, difference_mm, 0.0).astype(np.float64)
    mean = blur(filled) / weight
    return np.maximum(blur(filled * filled) / weight - mean * mean, 0.0)
