"""Compute all metrics of a frame. ``Truth`` holds what all methods of a frame share."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise.interface import Depth, Mask
from glsim.errors import DenoiserError
from glsim.eval.metrics.catalogue import (
    FLYING_MM,
    METRICS,
    NORMAL_DEG,
    PARTS,
    PSNR_MAX_MM,
    SETS,
    STATISTICS,
)
from glsim.eval.metrics.normals import angles_deg, whole_windows
from glsim.eval.metrics.regions import Regions
from glsim.eval.metrics.ssim import Moments, ssim
from glsim.geometry.depth_map import central_normals
from glsim.geometry.edges import BAND_PX, JUMP_MM

_NAN = float("nan")


class Truth:
    """A clean frame and its noisy input, prepared for scoring.

    clean_mm, noisy_mm: (H, W) millimetres, 0 = no depth. rays: (H, W, 2), x/z and y/z.
    regions: the face regions, if known. offset_mm: what was subtracted from both maps; normals are
    those of the surface at its distance from the camera, undefined for NaN (not known).
    """

    def __init__(
        self,
        clean_mm: Depth,
        noisy_mm: Depth,
        rays: NDArray[np.floating],
        regions: Regions | None = None,
        offset_mm: float = 0.0,
    ) -> None:
        self.regions = regions
        self.offset_mm = offset_mm
        self.clean = clean_mm.astype(np.float64)
        self.noisy = noisy_mm.astype(np.float64)
        self.rays = rays
        self.valid: Mask = self.clean > 0
        self.input_valid: Mask = self.noisy > 0
        self.moments = Moments.of(self.clean)
        jumps = jump_edges(self.clean)
        self.edge = edge_band(self.valid, jumps)
        self.parts = {"all": self.valid, "interior": self.valid & ~self.edge, "edge": self.edge}
        self.smooth = whole_windows(self.valid & ~jumps)


def jump_edges(clean: NDArray[np.floating]) -> Mask:
    """Return (H, W) pixels with a row or column neighbour over JUMP_MM nearer or farther."""
    edges = np.zeros(clean.shape, np.bool_)
    for axis in (0, 1):
        first, second = (
            tuple(part if a == axis else slice(None) for a in (0, 1))
            for part in (slice(None, -1), slice(1, None))
        )
        jump = np.abs(clean[second] - clean[first]) > JUMP_MM
        jump &= (clean[first] > 0) & (clean[second] > 0)
        edges[first] |= jump
        edges[second] |= jump
    return edges


def edge_band(valid: Mask, jumps: Mask) -> Mask:
    """Return (H, W) valid pixels at most BAND_PX rows and columns from an invalid pixel or a jump.

    The image border makes no edge: depth beyond it is unknown.
    """
    inside = valid & ~jumps
    # The pixels of a jump belong to the band, an invalid pixel does not: hence BAND_PX - 1.
    near_hole = cv2.erode(valid.astype(np.uint8), _square(BAND_PX)) == 0
    near_jump = cv2.erode(inside.astype(np.uint8) | ~valid, _square(BAND_PX - 1)) == 0
    band: Mask = valid & (near_hole | near_jump)
    return band


def _square(radius: int) -> NDArray[np.uint8]:
    return np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)


def check_prediction(prediction: NDArray[np.generic], shape: tuple[int, ...]) -> Depth:
    """Return a prediction as float32 (H, W).

    Raises DenoiserError for another shape or dtype, values that are not finite, and negative ones.
    """
    if prediction.shape != shape:
        raise DenoiserError(f"returned depth of shape {prediction.shape} instead of {shape}")
    if prediction.dtype.kind not in "fiu":
        raise DenoiserError(f"returned depth of type {prediction.dtype} instead of numbers")
    depth: Depth = prediction.astype(np.float32)
    if not np.isfinite(depth).all():
        raise DenoiserError(
            f"returned {int((~np.isfinite(depth)).sum())} depths that are no number"
        )
    if (depth < 0).any():
        raise DenoiserError(f"returned {int((depth < 0).sum())} negative depths")
    return depth


def score(prediction_mm: NDArray[np.generic], truth: Truth) -> dict[str, float]:
    """Compute all metrics but the time, by name; region columns last; NaN where undefined.

    prediction_mm: (H, W) millimetres, 0 = no depth. Raises DenoiserError as ``check_prediction``.
    """
    prediction = check_prediction(prediction_mm, truth.clean.shape).astype(np.float64)
    valid = prediction > 0
    error = prediction - truth.clean
    result = _paper(prediction, valid, error, truth) | _validity(valid, error, truth)
    base = {"both": valid & truth.valid, "input": truth.input_valid & truth.valid}
    per_region: dict[str, float] = {}
    for name in SETS:
        for part, (suffix, _) in PARTS.items():
            pixels = base[name] & truth.parts[part]
            errors = error[pixels]
            if name == "input":
                fallback = truth.noisy[pixels] - truth.clean[pixels]
                errors = np.where(valid[pixels], errors, fallback)
            result |= _errors(f"{name}{suffix}", errors)
            if truth.regions is not None and (name, part) == ("input", "interior"):
                per_region = truth.regions.errors(errors, pixels)
    result |= _errors("filled", error[base["both"] & ~truth.input_valid])
    at, angle = _angles(prediction, valid, truth)
    result |= _normals(angle)
    if truth.regions is not None:
        per_region |= truth.regions.angles(angle, at)
    return {name: result[name] for name in METRICS if name in result} | per_region


def _paper(
    prediction: NDArray[np.float64], valid: Mask, error: NDArray[np.float64], truth: Truth
) -> dict[str, float]:
    squared = error * error
    mse = float(squared.mean())
    in_flips = float(squared[valid != truth.valid].sum()) / squared.size
    similar = ssim(truth.moments, Moments.of(prediction))
    return {
        "mse_mm2": mse,
        "psnr_db": psnr_db(mse),
        "mse_flips_pct": 100.0 * in_flips / mse if mse > 0 else _NAN,
        **{f"ssim_{name}": value for name, value in similar.items()},
    }


def psnr_db(mse_mm2: float) -> float:
    """Compute the PSNR for MAX = PSNR_MAX_MM, dB; NaN for an MSE of 0, where it is undefined."""
    return 10.0 * math.log10(PSNR_MAX_MM**2 / mse_mm2) if mse_mm2 > 0 else _NAN


def _share(part: int, whole: int) -> float:
    return part / whole if whole else _NAN


def _validity(valid: Mask, error: NDArray[np.float64], truth: Truth) -> dict[str, float]:
    both = valid & truth.valid
    hits, predicted, real = (int(np.count_nonzero(m)) for m in (both, valid, truth.valid))
    either = predicted + real - hits
    off = int(np.count_nonzero(np.abs(error[both]) > FLYING_MM))
    return {
        "iou": _share(hits, either),
        "precision": _share(hits, predicted),
        "recall": _share(hits, real),
        "flips_px": float(either - hits),
        "flying_px": float(off + predicted - hits),
    }


def _errors(name: str, error: NDArray[np.float64]) -> dict[str, float]:
    """Compute STATISTICS of (N,) errors in mm, NaN without errors."""
    if error.size == 0:
        return {f"{name}_{key}_mm": _NAN for key in STATISTICS}
    size = np.abs(error)
    median, p95 = np.percentile(size, [50, 95])
    values = {
        "rmse": math.sqrt(float((error * error).mean())),
        "mae": float(size.mean()),
        "median": float(median),
        "p95": float(p95),
        "bias": float(error.mean()),
    }
    return {f"{name}_{key}_mm": values[key] for key in STATISTICS}


def _angles(
    prediction: NDArray[np.float64], valid: Mask, truth: Truth
) -> tuple[Mask, NDArray[np.float64]]:
    """Return the N pixels where both maps have a normal, (H, W), and (N,) angles in degrees."""
    at = truth.smooth & whole_windows(valid) & math.isfinite(truth.offset_mm)
    first, second = (
        central_normals(depth + truth.offset_mm, truth.rays, at)
        for depth in (prediction, truth.clean)
    )
    return at, angles_deg(first, second)


def _normals(angle: NDArray[np.float64]) -> dict[str, float]:
    """Compute the normal metrics of (N,) angles in degrees, NaN without angles."""
    if not angle.size:
        return dict.fromkeys(("normal_mean_deg", "normal_median_deg", "normal_good_pct"), _NAN)
    return {
        "normal_mean_deg": float(angle.mean()),
        "normal_median_deg": float(np.median(angle)),
        "normal_good_pct": 100.0 * float((angle < NORMAL_DEG).mean()),
    }
