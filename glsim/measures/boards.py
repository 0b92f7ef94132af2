"""Chessboards in frames: inner corners, pixels of the board, and the plane through them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from glsim.core.array_types import Array, Floats, Mask, Reals
from glsim.core.depth_frame import DepthFrame
from glsim.measures.measured_frame import SATURATED, lit

#: Inner corners of iai_kinect2's board: number along the short side, number along the long side.
PATTERN = (5, 7)
#: Width of the margin outside the inner corners that counts as board, squares. Chosen: half a
#: square, because the outer half of the outermost squares may be hidden.
_MARGIN_SQUARES = 0.5
#: Pixels at a printed edge mix paper and print; pixels within this distance are left out.
_EDGE_PX = 1
#: Outliers of the plane lie beyond _CLIP robust standard deviations, which are at least
#: _LEAST_SIGMA_MM. The plane is fitted up to _ROUNDS times.
_CLIP, _LEAST_SIGMA_MM, _ROUNDS = 5.0, 0.5, 10
#: Smallest number of pixels for a plane.
LEAST_PIXELS = 200


@dataclass(frozen=True, eq=False)
class Board:
    """White pixels of a chessboard with depth in one frame, (H, W), and their median depth, mm.

    A time-of-flight camera measures dark print some mm too far; only the white paper is plane.
    """

    paper: Mask
    distance_mm: float


def find_corners(infrared: Floats, pattern: tuple[int, int] = PATTERN) -> Array | None:
    """Find the inner corners of a board in an infrared image, (N, 2) px; None without a board."""
    lit = infrared[(infrared > 0) & (infrared < SATURATED)]
    if lit.size == 0:
        return None
    # The square root spreads the dark half of the counts; the brightest 0.5 % are reflections.
    top = float(np.percentile(lit, 99.5))
    image = (255.0 * np.sqrt(np.clip(infrared / top, 0.0, 1.0))).astype(np.uint8)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(image, pattern, flags=flags)
    return np.asarray(corners, np.float64).reshape(-1, 2) if found else None


def find_board(
    frame: DepthFrame, corners_px: Array, pattern: tuple[int, int] = PATTERN
) -> Board | None:
    """Find the pixels of a board with depth; None if too few of them lie on a plane."""
    centre = corners_px.mean(axis=0)
    grow = 1.0 + 2.0 * _MARGIN_SQUARES / (max(pattern) - 1)
    hull = cv2.convexHull(corners_px.astype(np.float32)).reshape(-1, 2)
    hull = np.rint(centre + grow * (hull - centre)).astype(np.int32)
    inside = np.zeros(frame.measured_mm.shape, np.uint8)
    cv2.fillConvexPoly(inside, hull, 1)
    known = (inside > 0) & np.isfinite(frame.measured_mm)
    if known.sum() < LEAST_PIXELS:
        return None
    residual = plane_residual(frame.measured_mm, frame.rays, known)
    on_plane = known & (np.abs(residual) <= _limit(residual[known]))
    paper = on_plane & _bright(frame, inside > 0)
    if paper.sum() < LEAST_PIXELS:
        return None
    return Board(paper, float(np.median(frame.measured_mm[paper])))


def plane_residual(depth_mm: Reals, rays: Reals, part: Mask) -> Array:
    """Fit a robust plane in 1 / z to ``part``, with weights z^2; return (H, W) residuals, mm."""
    z = depth_mm.astype(np.float64)
    design = np.concatenate([np.ones((*z.shape, 1)), rays.astype(np.float64)], axis=-1)
    used = part
    residual = np.full(z.shape, np.nan)
    for _ in range(_ROUNDS):
        weight = z[used] ** 2
        terms, wanted = design[used] * weight[:, None], z[used]
        plane = np.linalg.lstsq(terms, wanted, rcond=None)[0]
        with np.errstate(divide="ignore"):
            residual = z - 1.0 / (design @ plane)
        closer = part & (np.abs(residual) <= _limit(residual[used]))
        if (closer == used).all():
            break
        used = closer
    return residual


def _limit(residual: Array) -> float:
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    return _CLIP * max(spread, _LEAST_SIGMA_MM)


def _bright(frame: DepthFrame, inside: Mask) -> Mask:
    """Mark the white paper: pixels above Otsu's threshold, away from print and edges."""
    if frame.infrared is None:
        return np.ones_like(inside)
    seen = inside & lit(frame)
    if not seen.any():
        return np.zeros_like(inside)
    top = float(frame.infrared[seen].max())
    grey = np.clip(255.0 * frame.infrared / top, 0, 255).astype(np.uint8)
    threshold, _ = cv2.threshold(grey[seen][None], 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    side = 2 * _EDGE_PX + 1
    bright = cv2.erode((grey > threshold).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    return np.asarray(bright & seen)
