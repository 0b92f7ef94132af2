"""The filters of Kendrick, Yap and Tan's table 1, to which a hole is a depth of 0.

Parameters are the paper's. OpenCV decides the number types: see each.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from glsim.errors import ConfigError

from ..types import Depth, Mask
from .base import Denoised, parameter


def _with_depth(depth_mm: Depth) -> Denoised:
    return Denoised(depth_mm, depth_mm > 0)


@dataclass(frozen=True)
class Identity:
    """the noisy input itself: the paper's baseline"""

    def __call__(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """The input."""
        return Denoised(noisy_mm, valid)


@dataclass(frozen=True)
class Median:
    """median over a square, holes count as depth 0 (the paper: size=5)"""

    size: int = parameter(5, 3, 5, "side of the window, px: 3 or 5")

    def __post_init__(self) -> None:
        if self.size not in (3, 5):
            raise ConfigError("--denoiser median: OpenCV's 16-bit median has size 3 or 5")

    def __call__(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Float32; on whole millimetres the same as the 16-bit median."""
        return _with_depth(cv2.medianBlur(noisy_mm, self.size))


@dataclass(frozen=True)
class Bilateral:
    """bilateral filter in float32, holes count as depth 0 (the paper: 9, 75, 75)"""

    diameter: int = parameter(9, 3, 31, "diameter of the neighbourhood, px")
    sigma_mm: float = parameter(75.0, 0.1, 8000, "sigmaColor: differences this large count less")
    sigma_px: float = parameter(75.0, 0.1, 500, "sigmaSpace: pixels this far away count less")

    def __call__(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Float32: OpenCV's takes no 16-bit images."""
        return _with_depth(
            cv2.bilateralFilter(noisy_mm, self.diameter, self.sigma_mm, self.sigma_px)
        )


@dataclass(frozen=True)
class NonLocalMeans:
    """non-local means on 16 bits with the L1 norm, holes count as depth 0 (the paper: 30, 7, 21)"""

    strength: float = parameter(30.0, 0.1, 1000, "h, mm")
    template: int = parameter(7, 3, 21, "side of the patches that are compared, px, odd")
    search: int = parameter(21, 3, 61, "side of the area that is searched, px, odd")

    def __call__(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Uint16 in whole millimetres: OpenCV's takes no others, and no L2 norm for them."""
        whole = np.rint(np.clip(noisy_mm, 0, 65535)).astype(np.uint16)
        cleaned = cv2.fastNlMeansDenoising(
            whole, [self.strength], None, self.template, self.search, cv2.NORM_L1
        )
        return _with_depth(cleaned.astype(np.float32))
