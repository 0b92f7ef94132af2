"""Fixed pattern: the part of the error that every frame repeats, by rows, columns and the rest.

Frames of moving views: the residual of a quadric in 11 x 11 pixels on smooth surfaces is averaged
per pixel over the even and over the odd frames. What both averages share is fixed: the covariance
of the two is free of temporal noise. Rows are means along rows, columns means along columns, the
rest is what remains. The quadric swallows a known part of each, which is given back. Frames of one
static view show the roughness of the scene as pattern too; of a static recording the means of its
even and of its odd frames do. Source: design/reality.md, section 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.compare.frames import DepthFrame
from glsim.compare.surfaces import fit_surfaces

Array = NDArray[np.float64]

_SIZE = 11
#: Weights of a quadratic in 11 points at its centre (Savitzky and Golay 1964), from the centre out.
_WEIGHTS = np.array([89, 84, 69, 44, 9, -36]) / 429.0
#: What the quadric leaves of an alternation of rows, of white rows (variance), of white pixels.
_LEFT_ALTERNATION = 1.0 - (_WEIGHTS[0] + 2 * (_WEIGHTS[1:] * [-1, 1, -1, 1, -1]).sum())
_LEFT_ROWS = 1.0 - _WEIGHTS[0]
#: Share of the variance of single pixels that a quadric in 11 x 11 leaves at its centre, and the
#: correlation at 1 px of what it leaves: of white pixels and of those smooth over 3 x 3. Derived
#: from the weights h of the centre: 1 - 2 h r + h R h with the pixels' correlations r, R.
_LEFT_WHITE, _LEFT_SMOOTH = 0.9705, 0.7285
_CORRELATION_WHITE, _CORRELATION_SMOOTH = -0.032, 0.552
#: A row (column) is known where it has this many pixels in each half of the frames.
_LEAST_PIXELS = 30
_LEAST_ROWS = 60
#: Bands of the image in which the alternation is averaged.
BANDS = 8
#: Residuals beyond this many mm are texture and edges.
_CLIP_MM = 5.0


@dataclass(frozen=True)
class FixedPattern:
    """Standard deviations in mm, NaN if too few pixels are on smooth surfaces.

    rows: with the alternation. alternation: (BANDS,) half the step between odd and even rows down
    the image, signed, odd rows farther positive. rest: single pixels. rest_correlation: of what the
    quadric leaves of the rest, between neighbours along x; 0 for white pixels, 0.55 for pixels that
    are smooth over 3 x 3.
    """

    frames: int
    rows_mm: float
    columns_mm: float
    rest_mm: float
    alternation_mm: tuple[float, ...]
    alternation_rms_mm: float
    rest_correlation: float


def measure_pattern(frames: Sequence[DepthFrame]) -> FixedPattern:
    """Measure the fixed pattern. It needs two frames or more of surfaces within 1.6 m.

    Farther surfaces are left out: their temporal noise hides the pattern.
    """
    nan = float("nan")
    nothing = FixedPattern(len(frames), nan, nan, nan, (nan,) * BANDS, nan, nan)
    shape = frames[0].depth_mm.shape
    sums, counts = np.zeros((2, *shape)), np.zeros((2, *shape))
    for number, frame in enumerate(frames):
        s = fit_surfaces(frame.depth_mm, frame.rays, _SIZE)
        limit = 1.5 * np.nanmedian(s.rough_mm) if s.smooth.any() else 0.0
        used = s.smooth & frame.lit & (s.rough_mm < limit) & (np.abs(s.residual_mm) < _CLIP_MM)
        used &= frame.depth_mm < 1600.0
        sums[number % 2] += np.where(used, s.residual_mm, 0.0)
        counts[number % 2] += used
    if len(frames) < 2:
        return nothing
    rows = _line_means(sums, counts, axis=2)
    columns = _line_means(sums, counts, axis=1)
    if np.isfinite(rows).all(axis=0).sum() < _LEAST_ROWS or not np.isfinite(columns).any():
        return nothing
    halves = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    own_rows, own_columns = _centred(rows), _centred(columns)
    rest = halves - np.nan_to_num(own_rows)[:, :, None] - np.nan_to_num(own_columns)[:, None, :]
    total = _covariance(rest[0], rest[1])
    side = 0.5 * (
        _covariance(rest[0, :, 1:], rest[1, :, :-1]) + _covariance(rest[0, :, :-1], rest[1, :, 1:])
    )
    alternation = _alternation(own_rows.mean(axis=0))
    alternating = _covariance(
        _smoothed_alternation(own_rows[0]), _smoothed_alternation(own_rows[1]), centre=False
    )
    other = _covariance(own_rows[0], own_rows[1]) - alternating
    rms = np.sqrt(max(alternating, 0.0)) / _LEFT_ALTERNATION
    likeness = side / total if total > 0 else nan
    left = np.interp(
        np.nan_to_num(likeness),
        (_CORRELATION_WHITE, _CORRELATION_SMOOTH),
        (_LEFT_WHITE, _LEFT_SMOOTH),
    )
    return FixedPattern(
        len(frames),
        float(np.sqrt(rms**2 + max(other, 0.0) / _LEFT_ROWS)),
        float(np.sqrt(max(_covariance(own_columns[0], own_columns[1]), 0.0) / _LEFT_ROWS)),
        float(np.sqrt(max(total, 0.0) / left)),
        tuple(float(a) / _LEFT_ALTERNATION for a in alternation),
        float(rms),
        likeness,
    )


def _line_means(sums: Array, counts: Array, axis: int) -> Array:
    """Average each half (2, H, W) along rows (axis 2) or columns (axis 1); NaN where rare."""
    count = counts.sum(axis=axis)
    enough = (count >= _LEAST_PIXELS).all(axis=0)
    return np.where(enough, sums.sum(axis=axis) / np.maximum(count, 1), np.nan)


def _centred(lines: Array) -> Array:
    """Subtract a running quadratic of 11 lines' worth of slow change: the mean of 31 lines."""
    kernel = np.ones(31)
    known = np.isfinite(lines)
    out = np.empty_like(lines)
    for k, (line, good) in enumerate(zip(lines, known, strict=True)):
        total = np.convolve(np.where(good, line, 0.0), kernel, "same")
        count = np.convolve(good.astype(float), kernel, "same")
        out[k] = np.where(good, line - total / np.maximum(count, 1.0), np.nan)
    return out


def _smoothed_alternation(rows: Array) -> Array:
    """Return (H,) the local half step between odd and even rows: a mean over 41 rows."""
    sign = np.where(np.arange(rows.size) % 2 == 1, 1.0, -1.0)
    known = np.isfinite(rows)
    kernel = np.ones(41)
    total = np.convolve(np.where(known, rows * sign, 0.0), kernel, "same")
    count = np.convolve(known.astype(float), kernel, "same")
    return np.where(count >= 20, total / np.maximum(count, 1.0), np.nan)


def _alternation(rows: Array) -> list[float]:
    """Average the signed half step in BANDS bands from the top to the bottom."""
    sign = np.where(np.arange(rows.size) % 2 == 1, 1.0, -1.0)
    bands = np.array_split(rows * sign, BANDS)
    return [float(np.nanmean(b)) if np.isfinite(b).sum() >= 10 else float("nan") for b in bands]


def _covariance(first: Array, second: Array, centre: bool = True) -> float:
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < 10:
        return 0.0
    a, b = first[both], second[both]
    if centre:
        a, b = a - a.mean(), b - b.mean()
    return float((a * b).mean())
