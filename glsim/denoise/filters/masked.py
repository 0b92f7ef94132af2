"""Mask-aware classical filters: they read valid pixels only.

A network should be compared with these filters, because they are fair rivals. Each has an optional
mask clean-up; without it the output keeps the input's validity.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from glsim.denoise.filters.polynomial import local_polynomial
from glsim.denoise.filters.windows import around, clean_up, fill
from glsim.denoise.interface import Denoised, Depth, Mask, parameter


@dataclass(frozen=True)
class Masked:
    """A filter that estimates the depth of wanted pixels from supporting ones."""

    def __call__(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Filter (H, W) millimetres; pixels without a valid neighbour get no depth."""
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
        """Return (N,) depths in mm of the N wanted pixels; 0 without support."""
        raise NotImplementedError


CLEANUP = "side of the window of the mask clean-up, px, odd; 0 keeps the input's mask"


@dataclass(frozen=True)
class MaskedMedian(Masked):
    """Median of the valid pixels of a square."""

    size: int = parameter(5, 3, 31, "side of the window, px, odd")
    cleanup: int = parameter(0, 0, 31, CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Return medians; for an even number of valid pixels the mean of the middle two."""
        values = np.where(support, noisy_mm, np.float32(np.inf))
        ordered = np.sort(around(values, self.size // 2, wanted, np.inf), axis=1)
        count = np.isfinite(ordered).sum(axis=1)
        row = np.arange(len(count))
        low, high = ordered[row, np.maximum(count - 1, 0) // 2], ordered[row, count // 2]
        some = count > 0
        zero = np.float32(0)
        middle: Depth = np.float32(0.5) * (np.where(some, low, zero) + np.where(some, high, zero))
        return middle


@dataclass(frozen=True)
class MaskedBilateral(Masked):
    """Bilateral filter over the valid pixels of a square."""

    diameter: int = parameter(9, 3, 31, "side of the window, px, odd")
    sigma_mm: float = parameter(15.0, 0.1, 8000, "standard deviation of the depth weight")
    sigma_px: float = parameter(2.0, 0.1, 500, "standard deviation of the distance weight")
    cleanup: int = parameter(0, 0, 31, CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Return weighted means; a hole takes the nearest valid depth as its own."""
        radius = self.diameter // 2
        offset = np.arange(-radius, radius + 1, dtype=np.float32)
        nearness = np.add.outer(offset**2, offset**2).ravel() / np.float32(2 * self.sigma_px**2)
        depth = around(noisy_mm, radius, wanted, 0.0)
        own = fill(noisy_mm, support)[wanted][:, None]
        likeness = (depth - own) ** 2 / np.float32(2 * self.sigma_mm**2)
        # 80: exp(-80) is negligible, and float32 does not underflow there.
        weight = np.exp(-np.minimum(nearness + likeness, np.float32(80)))
        weight *= around(support, radius, wanted, False)
        return _ratio((weight * depth).sum(axis=1), weight.sum(axis=1))


@dataclass(frozen=True)
class MaskedGaussian(Masked):
    """Gaussian mean of the valid pixels (normalised convolution, Knutsson and Westin 1993)."""

    sigma_px: float = parameter(1.5, 0.3, 20, "standard deviation of the window")
    cleanup: int = parameter(0, 0, 31, CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Return weighted means."""
        return local_polynomial(noisy_mm, support, wanted, self.sigma_px, degree=0)


@dataclass(frozen=True)
class LocalPlane(Masked):
    """Plane fitted to the valid pixels under a Gaussian window."""

    sigma_px: float = parameter(2.0, 0.5, 20, "standard deviation of the window")
    cleanup: int = parameter(0, 0, 31, CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Return the plane's value at the window centre."""
        return local_polynomial(noisy_mm, support, wanted, self.sigma_px, degree=1)


@dataclass(frozen=True)
class LocalQuadric(Masked):
    """Quadric fitted to the valid pixels under a Gaussian window."""

    sigma_px: float = parameter(2.5, 0.7, 20, "standard deviation of the window")
    cleanup: int = parameter(0, 0, 31, CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Return the quadric's value at the window centre."""
        return local_polynomial(noisy_mm, support, wanted, self.sigma_px, degree=2)


@dataclass(frozen=True)
class Guided(Masked):
    """Guided filter (He et al. 2010, OpenCV ximgproc), guided by the depth itself, holes filled."""

    radius: int = parameter(3, 1, 30, "radius of the square window, px")
    epsilon_mm: float = parameter(5.0, 0.01, 1000, "depth variations below this are smoothed away")
    cleanup: int = parameter(0, 0, 31, CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Return smoothed depths; holes take the nearest depth, which keeps edges off 0."""
        filled = fill(noisy_mm, support)
        # Depths relative to the median: ximgproc subtracts squared means in float32.
        centre = np.float32(np.median(noisy_mm[support]))
        image = filled - centre
        smooth = cv2.ximgproc.guidedFilter(image, image, self.radius, self.epsilon_mm**2)
        estimate: Depth = smooth[wanted] + centre
        return estimate


@dataclass(frozen=True)
class RollingGuidance(Masked):
    """Rolling guidance filter (Zhang et al. 2014, OpenCV ximgproc), holes filled."""

    sigma_mm: float = parameter(10.0, 0.1, 1000, "standard deviation of the depth weight")
    sigma_px: float = parameter(2.0, 0.3, 20, "structures below this size are removed")
    iterations: int = parameter(4, 1, 10, "number of guidance updates")
    cleanup: int = parameter(0, 0, 31, CLEANUP)

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Return smoothed depths; holes are filled with the nearest depth."""
        smooth = cv2.ximgproc.rollingGuidanceFilter(
            fill(noisy_mm, support), None, -1, self.sigma_mm, self.sigma_px, self.iterations
        )
        return np.asarray(smooth[wanted], np.float32)


def _ratio(total: Depth, weight: Depth) -> Depth:
    """Return total / weight, 0 where the weight is 0."""
    ratio = np.zeros_like(total)
    np.divide(total, weight, out=ratio, where=weight > 0)
    return ratio


#: Name on the command line -> filter.
FILTERS = {
    "masked_median": MaskedMedian,
    "masked_bilateral": MaskedBilateral,
    "masked_gaussian": MaskedGaussian,
    "plane": LocalPlane,
    "quadric": LocalQuadric,
    "guided": Guided,
    "rolling_guidance": RollingGuidance,
}
#: Values that tuning tries: filter -> parameter -> values. Tuning also tries ``cleanup``.
GRIDS = {
    "masked_median": {"size": (3, 5, 7, 9)},
    "masked_bilateral": {"sigma_mm": (5.0, 15.0, 40.0), "sigma_px": (1.0, 1.5, 2.0, 3.0)},
    "masked_gaussian": {"sigma_px": (0.7, 1.0, 1.5, 2.0, 3.0)},
    "plane": {"sigma_px": (1.0, 1.5, 2.0, 3.0, 4.0)},
    "quadric": {"sigma_px": (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)},
    "guided": {"radius": (2, 3, 5), "epsilon_mm": (2.0, 5.0, 15.0)},
    "rolling_guidance": {"sigma_mm": (5.0, 15.0), "sigma_px": (1.0, 2.0)},
}
