"""Noise of disparity, which a stereo or structured-light camera measures before depth.

Disparity is focal length times baseline over depth, px. If the product is unknown, 1 / depth, 1/m,
replaces it. A plane is linear in both. Tiles of 40 x 40 px with depth in 97 % of their pixels are
compared with a robust plane. Three figures describe the matcher: the spread about the plane, its
part that does not change from frame to frame, and the correlation between pixels of each part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Whole
from glsim.measures.correlation import lagged_sums
from glsim.measures.stacks import with_nan

#: Distances at which the correlation is computed, px. Chosen: with a matcher's support region of 13
#: to 15 px the correlation falls to one half at 5 px and to 0 at 14 px.
LAGS_PX = (1, 2, 3, 4, 6, 8, 12)
#: Side of a tile, px, and smallest share of its pixels with depth. Chosen: three support regions.
TILE_PX, LEAST_SHARE = 40, 0.97
#: Outliers of a plane lie beyond _CLIP robust deviations, found in at most _ROUNDS rounds; chosen.
_CLIP, _ROUNDS = 4.0, 10
#: Outliers of the difference of two frames lie beyond this many robust deviations; chosen.
_CLIP_DIFFERENCE = 5.0
#: Smallest number of tiles for a figure. Chosen: the median of five is known to about 20 %.
LEAST_TILES = 5
#: Number of parts of an image whose spread says the errors. Chosen: errors are known to a quarter.
_BLOCKS = 8
_NONE = (float("nan"),) * len(LAGS_PX)


@dataclass(frozen=True)
class DisparityNoise:
    """Noise of disparity, px, or 1/m if focal length and baseline are unknown.

    Attributes:
        residual: median of the tiles' standard deviation about their plane.
        rows: (7,) correlation of the residual along rows at LAGS_PX, mean over the tiles.
        columns: (7,) the same along columns.
        frame: median of the temporal standard deviation of one frame, from differences over sqrt 2.
        static: median root of the covariance of the residuals of two frames, the static noise.
        frame_rows: (7,) correlation of the difference along rows, all tiles together.
        frame_columns: (7,) the same along columns.
        static_rows, static_columns: (7,) correlation of the static noise, median over the tiles.

    A figure from fewer than LEAST_TILES tiles is NaN.
    """

    tiles: int
    residual: float
    rows: tuple[float, ...]
    columns: tuple[float, ...]
    pairs: int
    frame: float
    static: float
    frame_rows: tuple[float, ...]
    frame_columns: tuple[float, ...]
    static_rows: tuple[float, ...]
    static_columns: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Tiles:
    """Square image tiles in which nearly every pixel has depth, and their noise.

    Attributes:
        top, left: (N,) row and column of each tile's first pixel.
        level: (N,) median disparity.
        residual: (N, S, S) disparity minus the robust plane, NaN for outliers.
        sigma: (N,) standard deviation of the residual, with three degrees of freedom subtracted.
    """

    top: Whole
    left: Whole
    level: Array
    residual: Array
    sigma: Array

    @property
    def place(self) -> Whole:
        """(N,) numbers of the tiles, by rows and columns."""
        return np.asarray((self.top << 32) + self.left)


def to_disparity(depth_mm: NDArray[np.generic], focal_baseline_px_mm: float | None = None) -> Array:
    """Convert depth, mm, to disparity, px, or to 1/m without f B (px mm); NaN for no depth."""
    scale = 1000.0 if focal_baseline_px_mm is None else focal_baseline_px_mm
    return np.asarray(scale / with_nan(depth_mm))


def find_tiles(disparity: Array) -> Tiles:
    """Cut an (H, W) image, NaN = none, into square tiles, and fit a robust plane to each tile."""
    down, across = (size // TILE_PX for size in disparity.shape)
    part = disparity[: down * TILE_PX, : across * TILE_PX]
    blocks = part.reshape(down, TILE_PX, across, TILE_PX).swapaxes(1, 2).reshape(-1, TILE_PX**2)
    rows, columns = np.mgrid[:down, :across] * TILE_PX
    full = np.isfinite(blocks).mean(axis=1) >= LEAST_SHARE
    values = blocks[full]
    residual = _plane_residual(values)
    count = np.maximum(np.isfinite(residual).sum(axis=1) - 3, 1)
    sigma = np.sqrt(np.nansum(residual**2, axis=1) / count)
    level = np.nanmedian(values, axis=1) if len(values) else np.zeros(0)
    images = residual.reshape(-1, TILE_PX, TILE_PX)
    return Tiles(rows.ravel()[full], columns.ravel()[full], level, images, sigma)


def power_share(residual: Array, least_px: float, most_px: float) -> float:
    """Compute the share of power in a range of periods, px, along columns of (N, S, S) tiles."""
    power = (np.abs(np.fft.rfft(np.nan_to_num(residual), axis=1)) ** 2).mean(axis=2)[:, 1:]
    period = 1 / np.fft.rfftfreq(residual.shape[1])[1:]
    chosen = (period >= least_px) & (period <= most_px)
    return float((power[:, chosen].sum(axis=1) / power.sum(axis=1)).mean())


def _plane_residual(values: Array) -> Array:
    """Subtract a robust plane from each of (N, S * S) tiles; outliers and holes become NaN."""
    y, x = np.mgrid[:TILE_PX, :TILE_PX] - (TILE_PX - 1) / 2
    design = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
    squares = (design[:, :, None] * design[:, None]).reshape(-1, 9)
    known = np.isfinite(values)
    filled = np.where(known, values, 0.0)
    used = known
    residual = values
    for _ in range(_ROUNDS):
        weight = used.astype(np.float64)
        normal = (weight @ squares).reshape(-1, 3, 3)
        right = (weight * filled) @ design
        plane = np.linalg.solve(normal, right[..., None])[..., 0]
        residual = filled - plane @ design.T
        inside = np.where(used, residual, np.nan)
        if inside.size == 0:
            break
        closer = known & (np.abs(residual) <= _CLIP * _spread(np.abs(inside), 1) + 1e-12)
        if (closer == used).all():
            break
        used = closer
    return np.where(used, residual, np.nan)


def _spread(away: Array, axis: int | tuple[int, int]) -> Array:
    """Compute the robust deviation along axes, which are kept with length 1."""
    # It is at least a third of the rms: on quantised planes the median deviation is often 0.
    middle = np.nanmedian(away, axis=axis, keepdims=True)
    rms = np.sqrt(np.nanmean(away**2, axis=axis, keepdims=True))
    return np.asarray(np.fmax(1.4826 * middle, rms / 3.0))


def measure_disparity_noise(
    disparity: Sequence[Array], pairs: Sequence[tuple[int, int]] = ()
) -> DisparityNoise:
    """Measure the noise of (H, W) disparities, NaN = none, and of static pairs of frame numbers."""
    return _figures(_parts(disparity, pairs), len(pairs))


def measure_blocks(
    disparity: Sequence[Array], pairs: Sequence[tuple[int, int]]
) -> list[DisparityNoise]:
    """Measure the noise of all tiles, then without each of _BLOCKS parts of the image.

    The spread of the latter says the standard errors (``glsim.measures.stacks.jackknife_error``).
    """
    parts = _parts(disparity, pairs)
    found = [_figures(parts, len(pairs))]
    for block in np.array_split(np.unique(parts[0].place), _BLOCKS):
        kept = [(p, ~np.isin(p.place, block)) for p in parts]
        left = [_Part(p.place[k], p.variance[k], p.sums[k]) for p, k in kept]
        found.append(_figures(left, len(pairs)))
    return found


class _Part(NamedTuple):
    """One part of the noise in N tiles: place in the image, variance, lagged sums.

    ``sums``: (N, 2, L, 2), along rows and along columns, at LAGS_PX, of products and of squares.
    """

    place: Whole
    variance: Array
    sums: Array


def _joined(found: Iterable[tuple[Whole, Array, Array]]) -> _Part:
    empty = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 2, len(LAGS_PX), 2))
    return _Part(*(np.concatenate(column) for column in zip(empty, *found, strict=True)))


def _parts(
    disparity: Sequence[Array], pairs: Sequence[tuple[int, int]]
) -> tuple[_Part, _Part, _Part]:
    """Measure the residual, the temporal noise and the static noise of each tile."""
    tiles = [find_tiles(image) for image in disparity]
    return (
        _joined((t.place, t.sigma**2, _sums(t.residual)) for t in tiles),
        _joined(_temporal(disparity[a], disparity[b], tiles[a]) for a, b in pairs),
        _joined(_static(tiles[a], tiles[b]) for a, b in pairs),
    )


def _sums(images: Array) -> Array:
    lags = [(0, lag) for lag in LAGS_PX], [(lag, 0) for lag in LAGS_PX]
    return np.stack([lagged_sums(images, along) for along in lags], axis=1)


def _figures(parts: Sequence[_Part], pairs: int) -> DisparityNoise:
    residual, temporal, static = parts
    sigma, frame = (_median(np.sqrt(part.variance)) for part in (residual, temporal))
    own = float(np.sqrt(np.maximum(_median(static.variance), 0.0)))
    # The residual's is the mean over tiles, where a few uneven ones do not decide.
    each = residual.sums / np.where(residual.sums[..., 1:] > 0, residual.sums[..., 1:], np.nan)
    return DisparityNoise(
        len(residual.place), sigma, *_correlations(np.nanmean, each), pairs, frame, own,
        *_correlations(np.sum, temporal.sums), *_correlations(np.median, static.sums),
    )  # fmt: skip


def _correlations(
    mean: Callable[..., Array], sums: Array
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Compute correlations along rows and along columns from the mean sums of the tiles."""
    if len(sums) < LEAST_TILES:
        return _NONE, _NONE
    products, squares = np.moveaxis(mean(sums, axis=0), -1, 0)
    rows, columns = (products / np.where(squares > 0, squares, np.nan)).tolist()
    return tuple(rows), tuple(columns)


