"""Measures of a denoiser on one real frame, without clean truth: sums of five measures.

A pixel is lost if the denoiser removes its depth or moves it by half of the smallest depth step of
a silhouette. Lost pixels are counted. Measures of surfaces use the input's depth for them, so that
a few lost pixels do not dominate the mean.
"""

from __future__ import annotations

from itertools import product
from typing import Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Depth, Mask
from glsim.core.depth_frame import DepthFrame
from glsim.core.units import MM_PER_M
from glsim.data.recordings.opencv_yaml import board_corners
from glsim.eval.real_frames.halves import SplitRecording
from glsim.measures.boards import find_board, plane_residual
from glsim.measures.depth_noise import still_difference
from glsim.measures.measured_frame import surface_mm, surfaces
from glsim.measures.silhouettes import STEP_MM, find_edges

#: Bounds of the distance bins of all tables, m. The values were chosen, not measured.
BINS_M: Final = (0.05, 0.15, 0.3, 0.5, 0.65, 0.9, 1.2, 1.5, 2.6, 4.4)
_BINS: Final = len(BINS_M) - 1
#: The shift is reported in bins of distance that start at 0 m: width of a bin, mm; number of bins.
SHIFT_BIN_MM: Final = 100
SHIFT_BINS: Final = int(MM_PER_M * BINS_M[-1] / SHIFT_BIN_MM)
#: A pixel whose depth changes by more than this is lost, mm.
_LOST_MM: Final = STEP_MM / 2
#: Planes are searched in tiles of this side, px. All constants of the search were chosen.
#: _LEAST_SHARE: smallest share of a tile's pixels on its plane.
#: _OUTLIER, _ROUNDS: pixels with a residual above 4.4 medians (3 sigma) are removed, three times.
#: _STRAIGHT: smallest ratio of a quadric's residual to the plane's; below it, the tile is curved.
#: _ROUGHEST: largest residual of 1 / depth, 1/mm, where a stereo camera's noise is even. Measured
#: medians: D435 2.6e-6 to 5.7e-6, TrueDepth 7.7e-6; clutter before a Kinect V2 from 1.4e-5 on.
_TILE_PX: Final = 48
_LEAST_SHARE, _OUTLIER, _ROUNDS, _STRAIGHT, _ROUGHEST = 0.85, 4.4, 3, 0.95, 1.2e-5
#: A pixel is alone if fewer than this number of its eight neighbours have depth.
_COMPANY: Final = 3
#: Names of the sums in ``Tally.edges``, in order.
EDGE_SUMS: Final = (
    "ring_1", "ring_1_lost", "ring_2", "ring_2_lost", "shadow", "shadow_filled",
    "surface", "surface_lost", "alone", "alone_filled", "pinholes", "frames",
)  # fmt: skip


class Tally(NamedTuple):
    """Sums of the measures of one denoised map; the last axis is (number of pixels, sum).

    Attributes:
        pair: (units, bins, 2) squared error on static pairs, by distance bin of BINS_M.
        paper: (bins, 2) squared residuals of the board's paper from its plane.
        shift: (SHIFT_BINS, 2) shift of smooth surfaces, in bins of 100 mm.
        planes: (bins, 2) squared residuals of walls and table tops from fitted planes.
        edges: (len(EDGE_SUMS),) numbers of pixels.
    """

    pair: Array
    paper: Array
    shift: Array
    planes: Array
    edges: Array


