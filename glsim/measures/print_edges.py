"""Depth and light beside printed edges of a chessboard: how a camera spreads light, and how late.

Paper and print of a board lie in one plane, so that depth that differs from the paper's plane is an
error by reflectivity. Beside an edge it shows what reaches a pixel from its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.measures.boards import PATTERN, find_board, find_corners, plane_residual
from glsim.measures.frame import DepthFrame

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Bounds of the classes of the distance from an edge, px; chosen: nothing changes beyond 4.
DISTANCES_PX = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
#: Pixels of a class that a frame needs, and largest distance of the corners from a lattice, px.
_LEAST_PX, _CROOKED_PX = 20, 1.0


@dataclass(frozen=True, eq=False)
class PrintEdges:
    """Medians over the frames for each class of ``DISTANCES_PX``; (N,) arrays, NaN without pixels.

    Attributes:
        frames: with a board.
        print_error_mm: depth of print minus the paper's plane, mm.
        paper_error_mm: the same of paper.
        print_light: infrared of print over that of paper far from edges.
        paper_light: the same of paper.

    """

    frames: int
    print_error_mm: Array
    paper_error_mm: Array
    print_light: Array
    paper_light: Array


def measure_print_edges(frames: Sequence[DepthFrame]) -> PrintEdges:
    """Measure all frames with infrared that show the board of ``boards.PATTERN``."""
    rows = []
    for frame in frames:
        found = _measure(frame)
        if found is not None:
            rows.append(found)
    if not rows:
        return PrintEdges(0, *np.full((4, len(DISTANCES_PX) - 1), np.nan))
    stack = np.array(rows)
    known = np.isfinite(stack).any(axis=0)
    medians = np.full(known.shape, np.nan)
    medians[known] = np.nanmedian(stack[:, known], axis=0)
    return PrintEdges(len(rows), *medians)


def _measure(frame: DepthFrame) -> Array | None:
    """Return (4, N) error of print and paper, mm, and their light; None without a board."""
    corners = None if frame.infrared is None else find_corners(frame.infrared)
    board = None if corners is None else find_board(frame, corners)
    if corners is None or board is None:
        return None
    place = _place_on_board(frame.depth_mm.shape, corners)
    if place is None:
        return None
    across, down, square_px = place
    inside = (across > -0.5) & (across < PATTERN[0] - 0.5)
    inside &= (down > -0.5) & (down < PATTERN[1] - 0.5)
    away = square_px * np.minimum(np.abs(across - np.rint(across)), np.abs(down - np.rint(down)))
    odd = (np.floor(across) + np.floor(down)).astype(np.int64) % 2 == 1
    assert frame.infrared is not None
    light = frame.infrared.astype(np.float64)
    middle = inside & (away > 0.25 * square_px)
    of_odd, of_even = (float(np.median(light[middle & kind])) for kind in (odd, ~odd))
    is_print = odd if of_odd < of_even else ~odd
    error = plane_residual(frame.depth_mm, frame.rays, board.paper)
    light /= max(of_odd, of_even)
    classes = np.digitize(away, DISTANCES_PX) - 1
    out = np.full((4, len(DISTANCES_PX) - 1), np.nan)
    for k in range(out.shape[1]):
        for row, kind in ((0, is_print), (1, ~is_print)):
            used = inside & kind & (classes == k) & np.isfinite(frame.depth_mm)
            if used.sum() >= _LEAST_PX:
                out[row, k], out[row + 2, k] = np.median(error[used]), np.median(light[used])
    return out


def _place_on_board(shape: tuple[int, int], corners_px: Array) -> tuple[Array, Array, float] | None:
    """Return each pixel's place in squares across and down, and a square's size in px.

    None if the corners are no lattice.
    """
    columns, rows = PATTERN
    lattice = np.array([(x, y) for y in range(rows) for x in range(columns)], np.float64)
    to_image = cv2.findHomography(lattice, corners_px)[0]
    if to_image is None:
        return None
    again = cv2.perspectiveTransform(lattice[None], to_image)[0]
    if np.abs(again - corners_px).mean() > _CROOKED_PX:
        return None
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    pixels = np.stack([x.ravel(), y.ravel()], axis=-1)[None]
    squares = cv2.perspectiveTransform(pixels, np.linalg.inv(to_image))[0].reshape(*shape, 2)
    grid = corners_px.reshape(rows, columns, 2)
    square_px = float(np.median(np.linalg.norm(np.diff(grid, axis=1), axis=-1)))
    return squares[..., 0], squares[..., 1], square_px