def _temporal(first: Array, second: Array, tiles: Tiles) -> tuple[Whole, Array, Array]:
    """Measure each tile's temporal noise, the difference of two frames over sqrt 2, mean 0."""
    difference = (second - first) / np.sqrt(2.0)
    side = np.arange(TILE_PX)
    rows, columns = tiles.top[:, None, None] + side[:, None], tiles.left[:, None, None] + side
    parts = difference[rows, columns]
    full = np.isfinite(parts).mean(axis=(1, 2)) >= LEAST_SHARE**2
    parts = parts[full]
    away = np.abs(parts - np.nanmedian(parts, axis=(1, 2), keepdims=True))
    parts = np.where(away <= _CLIP_DIFFERENCE * _spread(away, (1, 2)) + 1e-12, parts, np.nan)
    squares = parts - np.nanmean(parts, axis=(1, 2), keepdims=True)
    count = np.maximum(np.isfinite(squares).sum(axis=(1, 2)) - 1, 1)
    return tiles.place[full], np.nansum(squares**2, axis=(1, 2)) / count, _sums(squares)


def _static(first: Tiles, second: Tiles) -> tuple[Whole, Array, Array]:
    """Compute the covariance of residuals between two frames, for tiles that both frames have."""
    place, one, other = np.intersect1d(first.place, second.place, return_indices=True)
    a, b = first.residual[one], second.residual[other]
    count = np.maximum(np.isfinite(a + b).sum(axis=(1, 2)) - 3, 1)
    # (a + b) (a' + b') - (a - b) (a' - b') = 2 (a b' + b a'): temporal noise cancels.
    sums = 0.25 * (_sums(a + b) - _sums(a - b))
    return place, np.nansum(a * b, axis=(1, 2)) / count, sums


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size >= LEAST_TILES else float("nan")