class FrameTruth:
    """The pixels of one raw frame on which all methods are measured."""

    def __init__(self, recording: SplitRecording, number: int, pairs_only: bool = False) -> None:
        """Find the pixels of frame ``number``; with ``pairs_only``, only those of static pairs."""
        frame = self.frame = recording.frames[number]
        self._pairs_only = pairs_only
        self._units, self._unit_count = recording.units(number), recording.unit_count
        self.partner: DepthFrame | None = None
        if (other := recording.partner.get(number)) is not None:
            self.partner = recording.frames[other]
            self._difference = still_difference(frame, self.partner)
        self.board = None
        if pairs_only:
            return
        source = recording.source
        corners = board_corners(frame, source.path, source.pattern)
        if corners is not None:
            self.board = find_board(frame, corners, source.pattern)
        self._rims = rims_and_shadow(frame)
        self._tiles = find_planes(frame.measured_mm)

    def tally(self, denoised_mm: Depth) -> Tally:
        """Measure a denoised map, (H, W) mm with 0 = no depth."""
        raw = self.frame.measured_mm.astype(np.float64)
        filled = np.where(self._lost(denoised_mm), raw, denoised_mm).astype(np.float64)
        moved = filled - raw
        shift, planes = np.zeros((SHIFT_BINS, 2)), np.zeros((_BINS, 2))
        edges = np.zeros(len(EDGE_SUMS))
        if not self._pairs_only:
            at_mm = surface_mm(self.frame)
            used = surfaces(self.frame).smooth & (distance_bin(at_mm) >= 0)
            numbers = (at_mm[used] / SHIFT_BIN_MM).astype(np.int64)
            shift, planes = _sums(numbers, moved[used], SHIFT_BINS), self._planes(filled)
            edges = self.edge_sums(denoised_mm)
        return Tally(self._pair(moved), self._paper(filled), shift, planes, edges)

    def _pair(self, moved: Array) -> Array:
        """Sum (denoised - partner)^2 minus the noise variance of the partner frame.

        The variance is half of (raw - partner)^2, because the noise of two frames is independent.
        """
        if self.partner is None:
            return np.zeros((self._unit_count, _BINS, 2))
        squares = (moved - self._difference) ** 2 - 0.5 * self._difference**2
        bins = distance_bin(self.frame.measured_mm)
        known = np.isfinite(self._difference) & (bins >= 0)
        key = self._units[known] * _BINS + bins[known]
        return _sums(key, squares[known], self._unit_count * _BINS).reshape(-1, _BINS, 2)

    def _paper(self, filled: Array) -> Array:
        sums = np.zeros((_BINS, 2))
        if self.board is not None and (number := int(distance_bin(self.board.distance_mm))) >= 0:
            paper = self.board.paper
            residual = plane_residual(filled, self.frame.rays, paper)[paper]
            sums[number] = residual.size, (residual**2).sum()
        return sums

    def _planes(self, filled: Array) -> Array:
        """Return pixels and squared residuals, mm^2, of planes fitted to tiles, by distance.

        Planes show errors that are equal in each frame, as of stereo cameras; static pairs do not.
        """
        sums = np.zeros((_BINS, 2))
        for tile, inliers in self._tiles:
            depth = filled[tile][inliers]
            number = int(distance_bin(float(np.median(depth))))
            if number >= 0:
                residual = depth - 1 / _fitted(1 / depth, np.nonzero(inliers), 1)
                sums[number] += depth.size, float(residual @ residual)
        return sums

    def edge_sums(self, other_mm: Depth) -> Array:
        """Count the pixels listed in EDGE_SUMS for a map, (H, W) mm with 0 = no depth."""
        first, second, shadow = self._rims
        lost, valid = self._lost(other_mm), other_mm > 0
        raw_valid, surface = np.isfinite(self.frame.measured_mm), surfaces(self.frame).smooth
        company = _neighbours(valid)
        alone = valid & (company < _COMPANY)
        pinholes = raw_valid & ~valid & (company > 8 - _COMPANY)
        masks = (
            first, first & lost, second, second & lost, shadow, shadow & valid,
            surface, surface & lost, alone, alone & ~raw_valid, pinholes,
        )  # fmt: skip
        return np.array([*(np.count_nonzero(mask) for mask in masks), 1], np.float64)

    def _lost(self, other_mm: Depth) -> Mask:
        raw = self.frame.measured_mm
        moved = (other_mm <= 0) | (np.abs(other_mm - raw) > _LOST_MM)
        return np.asarray(np.isfinite(raw) & moved, np.bool_)


