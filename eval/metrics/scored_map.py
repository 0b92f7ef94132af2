"""A predicted map with its clean frame, and what several metrics need of them, computed once."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth, Mask
from glsim.core.depth_map import JUMP_MM, central_normals, dilated, interior, jumps
from glsim.core.errors import DenoiserError
from glsim.eval.metrics.regions import Regions
from glsim.eval.metrics.ssim import Moments, ssim
from glsim.measures.stacks import eroded

#: Largest distance of a pixel "beside holes" from a hole of the input in a surface, px. Chosen.
BESIDE_PX: Final = 3
#: Signal maximum MAX in the PSNR of the paper, mm.
PSNR_MAX_MM: Final = 8000.0


class Truth:
    """A clean frame and its noisy input, prepared for scoring.

    Args:
        clean_mm, noisy_mm: (H, W) millimetres, 0 = no depth.
        rays: (H, W, 2), x/z and y/z of each pixel.
        offset_mm: depth that was subtracted from both maps, NaN = unknown. It is added again to
            compute normals; they are undefined without it.
    """

    def __init__(
        self, clean_mm: Depth, noisy_mm: Depth, rays: NDArray[np.floating],
        regions: Regions | None = None, offset_mm: float = 0.0,
    ) -> None:  # fmt: skip
        self.regions = regions
        self.offset_mm = offset_mm
        self.clean = clean_mm.astype(np.float64)
        self.noisy = noisy_mm.astype(np.float64)
        self.rays = rays
        self.valid: Mask = self.clean > 0
        self.input_valid: Mask = self.noisy > 0
        self.moments = Moments.of(self.clean)
        jumping = jumps(self.clean)
        inside = interior(self.valid, jumping)
        beside = dilated(self.valid & ~self.input_valid, BESIDE_PX) > 0
        self.parts = {
            "all": self.valid,
            "interior": inside,
            "edge": self.valid & ~inside,
            "beside_holes": inside & beside,
        }
        #: Outermost pixels of surfaces: a neighbour has no depth or is farther by a step.
        filled = np.where(self.valid, self.clean, 2 * self.clean.max(initial=0) + 2 * JUMP_MM)
        self.ring: Mask = cv2.dilate(filled, np.ones((3, 3))) - filled > JUMP_MM
        self.smooth = eroded(self.valid & ~jumping, 1)


class ScoredMap:
    """A predicted depth map with the clean frame that it is scored against.

    Raises DenoiserError: the prediction has another shape, or depth that is negative or NaN.

    ``prediction_mm``: (H, W) millimetres, 0 = no depth.
    """

    def __init__(self, prediction_mm: NDArray[np.generic], truth: Truth) -> None:
        self.truth = truth
        shape, kind = truth.clean.shape, prediction_mm.dtype
        if prediction_mm.shape != shape or kind.kind not in "fiu":
            raise DenoiserError(
                f"returned depth of shape {prediction_mm.shape} and type {kind} for {shape}"
            )
        self.depth = prediction_mm.astype(np.float32).astype(np.float64)
        if bad := int((~(np.isfinite(self.depth) & (self.depth >= 0))).sum()):
            raise DenoiserError(f"returned {bad} depths that are negative or no number")
        self.valid: Mask = self.depth > 0
        self.error = self.depth - truth.clean
        self._statistics: dict[tuple[str, str], dict[str, float]] = {}

    @cached_property
    def squared(self) -> NDArray[np.float64]:
        """(H, W) squared errors, mm²; a pixel without depth counts as depth 0."""
        return self.error * self.error

    @cached_property
    def mse_mm2(self) -> float:
        """The mean squared error over all pixels."""
        return float(self.squared.mean())

    @cached_property
    def ssim(self) -> dict[str, float]:
        """Structural similarity for each preset of constants: preset name -> mean SSIM."""
        return ssim(self.truth.moments, Moments.of(self.depth))

    @cached_property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of valid pixels: in both maps, in the prediction, and in the clean map."""
        both = int(np.count_nonzero(self.valid & self.truth.valid))
        return both, int(np.count_nonzero(self.valid)), int(np.count_nonzero(self.truth.valid))

    @cached_property
    def flips(self) -> int:
        """Number of pixels that are valid in exactly one of the two maps."""
        hits, predicted, real = self.counts
        return predicted + real - 2 * hits

    def errors(self, base: str, part: str) -> tuple[NDArray[np.float64], Mask]:
        """Select a set of pixels and return its (N,) errors, mm, and its (H, W) mask.

        Args:
            base: "both": prediction and clean map are valid. "filled": both are valid, the input is
                not. "input": input and clean map are valid; a missing prediction has the error of
                the input.
            part: a name of ``Truth.parts``.
        """
        truth = self.truth
        valid = truth.input_valid if base == "input" else self.valid
        pixels = valid & truth.valid & truth.parts[part]
        if base == "filled":
            pixels &= ~truth.input_valid
        errors = self.error[pixels]
        if base == "input":
            fallback = truth.noisy[pixels] - truth.clean[pixels]
            errors = np.where(self.valid[pixels], errors, fallback)
        return errors, pixels

    def statistics(self, base: str, part: str) -> dict[str, float]:
        """Compute RMSE, mean error, and mean, median, 95th percentile of |error| of a set, mm."""
        if (base, part) not in self._statistics:
            error, _ = self.errors(base, part)
            self._statistics[base, part] = error_statistics(error)
        return self._statistics[base, part]

    @cached_property
    def angles(self) -> tuple[NDArray[np.float64], Mask]:
        """(N,) angles between predicted and clean normals, degrees, and their (H, W) mask."""
        truth = self.truth
        at = truth.smooth & eroded(self.valid, 1) & math.isfinite(truth.offset_mm)
        first, second = (
            central_normals(depth + truth.offset_mm, truth.rays, at)
            for depth in (self.depth, truth.clean)
        )
        return angles_deg(first, second), at


def error_statistics(error: NDArray[np.float64]) -> dict[str, float]:
    """Compute the statistics of (N,) errors in mm by name; NaN for an empty array."""
    if error.size == 0:
        return dict.fromkeys(("rmse", "mae", "median", "p95", "bias"), math.nan)
    size = np.abs(error)
    median, p95 = np.percentile(size, [50, 95])
    return {
        "rmse": math.sqrt(float((error * error).mean())),
        "mae": float(size.mean()),
        "median": float(median),
        "p95": float(p95),
        "bias": float(error.mean()),
    }


def psnr_db(mse_mm2: float) -> float:
    """Compute the PSNR, dB, for a maximum of PSNR_MAX_MM; NaN (undefined) for an MSE of 0."""
    return 10.0 * math.log10(PSNR_MAX_MM**2 / mse_mm2) if mse_mm2 > 0 else math.nan


def angles_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute (N,) angles in degrees between (N, 3) vectors; accurate for small angles too."""
    x1, y1, z1 = first.T
    x2, y2, z2 = second.T
    cross = (y1 * z2 - z1 * y2) ** 2 + (z1 * x2 - x1 * z2) ** 2 + (x1 * y2 - y1 * x2) ** 2
    return np.asarray(np.degrees(np.arctan2(np.sqrt(cross), x1 * x2 + y1 * y2 + z1 * z2)))
