"""Small depth patches and their fixed features, for the classifier.

Planes and curved surfaces are 16 x 16 px, complete and without steps; their features are of the
residual from a quadric, so that shape and pose do not count. Silhouettes are 13 rows x 24 px around
the rim, mirrored so that the foreground is on the left. All features are of depth alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.correlation import LAGS, lagged_sums
from glsim.bench.measures.measured_frame import lit, surfaces
from glsim.bench.measures.quadrics import quadric_basis
from glsim.bench.measures.silhouettes import HEAD_SHIFTS, find_edges
from glsim.core.depth_frame import DepthFrame

Array = NDArray[np.float64]

#: One patch: number of its frame, first column, matched quantity, features.
_Found = tuple[int, int, float, Array]

KINDS = ("planes", "curved", "silhouettes, lit side", "silhouettes, shadow side")
SIDE_PX = 16
_ROWS, _FRONT_PX, _BACK_PX = 13, 8, 16
#: Most patches of a kind from one frame.
MOST_PER_FRAME = 120
#: A patch is curved if a quadric explains this share of the variance about a plane.
_CURVED = 0.5
#: Largest residual of a patch without an edge, mm and mm per m of distance.
_ROUGHEST_MM, _ROUGHEST_MM_PER_M = 3.0, 2.0

SURFACE_FEATURES = (
    "log of the residual",
    "correlation at 1 px along x",
    "correlation at 2 px along x",
    "correlation at 3 px along x",
    "correlation at 1 px along y",
    "correlation at 2 px along y",
    "correlation at 3 px along y",
    "correlation on the diagonal",
    "step between odd and even rows",
    "spread of the rows' means",
    "spread of the columns' means",
    "largest residual over their rms",
)
EDGE_FEATURES = (
    "width of the gap",
    "spread of the width over the rows",
    "invalid pixels of the gap",
    "flying pixels of the gap",
    "invalid share of 8 px outside",
    "share behind the background",
    "valid-invalid changes in a row",
    "log of the foreground's residual",
    "log of the background's residual",
)


@dataclass(frozen=True, eq=False)
class Patches:
    """Patches of one kind, with their features.

    Attributes:
        names: of the F features.
        features: (N, F).
        frame: (N,) number of the frame of each.
        column: (N,) its first column, px.
        matched: (N,) log of the distance in mm for surfaces, S in px per m for silhouettes.
    """

    names: tuple[str, ...]
    features: Array
    frame: NDArray[np.int64]
    column: NDArray[np.int64]
    matched: Array


def surface_patches(frames: Sequence[DepthFrame]) -> dict[str, Patches]:
    """Cut plane and curved surface patches from the frames, at every half patch."""
    found: dict[str, list[_Found]] = {"planes": [], "curved": []}
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
        good = (rms < _ROUGHEST_MM + _ROUGHEST_MM_PER_M * distance / 1000.0) & (rms > 0.05)
        for kind, chosen in (("planes", share < _CURVED), ("curved", share >= _CURVED)):
            kept = _thinned(np.flatnonzero(good & chosen))
            features = _surface_features(residual[kept].reshape(-1, SIDE_PX, SIDE_PX))
            found[kind] += zip(
                [number] * len(kept), columns[kept], np.log(distance[kept]), features, strict=True
            )
    return {kind: _collected(SURFACE_FEATURES, rows) for kind, rows in found.items()}


def edge_patches(frames: Sequence[DepthFrame], shadow_side: str) -> dict[str, Patches]:
    """Cut silhouette patches from the frames, on the lit side and on the shadow side."""
    found: dict[str, list[_Found]] = {KINDS[2]: [], KINDS[3]: []}
    shadow = 1 if shadow_side == "right" else 0
    for number, frame in enumerate(frames):
        edges = find_edges(frame)
        for side in (0, 1):
            kind = KINDS[3] if side == shadow else KINDS[2]
            inside = (edges.side == side) & (edges.row % (_ROWS // 2) == 0)
            inside &= (edges.shift_px_per_m > HEAD_SHIFTS[0]) & (
                edges.shift_px_per_m < HEAD_SHIFTS[1]
            )
            for k in _thinned(np.flatnonzero(inside)):
                patch = _edge_patch(
                    frame.measured_mm, int(edges.row[k]), int(edges.column[k]), side
                )
                if patch is None:
                    continue
                features = _edge_features(patch, edges.front_mm[k], edges.back_mm[k])
                if features is not None:
                    shift = float(edges.shift_px_per_m[k])
                    found[kind].append((number, int(edges.column[k]), shift, features))
    return {kind: _collected(EDGE_FEATURES, rows) for kind, rows in found.items()}


def _collected(names: tuple[str, ...], rows: list[_Found]) -> Patches:
    return Patches(
        names,
        np.array([r[3] for r in rows], np.float64).reshape(-1, len(names)),
        np.array([r[0] for r in rows], np.int64),
        np.array([r[1] for r in rows], np.int64),
        np.array([r[2] for r in rows], np.float64),
    )


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


def _edge_patch(depth_mm: NDArray[np.float32], row: int, column: int, side: int) -> Array | None:
    """Cut 13 x 24 px with the last foreground pixel in column 7; None at the image border."""
    top = row - _ROWS // 2
    left = column - _FRONT_PX + 1 if side == 1 else column - _BACK_PX
    height, width = depth_mm.shape
    size = _FRONT_PX + _BACK_PX
    if top < 0 or left < 0 or top + _ROWS > height or left + size > width:
        return None
    patch = depth_mm[top : top + _ROWS, left : left + size].astype(np.float64)
    return patch if side == 1 else patch[:, ::-1]


def _edge_features(patch: Array, front_mm: float, back_mm: float) -> Array | None:
    """Compute the features; None if fewer than 7 rows have a foreground and a background."""
    known = np.isfinite(patch)
    z = np.nan_to_num(patch)
    step = 0.25 * (back_mm - front_mm)
    front = known & (np.abs(z - front_mm) < min(step, 60.0))
    back = known & (np.abs(z - back_mm) < min(step, 60.0))
    widths, invalid, flying, band, behind, changes = [], [], [], [], [], []
    for r in range(len(patch)):
        ahead = np.flatnonzero(front[r])
        if len(ahead) == 0:
            continue
        a = int(ahead[-1]) + 1
        beyond = np.flatnonzero(back[r, a:])
        if len(beyond) == 0 or a + 8 > patch.shape[1]:
            continue
        b = a + int(beyond[0])
        widths.append(b - a)
        invalid.append((~known[r, a:b]).sum())
        flying.append(known[r, a:b].sum())
        band.append((~known[r, a : a + 8]).mean())
        behind.append((z[r, a : a + 8] > back_mm + 50.0).mean())
        changes.append(np.abs(np.diff(known[r].astype(int))).sum())
    if len(widths) < 7:
        return None
    return np.array(
        [
            np.mean(widths), np.std(widths), np.mean(invalid), np.mean(flying), np.mean(band),
            np.mean(behind), np.mean(changes), _rough(patch, front), _rough(patch, back),
        ]
    )  # fmt: skip


def _rough(patch: Array, used: NDArray[np.bool_]) -> float:
    """Compute the log of the mean absolute second difference along rows, mm; 0 without pixels."""
    z = np.where(used, patch, np.nan)
    bend = np.abs(z[:, :-2] - 2 * z[:, 1:-1] + z[:, 2:])
    bend = bend[np.isfinite(bend)]
    return float(np.log(max(float(np.mean(np.minimum(bend, 50.0))), 0.1))) if bend.size else 0.0