def find_planes(depth_mm: NDArray[np.floating]) -> list[tuple[tuple[slice, slice], Mask]]:
    """Return the tiles of a raw map that show one plane, and their pixels without outliers.

    Planes are fitted to 1/depth, which is linear on them. Outliers are removed in several rounds. A
    tile that a quadric fits better is left out.
    """
    planes = []
    height, width = depth_mm.shape
    corners = product(*(range(0, size - _TILE_PX + 1, _TILE_PX) for size in (height, width)))
    for top, left in corners:
        tile = slice(top, top + _TILE_PX), slice(left, left + _TILE_PX)
        depth = depth_mm[tile].astype(np.float64)
        inliers = np.isfinite(depth) & (depth > 0)
        for _ in range(_ROUNDS):
            if inliers.mean() < _LEAST_SHARE:
                break
            pixels = np.nonzero(inliers)
            nearness = 1 / depth[pixels]
            off = np.abs(nearness - _fitted(nearness, pixels, 1))
            inliers[pixels] = off <= _OUTLIER * max(float(np.median(off)), 1e-12)
        if inliers.mean() < _LEAST_SHARE:
            continue
        pixels = np.nonzero(inliers)
        nearness = 1 / depth[pixels]
        flat, bent = (float(np.std(nearness - _fitted(nearness, pixels, n))) for n in (1, 2))
        if bent > _STRAIGHT * flat and flat <= _ROUGHEST:
            planes.append((tile, inliers))
    return planes


def _fitted(values: Array, pixels: tuple[NDArray[np.intp], ...], degree: Literal[1, 2]) -> Array:
    """Fit a polynomial in row and column to the values of pixels; return the fitted values."""
    row, column = (axis / _TILE_PX - 0.5 for axis in pixels)
    terms = [np.ones_like(row), row, column]
    terms += [row * row, row * column, column * column] if degree == 2 else []
    design = np.stack(terms, axis=1)
    return np.asarray(design @ np.linalg.lstsq(design, values, rcond=None)[0])


def distance_bin(depth_mm: NDArray[np.floating] | float) -> NDArray[np.int64]:
    """Return the index of the bin of BINS_M for each depth; -1 outside all bins and for NaN."""
    bins = np.digitize(np.nan_to_num(depth_mm), MM_PER_M * np.array(BINS_M)) - 1
    return np.where(bins < _BINS, bins, -1)


def rims_and_shadow(frame: DepthFrame) -> tuple[Mask, Mask, Mask]:
    """Mark the first and second pixel of foregrounds along rows, and the holes beside them."""
    shape = frame.measured_mm.shape
    first, second, gap = (np.zeros(shape, np.bool_) for _ in range(3))
    edges = find_edges(frame)
    for side, row, column, width in zip(
        edges.side, edges.row, edges.column, edges.width.astype(int), strict=True
    ):
        inwards = -1 if side else 1
        first[row, column] = second[row, column + inwards] = True
        start = column + 1 if side else column - width
        gap[row, start : start + width] = True
    return first, second & ~first, gap & ~np.isfinite(frame.measured_mm)


def _neighbours(valid: Mask) -> NDArray[np.int64]:
    """Count the eight neighbours that have depth; pixels outside the image have none."""
    image, border = valid.astype(np.float32), cv2.BORDER_CONSTANT
    counted = cv2.boxFilter(image, -1, (3, 3), normalize=False, borderType=border)
    return np.rint(counted).astype(np.int64) - valid


def _sums(key: NDArray[np.int64], values: Array, size: int) -> Array:
    """Compute the number and the sum of the values of each key: (size, 2)."""
    return np.stack([np.bincount(key, weights, size) for weights in (None, values)], axis=-1)
