"""Chessboards in frames: their corners, the pixels of the board, and the plane through them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.compare.frames import SATURATED, DepthFrame
from glsim.errors import DatasetError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Inner corners along the short and the long side: the board that iai_kinect2 calibrates with.
PATTERN = (5, 7)
#: The squares around the inner corners belong to the board: half a square of them is used, whose
#: outer half may be hidden. The corners of 5 x 7 are spread over 4 x 6 squares.
_MARGIN_SQUARES = 0.5
#: Depth beside a printed edge mixes paper and print: so many pixels are left out.
_EDGE_PX = 1
#: Pixels farther from the plane than so many robust standard deviations are no board.
_CLIP, _LEAST_SIGMA_MM, _ROUNDS = 5.0, 0.5, 10
#: A plane needs this many pixels.
LEAST_PIXELS = 200


@dataclass(frozen=True, eq=False)
class Board:
    """The board in one frame. on_plane: (H, W) pixels with depth of board; paper: the white ones.

    Print is dark, and a time-of-flight camera sees dark surfaces some millimetres farther: only the
    paper is a plane for it.
    """

    on_plane: Mask
    paper: Mask
    distance_mm: float


def read_corners(file: Path) -> Array:
    """Read the corners of a board from ``NNNN_ir_points.yaml``, (N, 2) px, row by row."""
    text = file.read_text().partition("[")[2]
    numbers = re.findall(r"[-+]?\d+\.\d*(?:e[-+]?\d+)?", text)
    if len(numbers) % 2 or len(numbers) < 8:
        raise DatasetError(f"{file}: holds no corners of a board (x, y of at least four)")
    return np.array(numbers, float).reshape(-1, 2)


def find_corners(infrared: NDArray[np.float32], pattern: tuple[int, int] = PATTERN) -> Array | None:
    """Find the inner corners of a board in an infrared image, (N, 2) px; None if there is none."""
    lit = infrared[(infrared > 0) & (infrared < SATURATED)]
    if lit.size == 0:
        return None
    # The root of the counts spreads the dark half of the image; the top 0.5 % are reflexes.
    top = float(np.percentile(lit, 99.5))
    image = (255.0 * np.sqrt(np.clip(infrared / top, 0.0, 1.0))).astype(np.uint8)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(image, pattern, flags=flags)
    return np.asarray(corners, np.float64).reshape(-1, 2) if found else None


def board_corners(frame: DepthFrame, folder: Path, pattern: tuple[int, int]) -> Array | None:
    """Return the corners that the recording states beside a frame, else those in its infrared."""
    file = folder / f"{frame.name.removesuffix('_depth')}_ir_points.yaml"
    if file.is_file():
        return read_corners(file)
    return None if frame.infrared is None else find_corners(frame.infrared, pattern)


def find_board(
    frame: DepthFrame, corners_px: Array, pattern: tuple[int, int] = PATTERN
) -> Board | None:
    """Find the pixels of a board with depth; None if the plane has too few of them."""
    centre = corners_px.mean(axis=0)
    grow = 1.0 + 2.0 * _MARGIN_SQUARES / (max(pattern) - 1)
    hull = cv2.convexHull(corners_px.astype(np.float32)).reshape(-1, 2)
    hull = np.rint(centre + grow * (hull - centre)).astype(np.int32)
    inside = np.zeros(frame.depth_mm.shape, np.uint8)
    cv2.fillConvexPoly(inside, hull, 1)
    known = (inside > 0) & np.isfinite(frame.depth_mm)
    if known.sum() < LEAST_PIXELS:
        return None
    residual = plane_residual(frame.depth_mm, frame.rays, known)
    on_plane = known & (np.abs(residual) <= _limit(residual[known]))
    paper = on_plane & _bright(frame, inside > 0)
    if paper.sum() < LEAST_PIXELS:
        return None
    return Board(on_plane, paper, float(np.median(frame.depth_mm[paper])))


def plane_residual(depth_mm: NDArray[np.floating], rays: NDArray[np.floating], part: Mask) -> Array:
    """Fit a plane to the pixels ``part``, all with depth; return (H, W) depth minus plane, mm.

    1 / z of a plane is linear in the rays x/z and y/z; weights z^2 make the residuals millimetres.
    Pixels beyond five robust standard deviations are left out of the fit, again and again.
    """
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
    """Return the paper: brighter than Otsu's threshold, print and its edges left out."""
    if frame.infrared is None:
        return np.ones_like(inside)
    lit = inside & frame.lit
    if not lit.any():
        return np.zeros_like(inside)
    top = float(frame.infrared[lit].max())
    grey = np.clip(255.0 * frame.infrared / top, 0, 255).astype(np.uint8)
    threshold, _ = cv2.threshold(grey[lit][None], 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    side = 2 * _EDGE_PX + 1
    bright = cv2.erode((grey > threshold).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    return np.asarray(bright & lit)
