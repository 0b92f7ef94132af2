"""Give the gaps of a depth map to the surfaces at their ends.

A gap between a near and a far surface is the far one's (a shadow, or the rim that cameras leave), a
gap within a surface is a hole in it, and the far surface goes on behind the rim of the near one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.measures.surfaces import step_limit_mm

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Depths at the ends of a gap are of two surfaces if they differ by more than this many times what
#: neighbours on one surface may; chosen.
_APART = 3.0
#: The rim of a near surface is its last measured pixel plus this many; chosen: half of the gap of
#: two to three pixels that all cameras leave on the side without shadow.
_RIM_PX = 1
#: Widest gap that is given to a surface, px: a head at 0.6 m before a wall at 3 m has 24.
_WIDEST_GAP_PX = 80
#: Widest empty band at the image's border onto which a surface goes on, px: a D435's at 0.4 m.
_WIDEST_BAND_PX = 60
#: How far a far surface goes on behind a near one, px: more than any camera here sees around it.
_BEHIND_PX = 60


def fill_rows(z: Array, label: Labels, widest_hole_px: int) -> tuple[Array, Labels, Labels]:
    """Give the gaps of each row to the surfaces at their ends.

    Args:
        z: (H, W) depth, mm, NaN in gaps.
        label: (H, W) number of the surface, -1 in gaps.
        widest_hole_px: holes within a surface are closed up to this width.

    Returns:
        Depth and labels with the gaps filled, and the flat index of the pixel whose reflectivity
        each pixel has: its own, or that of the end of the gap.

    """
    out, own = z.copy(), label.copy()
    source = np.arange(z.size, dtype=np.int64).reshape(z.shape)
    width = z.shape[1]
    for row in range(z.shape[0]):
        known = np.flatnonzero(np.isfinite(z[row]))
        if known.size == 0:
            continue
        for a, b in _gaps(known, width):
            _fill_gap((out[row], own[row], source[row]), z[row], a, b, widest_hole_px)
    return out, own, source


def fill_columns(
    z: Array, label: Labels, source: Labels, widest_hole_px: int
) -> tuple[Array, Labels, Labels]:
    """Close what the rows left open, column by column. Arguments and result as ``fill_rows``."""
    turned = fill_rows(np.ascontiguousarray(z.T), np.ascontiguousarray(label.T), widest_hole_px)
    out, own, place = turned
    height = z.shape[0]  # indices count along the columns of the turned image
    rows, columns = place.T % height, place.T // height
    return np.ascontiguousarray(out.T), np.ascontiguousarray(own.T), source[rows, columns]


def _gaps(known: NDArray[np.int64], width: int) -> list[tuple[int, int]]:
    """Return (last known pixel before, first after) of each gap; -1 and width at the borders."""
    ends = np.concatenate([[-1], known, [width]])
    wide = np.flatnonzero(np.diff(ends) > 1)
    return [(int(ends[k]), int(ends[k + 1])) for k in wide]


def _fill_gap(
    row: tuple[Array, Labels, Labels], z: Array, a: int, b: int, widest_hole_px: int
) -> None:
    """Fill the pixels between a and b of a row (depth, label, source of the light) in place."""
    out, label, source = row
    width = len(z)
    if b - a - 1 > _WIDEST_GAP_PX:
        return
    if a < 0 or b >= width:  # the band at the border: the surface goes on
        if b - a - 1 > _WIDEST_BAND_PX:
            return
        inner = b if a < 0 else a
        chosen = slice(0, b) if a < 0 else slice(a + 1, width)
        out[chosen], label[chosen], source[chosen] = z[inner], label[inner], source[inner]
        return
    near_left = z[a] < z[b]
    near, far = (a, b) if near_left else (b, a)
    if z[far] - z[near] <= _APART * step_limit_mm(z[near]):
        if b - a - 1 > widest_hole_px:
            return
        share = (np.arange(a + 1, b) - a) / (b - a)
        out[a + 1 : b] = 1.0 / ((1 - share) / z[a] + share / z[b])
        label[a + 1 : b] = label[a]
        return
    rim = min(_RIM_PX, b - a - 1)
    fronts = slice(a + 1, a + 1 + rim) if near_left else slice(b - rim, b)
    backs = slice(a + 1 + rim, b) if near_left else slice(a + 1, b - rim)
    for chosen, end in ((fronts, near), (backs, far)):
        out[chosen], label[chosen], source[chosen] = z[end], label[end], source[end]


def continue_behind(front: Array) -> tuple[Array, Labels]:
    """Continue far surfaces behind the rims of near ones, along rows, then along columns.

    Args:
        front: (H, W) depth that the camera sees, mm, NaN = none.

    Returns:
        (H, W) depth behind it, mm, and of the far surface's own last pixel; NaN elsewhere. And the
        flat index of that last pixel, whose reflectivity the continued surface has.

    """
    depth, place = _behind_rows(front)
    turned, turned_place = (part.T for part in _behind_rows(np.ascontiguousarray(front.T)))
    height, width = front.shape
    by_rows = np.isfinite(depth)
    upright = turned_place % height * width + turned_place // height
    return np.where(by_rows, depth, turned), np.where(by_rows, place, upright)


def _behind_rows(front: Array) -> tuple[Array, Labels]:
    """Return the depth behind the rims of each row, and the flat index that it comes from."""
    out, place = np.full(front.shape, np.nan), np.zeros(front.shape, np.int64)
    width = front.shape[1]
    with np.errstate(invalid="ignore"):
        change = np.diff(front, axis=1)
        limit = _APART * step_limit_mm(np.minimum(front[:, 1:], front[:, :-1]))
        rows, columns = np.nonzero(np.abs(change) > limit)
    for row, column in zip(rows, columns, strict=True):
        z = front[row]
        near, far, way = (column, column + 1, -1) if z[column] < z[column + 1] else (
            column + 1, column, 1)  # fmt: skip
        depth = z[far]
        end = near + way * _BEHIND_PX
        span = np.arange(near, np.clip(end, -1, width), way)
        with np.errstate(invalid="ignore"):
            open_from = np.flatnonzero(~(z[span] < depth - 1.0))
        span = span[: open_from[0]] if open_from.size else span
        nearer = ~(out[row, span] <= depth)  # NaN: nothing was continued there yet
        out[row, span[nearer]], place[row, span[nearer]] = depth, row * width + far
        # The two meshes overlap by a pixel.
        out[row, far], place[row, far] = depth, row * width + far
    return out, place
