"""Classical filters that know holes: only valid pixels are looked at.

The honest rivals of a network, each with an optional mask clean-up. Without it the input's
validity stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..types import Depth, Mask
from .base import Denoised, parameter
from .polynomial import local_polynomial
from .windows import around, clean_up, fill


@dataclass(frozen=True)
class _Masked:
    def __call__(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Filter; what has no neighbour to go by stays without depth."""
        support, wanted = valid, valid
        cleanup = getattr(self, "cleanup", 0)
        if cleanup:
            support, wanted = clean_up(noisy_mm, valid, cleanup)
        depth = np.zeros_like(noisy_mm)
        if not support.any() or not wanted.any():
            return Denoised(depth, np.zeros_like(valid))
        depth[wanted] = self.estimate(noisy_mm, support, wanted)
        kept = wanted & (depth > 0)
        return Denoised(np.where(kept, depth, np.float32(0)), kept)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """(N,) depths of the N wanted pixels from those of ``support``; 0 where there is none."""
        raise NotImplementedError


_CLEANUP = "side of the window of the mask clean-up, px, odd; 0 keeps the input's mask"


@dataclass(frozen=True)
class MaskedMedian(_Masked):
    """median of the valid pixels of a square"""

    size: int = parameter(5, 3, 31, "side of the window, px, odd")
    cleanup: int = parameter(0, 0, 31, _CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """With an even number of them, the mean of the middle two."""
        values = np.where(support, noisy_mm, np.float32(np.inf))
        ordered = np.sort(around(values, self.size // 2, wanted, np.inf), axis=1)
        found = np.isfinite(ordered).sum(axis=1)
        row = np.arange(len(found))
        low, high = ordered[row, np.maximum(found - 1, 0) // 2], ordered[row, found // 2]
        some = found > 0
        zero = np.float32(0)
        middle: Depth = np.float32(0.5) * (np.where(some, low, zero) + np.where(some, high, zero))
        return middle


@dataclass(frozen=True)
class MaskedBilateral(_Masked):
    """bilateral filter over the valid pixels of a square"""

    diameter: int = parameter(9, 3, 31, "side of the window, px, odd")
    sigma_mm: float = parameter(15.0, 0.1, 8000, "differences this large count less")
    sigma_px: float = parameter(2.0, 0.1, 500, "pixels this far away count less")
    cleanup: int = parameter(0, 0, 31, _CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Differences are to the pixel's own depth, or to the nearest where it has none."""
        radius = self.diameter // 2
        offset = np.arange(-radius, radius + 1, dtype=np.float32)
        nearness = np.add.outer(offset**2, offset**2).ravel() / np.float32(2 * self.sigma_px**2)
        depth = around(noisy_mm, radius, wanted, 0.0)
        own = fill(noisy_mm, support)[wanted][:, None]
        likeness = (depth - own) ** 2 / np.float32(2 * self.sigma_mm**2)
        # 80: exp(-80) is as good as nothing, and far from where float32 underflows.
        weight = np.exp(-np.minimum(nearness + likeness, np.float32(80)))
        weight *= around(support, radius, wanted, False)
        return _ratio((weight * depth).sum(axis=1), weight.sum(axis=1))


@dataclass(frozen=True)
class MaskedGaussian(_Masked):
    """Gaussian mean of the valid pixels (normalised convolution, Knutsson and Westin 1993)"""

    sigma_px: float = parameter(1.5, 0.3, 20, "standard deviation of the window")
    cleanup: int = parameter(0, 0, 31, _CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Weighted mean."""
        return local_polynomial(noisy_mm, support, wanted, self.sigma_px, degree=0)


@dataclass(frozen=True)
class LocalPlane(_Masked):
    """plane fitted to the valid pixels under a Gaussian window"""

    sigma_px: float = parameter(2.0, 0.5, 20, "standard deviation of the window")
    cleanup: int = parameter(0, 0, 31, _CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """The plane's value in the middle."""
        return local_polynomial(noisy_mm, support, wanted, self.sigma_px, degree=1)


@dataclass(frozen=True)
class LocalQuadric(_Masked):
    """quadric fitted to the valid pixels under a Gaussian window"""

    sigma_px: float = parameter(2.5, 0.7, 20, "standard deviation of the window")
    cleanup: int = parameter(0, 0, 31, _CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """The quadric's value in the middle."""
        return local_polynomial(noisy_mm, support, wanted, self.sigma_px, degree=2)


@dataclass(frozen=True)
class Guided(_Masked):
    """guided filter (He et al. 2010, OpenCV ximgproc), guided by the depth itself, holes filled"""

    radius: int = parameter(3, 1, 30, "of the square window, px")
    epsilon_mm: float = parameter(5.0, 0.01, 1000, "a variation smaller than this is smoothed away")
    cleanup: int = parameter(0, 0, 31, _CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Holes take the nearest depth, so that edges are not dragged to 0."""
        filled = fill(noisy_mm, support)
        # About the middle: ximgproc subtracts squared means in float32.
        centre = np.float32(np.median(noisy_mm[support]))
        image = filled - centre
        smooth = cv2.ximgproc.guidedFilter(image, image, self.radius, self.epsilon_mm**2)
        estimate: Depth = smooth[wanted] + centre
        return estimate


@dataclass(frozen=True)
class RollingGuidance(_Masked):
    """rolling guidance filter (Zhang et al. 2014, OpenCV ximgproc), holes filled"""

    sigma_mm: float = parameter(10.0, 0.1, 1000, "differences this large count less")
    sigma_px: float = parameter(2.0, 0.3, 20, "structures smaller than this go")
    iterations: int = parameter(4, 1, 10, "how often the guidance is renewed")
    cleanup: int = parameter(0, 0, 31, _CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Holes take the nearest depth."""
        smooth = cv2.ximgproc.rollingGuidanceFilter(
            fill(noisy_mm, support), None, -1, self.sigma_mm, self.sigma_px, self.iterations
        )
        estimate: Depth = smooth[wanted]
        return estimate


def _ratio(total: Depth, weight: Depth) -> Depth:
    ratio = np.zeros_like(total)
    np.divide(total, weight, out=ratio, where=weight > 0)
    return ratio
