"""Small depth patches and their fixed features, for the classifier.

Surface patches have 16 x 16 px without holes and depth steps. A quadric is subtracted from each, so
that the features describe the noise and not the shape or the pose. Silhouette patches have 13 rows
x 24 columns around a rim, mirrored so that the foreground is on the left. No feature uses infrared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array
from glsim.core.depth_frame import DepthFrame
from glsim.core.units import MM_PER_M
from glsim.measures.correlation import LAGS, lagged_sums
from glsim.measures.measured_frame import lit, surfaces
from glsim.measures.quadrics import quadric_basis
from glsim.measures.silhouettes import HEAD_SHIFTS, find_edges

#: One patch: frame number, first column (px), ``Patches.matched``, features.
_Patch = tuple[int, int, float, Array]

KINDS = ("planes", "curved", "silhouettes, lit side", "silhouettes, shadow side")
SIDE_PX = 16
_ROWS, _FRONT_PX, _BACK_PX = 13, 8, 16
#: Largest number of patches of one kind that are taken from a frame.
MOST_PER_FRAME = 120
#: A patch counts as curved if a quadric explains at least this share of its variance about a plane.
_CURVED = 0.5
#: Largest residual of a patch without a depth edge: a constant (mm) plus a growth (mm per m).
_ROUGHEST_MM, _ROUGHEST_MM_PER_M = 3.0, 2.0

SURFACE_FEATURES = (
    "log of the residual",
    *(f"correlation at {px} px along {axis}" for axis in "xy" for px in (1, 2, 3)),
    "correlation on the diagonal", "step between odd and even rows", "spread of the rows' means",
    "spread of the columns' means", "largest residual over their rms",
)  # fmt: skip
EDGE_FEATURES = (
    "width of the gap", "spread of the width over the rows", "invalid pixels of the gap",
    "flying pixels of the gap", "invalid share of 8 px outside", "share behind the background",
    "valid-invalid changes in a row", "log of the foreground's residual",
    "log of the background's residual",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Patches:
    """Patches of one kind, with their features.

    Attributes:
        features: (N, F) values.
        frame: (N,) frame numbers.
        column: (N,) first columns, px.
        matched: (N,) quantity that both sets must have equally often: log of the distance in mm for
            surfaces, S (disparity step in px per m of baseline) for silhouettes.
    """

    names: tuple[str, ...]
    features: Array
    frame: NDArray[np.int64]
    column: NDArray[np.int64]
    matched: Array


def surface_patches(frames: Sequence[DepthFrame]) -> dict[str, Patches]:
    """Cut plane and curved surface patches from the frames; neighbours overlap by half a patch."""
    patches: dict[str, list[_Patch]] = {"planes": [], "curved": []}
    quadric = quadric_basis(SIDE_PX)
    plane = quadric[:, :3]
    for number, frame in enumerate(frames):
        cells, columns = _whole_patches(frame)
        if len(cells) == 0:
            continue
        flat = cells.reshape(len(cells), -1)
        distance = flat.mean(axis=1)
        flat = flat - distance[:, None]
        by_plane = flat - flat @ plane @ plane.T
        residual = flat - flat @ quadric @ quadric.T
        rms = np.sqrt((residual**2).sum(axis=1) / (SIDE_PX**2 - 6))
        share = 1.0 - (residual**2).sum(axis=1) / np.maximum((by_plane**2).sum(axis=1), 1e-9)
        good = (rms < _ROUGHEST_MM + _ROUGHEST_MM_PER_M * distance / MM_PER_M) & (rms > 0.05)
        for kind, chosen in (("planes", share < _CURVED), ("curved", share >= _CURVED)):
            k = _thinned(np.flatnonzero(good & chosen))
            features = _surface_features(residual[k].reshape(-1, SIDE_PX, SIDE_PX))
            patches[kind] += zip(
                [number] * len(k), columns[k], np.log(distance[k]), features, strict=True
            )
    return {kind: _collected(SURFACE_FEATURES, rows) for kind, rows in patches.items()}


def edge_patches(frames: Sequence[DepthFrame], shadow_side: str) -> dict[str, Patches]:
    """Cut silhouette patches from the frames, on the lit side and on the shadow side."""
    patches: dict[str, list[_Patch]] = {KINDS[2]: [], KINDS[3]: []}
    shadow, size = 1 if shadow_side == "right" else 0, (_ROWS, _FRONT_PX + _BACK_PX)
    for number, frame in enumerate(frames):
        edges = find_edges(frame)
        for side in (0, 1):
            kind = KINDS[3] if side == shadow else KINDS[2]
            shift = edges.shift_px_per_m
            inside = (edges.side == side) & (edges.row % (_ROWS // 2) == 0)
            inside &= (shift > HEAD_SHIFTS[0]) & (shift < HEAD_SHIFTS[1])
            # The last foreground pixel is in column 7 of a patch, after it is mirrored.
            top = edges.row - _ROWS // 2
            left = edges.column - (_FRONT_PX - 1 if side == 1 else _BACK_PX)
            whole = np.lib.stride_tricks.sliding_window_view(frame.measured_mm, size)
            fits = (top >= 0) & (top < whole.shape[0]) & (left >= 0) & (left < whole.shape[1])
            k = _thinned(np.flatnonzero(inside))
            k = k[fits[k]]
            cut = whole[top[k], left[k]][..., :: 1 if side == 1 else -1].astype(np.float64)
            features = _edge_features(cut, edges.front_mm[k], edges.back_mm[k])
            known = np.isfinite(features).all(axis=1)
            k, features = k[known], features[known]
            patches[kind] += zip(
                [number] * len(k), edges.column[k], shift[k], features, strict=True
            )
    return {kind: _collected(EDGE_FEATURES, rows) for kind, rows in patches.items()}


def _collected(names: tuple[str, ...], rows: list[_Patch]) -> Patches:
    frame, column = (np.array([r[k] for r in rows], np.int64) for k in (0, 1))
    features = np.array([r[3] for r in rows], np.float64).reshape(-1, len(names))
    return Patches(names, features, frame, column, np.array([r[2] for r in rows], np.float64))


def _thinned(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    if len(numbers) <= MOST_PER_FRAME:
        return numbers
    chosen = np.linspace(0, len(numbers) - 1, MOST_PER_FRAME).round().astype(int)
    return np.asarray(numbers[chosen])


def _whole_patches(frame: DepthFrame) -> tuple[Array, NDArray[np.int64]]:
    """Cut (N, 16, 16) smooth patches without holes on a grid of 8 px; return their columns too."""
    step, smooth = SIDE_PX // 2, np.isfinite(surfaces(frame).rough_mm) & lit(frame)
    depth_mm, whole = (
        np.lib.stride_tricks.sliding_window_view(image, (SIDE_PX, SIDE_PX))[::step, ::step]
        for image in (frame.measured_mm, smooth)
    )
    rows, columns = np.nonzero(whole[..., 3:-3, 3:-3].all(axis=(2, 3)))
    return depth_mm[rows, columns].astype(np.float64), step * columns


def _surface_features(e: Array) -> Array:
    """Compute the (N, F) features of (N, 16, 16) residuals."""
    rms = np.sqrt(np.maximum((e**2).mean(axis=(1, 2)), 1e-9))
    products, squares = np.moveaxis(lagged_sums(e, LAGS), -1, 0)
    sign = np.where(np.arange(SIDE_PX) % 2, 1.0, -1.0)[:, None]
    return np.column_stack(
        [
            np.log(rms),
            products / np.maximum(squares, 1e-9),
            np.abs((sign * e).mean(axis=(1, 2))),
            e.mean(axis=2).std(axis=1),
            e.mean(axis=1).std(axis=1),
            np.abs(e).max(axis=(1, 2)) / rms,
        ]
    )


def _edge_features(z: Array, front_mm: Array, back_mm: Array) -> Array:
    """Compute the (N, F) features of (N, 13, 24) patches.

    NaN if fewer than 7 rows of a patch have a foreground, a background and 8 px after the rim.
    """
    known, column = np.isfinite(z), np.arange(z.shape[-1])
    near_mm = np.minimum(0.25 * (back_mm - front_mm), 60.0)[:, None, None]
    front = np.abs(z - front_mm[:, None, None]) < near_mm
    back = np.abs(z - back_mm[:, None, None]) < near_mm
    first = z.shape[-1] - front[..., ::-1].argmax(axis=-1)[..., None]  # after the foreground
    beyond = back & (column >= first)
    gap = (column >= first) & (column < beyond.argmax(axis=-1)[..., None])
    band = (column >= first) & (column < first + 8)
    used = front.any(axis=-1) & beyond.any(axis=-1) & (first[..., 0] + 8 <= z.shape[-1])
    used[used.sum(axis=1) < 7] = False
    width = gap.sum(axis=-1)
    rows = (
        width, (gap & ~known).sum(axis=-1), (gap & known).sum(axis=-1),
        (band & ~known).sum(axis=-1) / 8,
        (band & (z > back_mm[:, None, None] + 50.0)).sum(axis=-1) / 8,
        np.abs(np.diff(known.astype(int), axis=-1)).sum(axis=-1),
    )  # fmt: skip
    count = np.where(used.any(axis=1), used.sum(axis=1), np.nan)
    means = [np.where(used, row, 0).sum(axis=1) / count for row in rows]
    spread = np.sqrt(np.where(used, (width - means[0][:, None]) ** 2, 0).sum(axis=1) / count)
    return np.column_stack([means[0], spread, *means[1:], _rough(z, front), _rough(z, back)])


def _rough(z: Array, used: NDArray[np.bool_]) -> Array:
    """Compute the (N,) roughness, log of mm, of (N, H, W) patches; 0 without used pixels.

    It is the mean second difference along rows.
    """
    bend = np.abs(np.diff(np.where(used, z, np.nan), 2, axis=-1))
    count = np.isfinite(bend).sum(axis=(1, 2))
    mean = np.nansum(np.minimum(bend, 50.0), axis=(1, 2)) / np.maximum(count, 1)
    return np.where(count > 0, np.log(np.maximum(mean, 0.1)), 0.0)
