"""What one real frame tells about a denoiser: four measures, prepared from the raw frame.

``FrameTruth`` holds the pixels, the same for every method; its ``tally`` returns sums that
``glsim.eval.real_frames.results`` adds up. A pixel is lost if its depth is gone or has moved by
half of the least step of a silhouette. Lost pixels are counted, and keep the input's depth in the
measures of surfaces; otherwise a few would dominate the mean.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.boards import Board, plane_residual
from glsim.bench.measures.frame import surface_mm, surfaces
from glsim.bench.measures.silhouettes import STEP_MM, find_edges
from glsim.bench.measures.temporal import still_difference
from glsim.core.depth_frame import DepthFrame
from glsim.denoise.interface import Depth, Mask

Array = NDArray[np.float64]
#: Sums by (measure, unit, bin): "pair", "paper", "board", "shift" (pixels, sums), "edges".
Tally = dict[tuple[str, int, int], tuple[float, ...]]

#: Bounds of the distances of tables, m; chosen.
BINS_M: Final = (0.5, 0.65, 0.9, 1.2, 1.5, 2.6, 4.4)
#: Width of the bins of the shift, mm.
SHIFT_BIN_MM: Final = 100
#: Largest movement of a pixel that is kept, mm.
_LOST_MM: Final = STEP_MM / 2
#: Least neighbours with depth, of eight, of a pixel that is not alone.
_COMPANY: Final = 3
#: Names of the sums of edges, in order.
EDGE_SUMS: Final = (
    "ring_1", "ring_1_lost", "ring_2", "ring_2_lost", "shadow", "shadow_filled",
    "surface", "surface_lost", "alone", "alone_filled", "pinholes", "frames",
)  # fmt: skip


def distance_bin(depth_mm: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return the bin of BINS_M of each depth, -1 outside and for NaN."""
    place = np.digitize(np.nan_to_num(depth_mm), 1000.0 * np.array(BINS_M)) - 1
    return np.where(place < len(BINS_M) - 1, place, -1)


