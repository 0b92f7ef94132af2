"""The filters of table 1 of Kendrick, Yap and Tan, in which a hole counts as depth 0.

Parameters are the paper's. OpenCV dictates the dtype of each filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from glsim.core.array_types import Depth, Mask
from glsim.core.errors import ConfigError
from glsim.denoise.filters.frame_filter import FrameFilter
from glsim.denoise.parameters import parameter
from glsim.networks.interface import Denoised


def _with_depth(image_mm: cv2.typing.MatLike) -> Denoised:
    depth_mm = np.asarray(image_mm, np.float32)
    return Denoised(depth_mm, depth_mm > 0)


@dataclass(frozen=True)
class Unchanged(FrameFilter):
    """The noisy input itself, the paper's baseline."""

    def filtered(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Return the input unchanged."""
        return Denoised(noisy_mm, valid)


@dataclass(frozen=True)
class Median(FrameFilter):
    """Median over a square; holes count as depth 0 (the paper: size=5)."""

    size: int = parameter(5, 3, 5, "side of the window, px: 3 or 5")

    def __post_init__(self) -> None:
        if self.size not in (3, 5):
            raise ConfigError("denoiser median: OpenCV's 16-bit median has size 3 or 5")

    def filtered(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Filter in float32, which on whole millimetres equals the 16-bit median."""
        return _with_depth(cv2.medianBlur(noisy_mm, self.size))


@dataclass(frozen=True)
class Bilateral(FrameFilter):
    """Bilateral filter in float32; holes count as depth 0 (the paper: 9, 75, 75)."""

    diameter: int = parameter(9, 3, 31, "diameter of the neighbourhood, px")
    sigma_mm: float = parameter(
        75.0, 0.1, 8000, "sigmaColor: standard deviation of the depth weight"
    )
    sigma_px: float = parameter(
        75.0, 0.1, 500, "sigmaSpace: standard deviation of the distance weight"
    )

    def filtered(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Filter in float32, because OpenCV's filter takes no 16-bit images."""
        smooth = cv2.bilateralFilter(noisy_mm, self.diameter, self.sigma_mm, self.sigma_px)
        return _with_depth(smooth)


@dataclass(frozen=True)
class NonLocalMeans(FrameFilter):
    """Non-local means on 16 bits (L1 norm); holes count as depth 0 (the paper: 30, 7, 21)."""

    strength: float = parameter(30.0, 0.1, 1000, "h, mm")
    template: int = parameter(7, 3, 21, "side of the compared patches, px, odd")
    search: int = parameter(21, 3, 61, "side of the search window, px, odd")

    def filtered(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Filter whole mm in uint16, since OpenCV's filter takes no float depth."""
        whole = np.rint(np.clip(noisy_mm, 0, 65535)).astype(np.uint16)
        cleaned = cv2.fastNlMeansDenoising(
            whole, [self.strength], None, self.template, self.search, cv2.NORM_L1
        )
        return _with_depth(cleaned)


FILTERS = {"noisy": Unchanged, "median": Median, "bilateral": Bilateral, "nlm": NonLocalMeans}
