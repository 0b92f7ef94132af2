"""Measure a static recording of a camera that triangulates, for the fit of a sensor."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.disparity import (
    LEAST_TILES,
    TILE_PX,
    DisparityNoise,
    find_tiles,
    measure_disparity_noise,
    to_disparity,
)
from glsim.bench.measures.lattice import Lattice, distinct_values, estimate_lattice
from glsim.bench.measures.validity import flip_share, hole_share_beside_band
from glsim.core.depth_frame import Frames
from glsim.core.errors import DatasetError

Array = NDArray[np.float64]

#: Frames that are measured. Chosen: a tile's noise in time is known to 3 % from 23 differences.
FRAMES = 24
#: Two frames show one view if half of the pixels change by less than this, px. Chosen: three times
#: the median change of a D4xx's noise; a camera that moves by 1 px has more.
_STILL_PX = 0.35
#: Groups of tiles, by distance, at whose planes noise is reproduced.
_GROUPS = 3


@dataclass(frozen=True)
class StereoStatistics:
    """Noise of one recording.

    Attributes:
        frames: number of frames that were measured.
        size: (width, height), px.
        unit_mm: step of the depth files.
        focal_baseline_px_mm: focal length times baseline.
        lattice: of the depths; None if it was not found, and f B is the base sensor's.
        noise: of disparity, px.
        distances_mm: of the planes of three groups of tiles, nearest first.
        slopes: of these in the image, px of disparity per px: noise depends on it. Medians of a
            group, because noise alone gives a tile a slope.
        holes: share of holes right of the left border's band.
        flips: share of pixels with depth in one of two frames only.
    """

    frames: int
    size: tuple[int, int]
    unit_mm: float
    focal_baseline_px_mm: float
    lattice: Lattice | None
    noise: DisparityNoise
    distances_mm: tuple[float, ...]
    slopes: tuple[float, ...]
    holes: float
    flips: float


def find_lattice(frames: Frames) -> Lattice | None:
    """Return the lattice of the depths of frames; None if they are on none."""
    step = frames[0].step_mm
    if step <= 0:
        return None
    found = estimate_lattice(distinct_values((f.measured_mm for f in frames), step))
    return found if found is not None and found.accepted else None


def measure_stereo(
    frames: Frames, lattice: Lattice | None, steps: float, focal_baseline_px_mm: float
) -> StereoStatistics:
    """Measure a static recording.

    Args:
        frames: of one view.
        lattice: of their depths, which gives f B; None: f B is given.
        steps: of disparity per pixel of this kind of camera.
        focal_baseline_px_mm: of the base sensor, for recordings without a lattice.

    Raises:
        DatasetError: frames show different views, or no part of the scene is plane.
    """
    unit = frames[0].step_mm or 1.0
    product = focal_baseline_px_mm if lattice is None else lattice.constant * unit / steps
    disparity = [to_disparity(f.measured_mm, product) for f in frames]
    _check_still(frames, disparity)
    pairs = list(pairwise(range(len(disparity))))
    noise = measure_disparity_noise(disparity, pairs)
    if noise.tiles < LEAST_TILES or not np.isfinite([noise.frame, noise.static]).all():
        raise DatasetError(
            f"{frames.title}: only {noise.tiles} parts of 40x40 px are full of depth: record "
            "walls, a floor, a table, at several distances, and do not move"
        )
    levels, slopes = _planes(disparity[0])
    groups = np.array_split(np.argsort(-levels), _GROUPS)
    height, width = disparity[0].shape
    return StereoStatistics(
        len(disparity),
        (width, height),
        unit,
        product,
        lattice,
        noise,
        tuple(product / float(np.median(levels[group])) for group in groups),
        tuple(float(np.hypot(*np.median(slopes[group], axis=0))) for group in groups),
        hole_share_beside_band(disparity),
        flip_share(disparity, pairs),
    )


def _planes(disparity: Array) -> tuple[Array, Array]:
    """Return level, (N,) px, and slope along rows and columns, (N, 2) px per px, of tiles."""
    tiles = find_tiles(disparity)
    half = TILE_PX // 2
    slopes = []
    for top, left in zip(tiles.top, tiles.left, strict=True):
        tile = disparity[top : top + TILE_PX, left : left + TILE_PX]
        down = np.nanmean(tile[half:]) - np.nanmean(tile[:half])
        right = np.nanmean(tile[:, half:]) - np.nanmean(tile[:, :half])
        slopes.append((right / half, down / half))
    return tiles.level, np.array(slopes)


def _check_still(frames: Frames, disparity: list[Array]) -> None:
    """Raise DatasetError if two frames that follow each other show different views."""
    if len(disparity) < 2:
        raise DatasetError(
            f"{frames.title}: has one frame only; noise is measured between frames: record at "
            "least 12 frames of a scene in which nothing moves"
        )
    for number, (before, after) in enumerate(pairwise(disparity)):
        change = np.abs(after - before)
        known = change[np.isfinite(change)]
        middle = float(np.median(known)) if known.size else float("inf")
        if middle > _STILL_PX:
            names = [frames[k].name for k in (number, number + 1)]
            raise DatasetError(
                f"{frames.title}: {names[0]} and {names[1]} show different scenes (half of the "
                f"disparities change by more than {middle:.2g} px): give a static recording, one "
                "camera and nothing that moves"
            )
