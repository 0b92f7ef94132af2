"""Noise of real frames for a replay: over how many pixels it is alike, and how large it is.

Noise is told from relief in bands of size, the differences of successive smoothings. Of noise that
is alike over h pixels, each band has a known share; relief is what exceeds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.bench.compare.replay_surfaces import far_from_rims, smooth_surfaces
from glsim.core.array_types import Array
from glsim.core.depth_frame import DepthFrame
from glsim.core.units import MM_PER_M
from glsim.measures.correlation import lagged_sums
from glsim.measures.disparity import LEAST_TILES
from glsim.measures.quadrics import quadric_basis

#: Sides of the tiles in which correlation is measured, px; the second is used if a recording has
#: too few of the first. A quadric is subtracted from each tile, so that faces are not taken for
#: noise, and the noisier part of the tiles is left out. Chosen: tiles of 40 px hold 16 x 16 px of
#: the longest correlation, and 40 % of the tiles of heads are cheeks and foreheads.
_TILES_PX, _LEAST_NOISY = (40, 24), 0.4
#: Largest range of depth within a tile, as a share of the depth: no silhouette. Chosen.
_MOST_RANGE = 0.15
#: Lags, px, and half distances, px, at which the correlation that a quadric leaves is tabulated.
_LAGS = tuple((0, lag) for lag in (1, 2, 3, 4, 6, 8))
_HALVES_PX = np.geomspace(0.5, 8.0, 17)
#: The smoothing window is twice as wide as noise is alike, within limits, px: noise of a Kinect V2
#: (1.5 px) is reduced to a fourth by 3 px, noise of a D435 (6 px) by 10 px. Chosen.
_SMOOTH_OVER_HALF, _SMOOTH_PX = 2.0, (3.0, 10.0)
#: Widths of the bands' smoothings, relative to the widest. Chosen: noses at 0.5 to 1 m are 5 to 10
#: px wide, half as wide as the widest window and less.
_SHARES = (0.25, 0.5, 1.0)
#: Derived for such bands of Gaussian noise of half distance s / 2, and checked by simulation: the
#: band's share of the variance, and the lower quartile of its energy over its mean.
_BAND_NOISE, _QUARTILE = np.array([0.105, 0.124, 0.096]), np.array([0.54, 0.65, 0.70])
#: Noise is measured in classes of infrared, or of depth without infrared: bounds of the classes,
#: counts or mm, and smallest number of pixels in a class. Chosen, not measured.
_CLASSES, _LEAST_CLASS_PX = np.geomspace(100.0, 65_000.0, 34), 500


@dataclass(frozen=True, eq=False)
class ReplayNoise:
    """Noise of a camera, and the smoothing of surfaces that follows from it.

    Attributes:
        half_px: distance at which the noise's correlation is one half; NaN for a given smoothing.
        scales_px: standard deviations of the smoothing windows, finest first.
        at: (N,) middle of each class: infrared in counts, or depth in mm.
        energy_mm2: (N, bands) variance of the noise in each band; empty with too few pixels.
    """

    half_px: float
    scales_px: tuple[float, ...]
    at: Array
    energy_mm2: Array

    @property
    def sentence(self) -> str:
        """Say over how many pixels surfaces were smoothed, and why."""
        why = "" if np.isnan(self.half_px) else f"noise is alike over {self.half_px:.1f} px: "
        width = f"{why}surfaces were smoothed over {self.scales_px[-1]:.1f} px"
        return f"{width}, less where their relief exceeds the noise"

    def energy(self, frame: DepthFrame) -> Array:
        """Compute the (bands, H, W) noise of a frame, mm^2; infinite without measurements."""
        bands, shape = len(self.scales_px), frame.measured_mm.shape
        if self.at.size == 0:
            return np.full((bands, *shape), np.inf)
        place = np.log(np.maximum(_driver(frame), _CLASSES[0]))
        return np.stack([np.interp(place, np.log(self.at), band) for band in self.energy_mm2.T])


def measure_replay_noise(frames: Sequence[DepthFrame], smooth_px: float | None) -> ReplayNoise:
    """Measure the noise on the smoothest surfaces of frames that all or none have infrared.

    ``smooth_px``: widest smoothing window. None: by the correlation of the noise.
    """
    half_px = half_distance_px(frames) if smooth_px is None else float("nan")
    widest = smooth_px or float(np.clip(_SMOOTH_OVER_HALF * half_px, *_SMOOTH_PX))
    scales = tuple(share * widest for share in _SHARES)
    energies, drivers = [], []
    for frame in frames:
        surfaces = smooth_surfaces(frame.measured_mm, scales)
        inner = far_from_rims(surfaces.label)
        energies.append(surfaces.energy[:, inner])
        drivers.append(_driver(frame)[inner])
    energy, driver = np.concatenate(energies, axis=1), np.concatenate(drivers)
    place = np.digitize(driver, _CLASSES)
    at, floor = [], []
    for k in range(1, len(_CLASSES)):
        chosen = energy[:, place == k]
        if chosen.shape[1] >= _LEAST_CLASS_PX:
            at.append(np.sqrt(_CLASSES[k - 1] * _CLASSES[k]))
            own = np.quantile(chosen, 0.25, axis=1) / _QUARTILE
            # Where every surface is bent, wide bands hold relief: narrower bands say their noise.
            floor.append(np.minimum.accumulate(own / _BAND_NOISE) * _BAND_NOISE)
    return ReplayNoise(half_px, scales, np.array(at), np.array(floor))


def half_distance_px(frames: Sequence[DepthFrame]) -> float:
    """Measure the distance at which the correlation of the noise is one half, px; 1.5 if unknown.

    The correlation left by a quadric in a tile is compared with that of known Gaussian noise.
    """
    for side in _TILES_PX:
        tiles = np.concatenate([_tiles(frame.measured_mm, side) for frame in frames])
        if len(tiles) >= LEAST_TILES:
            measured, table = _correlation(tiles, side, _LEAST_NOISY), _table(side)
            misfit = ((table - measured) ** 2).sum(axis=1)
            return float(_HALVES_PX[misfit.argmin()])
    return 1.5


@cache
def _table(side: int) -> Array:
    """Compute the correlation at _LAGS that quadrics leave of noise, for each of _HALVES_PX."""
    fields = np.random.default_rng(0).normal(size=(60, side + 32, side + 32))
    rows = []
    for half in _HALVES_PX:
        sigma = half / np.sqrt(4.0 * np.log(2.0))  # exp(-d^2 / (4 sigma^2)) is a half at d = half
        blurred = np.stack([cv2.GaussianBlur(field, (0, 0), sigma) for field in fields])
        rows.append(_correlation(blurred[:, 16:-16, 16:-16], side, 1.0))
    return np.array(rows)


def _correlation(tiles: Array, side: int, share: float) -> Array:
    """Compute the correlation of tiles about their quadric at _LAGS, of the least noisy share."""
    basis = quadric_basis(side)
    flat = tiles.reshape(len(tiles), -1)
    flat = flat - flat @ basis @ basis.T
    variance = (flat**2).mean(axis=1)
    kept = flat[variance <= np.quantile(variance, share)].reshape(-1, side, side)
    kept /= np.maximum(kept.std(axis=(1, 2), keepdims=True), 1e-12)
    products, squares = lagged_sums(kept, _LAGS, both_axes=True).sum(axis=0).T
    return np.asarray(products / squares)


def _tiles(depth_mm: NDArray[np.float32], side: int) -> Array:
    """Cut (N, side, side) whole tiles of one surface, as 1 / depth relative to their mean."""
    if min(depth_mm.shape) < side:
        return np.zeros((0, side, side))
    cut = np.lib.stride_tricks.sliding_window_view(depth_mm, (side, side))
    cut = cut[:: side // 2, :: side // 2].reshape(-1, side, side)
    low, high = cut.min(axis=(1, 2)), cut.max(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        inverse = MM_PER_M / cut[high - low < _MOST_RANGE * low].astype(np.float64)
    return np.asarray(inverse / inverse.mean(axis=(1, 2), keepdims=True) - 1.0)


def _driver(frame: DepthFrame) -> Array:
    """Return the quantity that noise depends on: (H, W) infrared, or depth without infrared."""
    source = frame.measured_mm if frame.infrared is None else frame.infrared
    return np.nan_to_num(source.astype(np.float64))
