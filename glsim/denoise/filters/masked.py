"""Mask-aware classical filters, which read valid pixels only.

A network should be compared with these filters: like it, they know which pixels are valid. Each has
an optional mask clean-up; without it, the output keeps the input's validity.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from glsim.core.array_types import Array, Depth, Mask
from glsim.core.depth_map import around
from glsim.denoise.filters.frame_filter import FrameFilter
from glsim.denoise.filters.windows import clean_up, fill
from glsim.denoise.parameters import parameter
from glsim.networks.interface import Denoised

#: Radius of the window in standard deviations.
_REACH = 2.5
#: Relative ridge weight that pulls slope and curvature to 0. It is negligible if the pixels
#: determine them, and decides if not (pixels in a line, or fewer pixels than coefficients).
_RIDGE = 1e-6


@dataclass(frozen=True)
class Masked(FrameFilter):
    """The base class of filters that estimate wanted pixels from valid pixels only."""

    cleanup: int = parameter(
        0, 0, 31, "side of the window of the mask clean-up, px, odd; 0 keeps the input's mask"
    )

    def filtered(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Filter an (H, W) depth map, mm; pixels without a valid neighbour get no depth."""
        support, wanted = valid, valid
        if self.cleanup:
            support, wanted = clean_up(noisy_mm, valid, self.cleanup)
        depth = np.zeros_like(noisy_mm)
        if not support.any() or not wanted.any():
            return Denoised(depth, np.zeros_like(valid))
        depth[wanted] = self.estimate(noisy_mm, support, wanted)
        kept = wanted & (depth > 0)
        return Denoised(np.where(kept, depth, np.float32(0)), kept)

    @abstractmethod
    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Estimate the depths, (N,) mm, of the N wanted pixels; 0 without a valid neighbour."""


@dataclass(frozen=True)
class MaskedMedian(Masked):
    """Median of the valid pixels of a square."""

    size: int = parameter(5, 3, 31, "side of the window, px, odd")

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Compute medians; of an even number of valid pixels, the mean of the middle two."""
        values = np.where(support, noisy_mm, np.float32(np.inf))
        ordered = np.sort(around(values, self.size // 2, wanted, np.inf), axis=1)
        count = np.isfinite(ordered).sum(axis=1)
        row = np.arange(len(count))
        low, high = ordered[row, np.maximum(count - 1, 0) // 2], ordered[row, count // 2]
        some = count > 0
        zero = np.float32(0)
        return np.float32(0.5) * (np.where(some, low, zero) + np.where(some, high, zero))


@dataclass(frozen=True)
class MaskedBilateral(Masked):
    """Bilateral filter over the valid pixels of a square."""

    diameter: int = parameter(9, 3, 31, "side of the window, px, odd")
    sigma_mm: float = parameter(15.0, 0.1, 8000, "standard deviation of the depth weight")
    sigma_px: float = parameter(2.0, 0.1, 500, "standard deviation of the distance weight")

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Compute weighted means; the weights of a hole start from the nearest valid depth."""
        radius = self.diameter // 2
        offset = np.arange(-radius, radius + 1, dtype=np.float32)
        nearness = np.add.outer(offset**2, offset**2).ravel() / np.float32(2 * self.sigma_px**2)
        depth = around(noisy_mm, radius, wanted, 0.0)
        own = fill(noisy_mm, support)[wanted][:, None]
        likeness = (depth - own) ** 2 / np.float32(2 * self.sigma_mm**2)
        # 80: exp(-80) is negligible, and float32 does not underflow there.
        weight = np.exp(-np.minimum(nearness + likeness, np.float32(80)))
        weight *= around(support, radius, wanted, False)
        total, share = (weight * depth).sum(axis=1), weight.sum(axis=1)
        return np.asarray(np.divide(total, share, out=np.zeros_like(total), where=share > 0))


class LocalPolynomial(Masked):
    """The base class of filters that fit a polynomial to valid pixels in a Gaussian window."""

    degree: ClassVar[int]
    sigma_px: float

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Fit the polynomials; return their values at the window centres, (N,) mm."""
        return local_polynomial(noisy_mm, support, wanted, self.sigma_px, self.degree)


@dataclass(frozen=True)
class MaskedGaussian(LocalPolynomial):
    """Gaussian-weighted mean of valid pixels (normalised convolution, Knutsson and Westin 1993)."""

    degree = 0
    sigma_px: float = parameter(1.5, 0.3, 20, "standard deviation of the window")


@dataclass(frozen=True)
class LocalPlane(LocalPolynomial):
    """Plane fitted to the valid pixels in a Gaussian window."""

    degree = 1
    sigma_px: float = parameter(2.0, 0.5, 20, "standard deviation of the window")


@dataclass(frozen=True)
class LocalQuadric(LocalPolynomial):
    """Quadric fitted to the valid pixels in a Gaussian window."""

    degree = 2
    sigma_px: float = parameter(2.5, 0.7, 20, "standard deviation of the window")


@dataclass(frozen=True)
class Guided(Masked):
    """Guided filter (He et al. 2010, OpenCV ximgproc); the guide is the depth with holes filled."""

    radius: int = parameter(3, 1, 30, "radius of the square window, px")
    epsilon_mm: float = parameter(5.0, 0.01, 1000, "depth variations below this are smoothed away")

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Compute smoothed depths; holes get the nearest depth first, to keep edges off 0."""
        filled = fill(noisy_mm, support)
        # Depths relative to the median: ximgproc subtracts squared means in float32.
        centre = np.float32(np.median(noisy_mm[support]))
        image = filled - centre
        smooth = cv2.ximgproc.guidedFilter(image, image, self.radius, self.epsilon_mm**2)
        return np.asarray(smooth[wanted] + centre)


def local_polynomial(
    depth_mm: Depth, support: Mask, wanted: Mask, sigma_px: float, degree: int
) -> Depth:
    """Fit polynomials at the N pixels of ``wanted`` to the pixels of ``support``: (N,) mm, or 0.

    Around each pixel a polynomial in the offsets (u, v), of degree 0, 1 or 2, is fitted by least
    squares, weighted by a Gaussian times the mask; its constant term is the estimate. The normal
    equations need only the sums of w u^p v^q and w u^p v^q z, which are separable convolutions of
    the mask and of the masked depth (Fan and Gijbels 1996; Farnebaeck 2002 for images with
    certainties).
    """
    radius = max(1, math.ceil(_REACH * sigma_px))
    offset = np.arange(-radius, radius + 1) / radius
    bell = np.exp(-0.5 * (offset * radius / sigma_px) ** 2)
    powers = [(p, order - p) for order in range(degree + 1) for p in range(order, -1, -1)]
    mask = support.astype(np.float64)
    middle = float(np.median(depth_mm[support]))
    masked = np.where(support, depth_mm - middle, 0.0)

    def moment(image: Array, p: int, q: int) -> Array:
        row, column = bell * offset**p, bell * offset**q
        full = cv2.sepFilter2D(image, cv2.CV_64F, row, column, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(full[wanted], np.float64)

    needed = {(a + c, b + d) for a, b in powers for c, d in powers}
    weights = {power: moment(mask, *power) for power in needed}
    rows = [np.stack([weights[a + c, b + d] for c, d in powers], -1) for a, b in powers]
    left = np.stack(rows, -2)
    right = np.stack([moment(masked, p, q) for p, q in powers], -1)
    total = weights[0, 0]
    # Without support the sums are 0 up to rounding; the smallest real weight is far larger.
    some = total > 1e-6
    size = len(powers)
    ridge = np.diag([0.0] + [_RIDGE] * (size - 1))
    left = np.where(some[:, None, None], left + total[:, None, None] * ridge, np.eye(size))
    solved = np.linalg.solve(left, right[..., None])[:, 0, 0]
    return np.where(some, np.maximum(solved + middle, 0.0), 0.0).astype(np.float32)


FILTERS = {
    "masked_median": MaskedMedian,
    "masked_bilateral": MaskedBilateral,
    "masked_gaussian": MaskedGaussian,
    "plane": LocalPlane,
    "quadric": LocalQuadric,
    "guided": Guided,
}
GRIDS = {
    "masked_median": {"size": (3, 5, 7, 9)},
    "masked_bilateral": {"sigma_mm": (5.0, 15.0, 40.0), "sigma_px": (1.0, 1.5, 2.0, 3.0)},
    "masked_gaussian": {"sigma_px": (0.7, 1.0, 1.5, 2.0, 3.0)},
    "plane": {"sigma_px": (1.0, 1.5, 2.0, 3.0, 4.0)},
    "quadric": {"sigma_px": (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)},
    "guided": {"radius": (2, 3, 5), "epsilon_mm": (2.0, 5.0, 15.0)},
}