class FrameTruth:
    """The pixels of all measures of one frame."""

    def __init__(
        self,
        frame: DepthFrame,
        partner: DepthFrame | None = None,
        units: NDArray[np.int64] | None = None,
        board: Board | None = None,
        pairs_only: bool = False,
    ) -> None:
        """Prepare the measures.

        Args:
            frame: the raw frame.
            partner: another frame of the same static scene.
            units: (H, W) unit of each pixel.
            board: of the frame.
            pairs_only: measure the static pair alone, for tuning.

        """
        self.frame, self._partner, self._units = frame, partner, units
        self._pairs_only = pairs_only
        self._difference = None if partner is None else still_difference(frame, partner)
        self._bins = distance_bin(frame.measured_mm)
        self._board = None if pairs_only else board
        self._rims = None if pairs_only else rims_and_shadow(frame)

    def tally(self, denoised_mm: Depth) -> Tally:
        """Measure a denoised map, (H, W) mm, 0 = no depth."""
        result: Tally = {}
        raw = self.frame.measured_mm.astype(np.float64)
        lost = lost_pixels(self.frame.measured_mm, denoised_mm)
        filled = np.where(lost, raw, denoised_mm).astype(np.float64)
        moved = filled - raw
        result |= self._pair(moved)
        if self._pairs_only:
            return result
        result |= self._plane(filled, moved) | self._shift(moved)
        return result | self._edges(denoised_mm > 0, lost)

    def _pair(self, moved: Array) -> Tally:
        """Sum (denoised - partner)^2, less the partner's own variance.

        The noise of two frames is independent, so that half of (raw - partner)^2 is the variance of
        one, for any law and correlation.
        """
        if self._difference is None or self._units is None:
            return {}
        squares = (moved - self._difference) ** 2 - 0.5 * self._difference**2
        result: Tally = {}
        known = np.isfinite(self._difference) & (self._bins >= 0)
        key = self._units[known] * len(BINS_M) + self._bins[known]
        for code, (count, total) in _grouped(key, squares[known]).items():
            result["pair", *divmod(code, len(BINS_M))] = (count, total)
        return result

    def _plane(self, filled: Array, moved: Array) -> Tally:
        if self._board is None:
            return {}
        result: Tally = {}
        place = int(distance_bin(np.array(self._board.distance_mm)))
        if place < 0:
            return {}
        for name, part in (("paper", self._board.paper), ("board", self._board.on_plane)):
            residual = plane_residual(filled, self.frame.rays, part)[part]
            sums = float(part.sum()), float((residual**2).sum()), float(moved[part].sum())
            result[name, 0, place] = sums
        return result

    def _shift(self, moved: Array) -> Tally:
        at_mm = surface_mm(self.frame)
        near, far = 1000 * BINS_M[0], 1000 * BINS_M[-1]
        used = surfaces(self.frame).smooth & (at_mm >= near) & (at_mm < far)
        key = (at_mm[used] / SHIFT_BIN_MM).astype(np.int64)
        return {("shift", 0, code): sums for code, sums in _grouped(key, moved[used]).items()}

    def _edges(self, valid: Mask, lost: Mask) -> Tally:
        if self._rims is None:
            return {}
        first, second, shadow = self._rims
        raw_valid, surface = np.isfinite(self.frame.measured_mm), surfaces(self.frame).smooth
        company = _neighbours(valid)
        alone = valid & (company < _COMPANY)
        pinholes = raw_valid & ~valid & (company > 8 - _COMPANY)
        numbers = (
            first, first & lost, second, second & lost, shadow, shadow & valid,
            surface, surface & lost, alone, alone & ~raw_valid, pinholes,
        )  # fmt: skip
        sums = (*(float(mask.sum()) for mask in numbers), 1.0)
        return {("edges", 0, 0): sums}

    def own_losses(self) -> tuple[float, float, float, float]:
        """Return the first four of EDGE_SUMS for the partner: the sensor's own losses.

        Zeros without a partner.
        """
        if self._partner is None or self._rims is None:
            return (0.0, 0.0, 0.0, 0.0)
        lost = lost_pixels(self.frame.measured_mm, np.nan_to_num(self._partner.measured_mm))
        first, second, _ = self._rims
        a, b, c, d = (float(m.sum()) for m in (first, first & lost, second, second & lost))
        return a, b, c, d


def lost_pixels(raw_mm: Depth, other_mm: Depth) -> Mask:
    """Return the pixels of raw (NaN = no depth) that another map (0 = no depth) has lost."""
    gone = other_mm <= 0
    lost: Mask = np.isfinite(raw_mm) & (gone | (np.abs(other_mm - raw_mm) > _LOST_MM))
    return lost


def rims_and_shadow(frame: DepthFrame) -> tuple[Mask, Mask, Mask]:
    """Return masks of the first and second pixel of foregrounds along rows, and of gaps' holes."""
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
    """Count the eight neighbours with depth; there are none outside the image."""
    kernel = np.ones((3, 3), np.float32)
    kernel[1, 1] = 0.0
    counted = cv2.filter2D(
        valid.astype(np.float32), cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(np.rint(counted), np.int64)


def _grouped(key: NDArray[np.int64], value: Array) -> dict[int, tuple[float, float]]:
    """Return key -> (count, sum of values)."""
    if key.size == 0:
        return {}
    counts, sums = np.bincount(key), np.bincount(key, value)
    return {int(k): (float(counts[k]), float(sums[k])) for k in np.flatnonzero(counts)}


class ScoredFrame(NamedTuple):
    """The sums of one frame by method, and ``FrameTruth.own_losses``."""

    number: int
    tallies: dict[str, Tally]
    own: tuple[float, float, float, float]
    board_mm: float | None
