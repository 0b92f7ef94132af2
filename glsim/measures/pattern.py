"""Fixed pattern: the depth error that is equal in every frame, by rows, columns and pixels.

For each pixel the residual of a quadric in 11 x 11 pixels is averaged, once over the even frames
and once over the odd frames. The covariance of the two averages is the variance of the pattern,
free of temporal noise. The pattern has three parts: means along rows, means along columns, and the
rest. The quadric follows a known share of each part, which is added again. If the view never moves,
the roughness of the scene counts as fixed pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glsim.core.array_types import Array
from glsim.core.depth_frame import DepthFrame
from glsim.measures.measured_frame import lit
from glsim.measures.quadrics import fit_surfaces

_SIZE = 11
#: Weights of a quadratic fit in 11 points, from the centre outwards (Savitzky and Golay 1964).
_WEIGHTS = np.array([89, 84, 69, 44, 9, -36]) / 429.0
#: Shares that the quadric leaves: of an alternation of rows; of the variance of white rows.
_LEFT_ALTERNATION = 1.0 - (_WEIGHTS[0] + 2 * (_WEIGHTS[1:] * [-1, 1, -1, 1, -1]).sum())
_LEFT_ROWS = 1.0 - _WEIGHTS[0]
#: Shares that the quadric leaves of the variance of single pixels: white pixels, and pixels smooth
#: over 3 x 3. The next line has the residual's correlation at 1 px. Derived from the weights h of
#: the centre: 1 - 2 h r + h R h with the pixels' correlations r, R.
_LEFT_WHITE, _LEFT_SMOOTH = 0.9705, 0.7285
_CORRELATION_WHITE, _CORRELATION_SMOOTH = -0.032, 0.552
#: Smallest number of rows, and of pixels of a row or column in each half of the frames.
_LEAST_PIXELS = 30
_LEAST_ROWS = 60
#: Number of bands of the image in which the alternation is averaged.
BANDS = 8
#: Residuals above this, mm, are texture and edges. The value was chosen, not measured.
_CLIP_MM = 5.0


@dataclass(frozen=True)
class FixedPattern:
    """Fixed pattern of a set of frames; NaN for too few pixels on smooth surfaces.

    Attributes:
        rows_mm: standard deviation of the rows, with the alternation.
        alternation_mm: (BANDS,) half the step from even to odd rows, in bands from the top;
            positive if odd rows are farther.
        alternation_rms_mm: rms of half the step.
        rest_correlation: correlation of the rest between horizontal neighbours; 0 for white
            pixels, 0.55 for pixels smooth over 3 x 3.
    """

    frames: int
    rows_mm: float
    columns_mm: float
    rest_mm: float
    alternation_mm: tuple[float, ...]
    alternation_rms_mm: float
    rest_correlation: float


def measure_pattern(frames: Sequence[DepthFrame]) -> FixedPattern:
    """Measure the fixed pattern in two or more frames within 1.6 m; beyond, noise hides it."""
    nan = float("nan")
    nothing = FixedPattern(len(frames), nan, nan, nan, (nan,) * BANDS, nan, nan)
    shape = frames[0].measured_mm.shape
    sums, counts = np.zeros((2, *shape)), np.zeros((2, *shape))
    for number, frame in enumerate(frames):
        s = fit_surfaces(frame.measured_mm, frame.rays, _SIZE)
        limit = 1.5 * np.nanmedian(s.rough_mm) if s.smooth.any() else 0.0
        used = s.smooth & lit(frame) & (s.rough_mm < limit) & (np.abs(s.residual_mm) < _CLIP_MM)
        used &= frame.measured_mm < 1600.0
        sums[number % 2] += np.where(used, s.residual_mm, 0.0)
        counts[number % 2] += used
    if len(frames) < 2:
        return nothing
    rows = _line_means(sums, counts, axis=2)
    columns = _line_means(sums, counts, axis=1)
    if np.isfinite(rows).all(axis=0).sum() < _LEAST_ROWS or not np.isfinite(columns).any():
        return nothing
    halves = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    # The running mean over 31 lines is slow drift, which is subtracted.
    own_rows, own_columns = (
        np.stack([line - _running_mean(line, 31) for line in lines]) for lines in (rows, columns)
    )
    rest = halves - np.nan_to_num(own_rows)[:, :, None] - np.nan_to_num(own_columns)[:, None, :]
    total = _covariance(rest[0], rest[1])
    there, back = (_covariance(rest[a, :, 1:], rest[1 - a, :, :-1]) for a in (0, 1))
    side = 0.5 * (there + back)
    # Half the step from even to odd rows: the mean in each band, and the local mean over 41 rows.
    half_steps = own_rows * np.where(np.arange(shape[0]) % 2 == 1, 1.0, -1.0)
    bands = np.array_split(half_steps.mean(axis=0), BANDS)
    alternation = [np.nanmean(b) if np.isfinite(b).sum() >= 10 else nan for b in bands]
    first, second = (_running_mean(half, 41, least=20) for half in half_steps)
    alternating = _covariance(first, second, centre=False)
    other = _covariance(own_rows[0], own_rows[1]) - alternating
    rms = np.sqrt(max(alternating, 0.0)) / _LEFT_ALTERNATION
    likeness = side / total if total > 0 else nan
    known = (_CORRELATION_WHITE, _CORRELATION_SMOOTH), (_LEFT_WHITE, _LEFT_SMOOTH)
    left = np.interp(np.nan_to_num(likeness), *known)
    return FixedPattern(
        len(frames), float(np.sqrt(rms**2 + max(other, 0.0) / _LEFT_ROWS)),
        float(np.sqrt(max(_covariance(own_columns[0], own_columns[1]), 0.0) / _LEFT_ROWS)),
        float(np.sqrt(max(total, 0.0) / left)),
        tuple(float(a) / _LEFT_ALTERNATION for a in alternation), float(rms), likeness,
    )  # fmt: skip


def _line_means(sums: Array, counts: Array, axis: int) -> Array:
    """Average both halves (2, H, W) along rows (axis 2) or columns (axis 1); NaN for few pixels."""
    count = counts.sum(axis=axis)
    enough = (count >= _LEAST_PIXELS).all(axis=0)
    return np.where(enough, sums.sum(axis=axis) / np.maximum(count, 1), np.nan)


def _running_mean(line: Array, size: int, least: int = 1) -> Array:
    """Average the known values in a window around each value; NaN for fewer than ``least``."""
    known, kernel = np.isfinite(line), np.ones(size)
    total = np.convolve(np.where(known, line, 0.0), kernel, "same")
    count = np.convolve(known.astype(float), kernel, "same")
    return np.where(count >= least, total / np.maximum(count, 1.0), np.nan)


def _covariance(first: Array, second: Array, centre: bool = True) -> float:
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < 10:
        return 0.0
    a, b = first[both], second[both]
    if centre:
        a, b = a - a.mean(), b - b.mean()
    return float((a * b).mean())
