"""Skirts: one tube of cloth around both legs, which follows each leg on its side."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array, Mask
from glsim.appearance.binding import Binding, Motion, Points
from glsim.appearance.cloth import ClothBody
from glsim.appearance.folds import crests
from glsim.appearance.garments import Lower
from glsim.appearance.scalp import Anchors
from glsim.appearance.shell import Shell
from glsim.appearance.skin_grid import SkinGrid
from glsim.appearance.tubes import ROW_MM, Tube, cells_of, hanging_lattice, make_tube

#: Columns around a skirt: 15 mm apart at the hips.
_COLUMNS: Final = 72
#: Between the legs, mm to each side, a skirt follows both.
_BETWEEN_MM: Final = 70.0
#: Cloth this near to the legs, mm, as far down from the waist as the thighs reach; chosen.
_NEAR_MM, _THIGH_MM, _STEEP = 22.0, 560.0, 3.0
#: Passes of smoothing down a skirt, which does not bend sharply.
_STIFF: Final = 24
#: Rows of the waistband, and how far it stands off, mm.
_BAND_ROWS, _BAND_MM = 3, 2.5
#: Hem: (mm nearer to the axis, mm up) of the rows that turn inside, and how far one looks in.
_HEM: Final = ((1.5, -1.0), (3.5, 0.0), (4.0, 18.0))
_SEEN_ROWS: Final = 14


class Between:
    """A shell that follows one side of the body on the left, the other on the right."""

    def __init__(self, left: Shell, right: Shell, share: Array) -> None:
        """Join two shells of the same N points.

        Args:
            left, right: both sides.
            share: (N,) of the left one.
        """
        self.used = np.concatenate([left.used, right.used])
        self._sides = left, right
        self._share = share.astype(np.float32)[:, None]

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) points over a mesh of the source."""
        left, right = (side.place(vertices_mm, motion) for side in self._sides)
        left -= right
        left *= self._share
        left += right
        return left


def make_skirt(
    body: ClothBody, lower: Lower, over: bool, scale: float, seed: int
) -> tuple[Binding, NDArray[np.int32], NDArray[np.int32]]:
    """Return a skirt, its triangles and those that cast shadows, of a body with legs.

    Arguments as of ``tailor.make_lower``.
    """
    cloth, skin = body.cloth, body.skin
    on_leg = np.isfinite(cloth.leg)
    top = body.waist_mm + 12.0
    end = body.crotch_mm - lower.length * (body.crotch_mm - float(skin[on_leg, 1].min()))
    torso = ~np.isfinite(cloth.arm) & ~cloth.foot
    index = np.flatnonzero(torso & (skin[:, 1] < top + 8) & (skin[:, 1] > end))
    depth = skin[index, 2]
    start = np.array([body.neck[0], top, 0.5 * (depth.min() + depth.max())])
    down, ahead = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    tube = make_tube(index, skin[index], start, start + down, ahead, _COLUMNS)
    waist = 10.0 if over else 3.0
    ease = np.interp(np.linspace(0, 1, 32), (0, 0.15, 0.4), (waist, waist, lower.ease * scale))
    radius = hanging_lattice(tube, ease, lower.slope, _COLUMNS // 2)
    rows = len(radius)
    # Over the thighs it stays near: it would stand up in the lap of somebody who sits.
    near = hanging_lattice(tube, ease, _STEEP, _COLUMNS // 2)
    below = np.maximum(np.arange(rows) * ROW_MM - _THIGH_MM * scale, 0.0)[:, None]
    radius = np.minimum(radius, near + (_NEAR_MM + 0.25 * below) * scale)
    for _ in range(_STIFF):
        wide = np.concatenate([radius[:1], radius, radius[-1:]])
        radius = np.maximum(0.25 * wide[:-2] + 0.5 * radius + 0.25 * wide[2:], near)
    share = np.linspace(0, 1, rows)[:, None]
    angle = np.arange(_COLUMNS) * 2 * np.pi / _COLUMNS
    way = np.stack([np.sin(angle), np.zeros(_COLUMNS), np.cos(angle)], axis=1)
    row_mm = np.broadcast_to(np.arange(rows)[:, None] * ROW_MM, radius.shape)
    ring = 170.0 * way
    flutes = crests(
        np.stack(
            [np.broadcast_to(ring[:, k], radius.shape).ravel() / 95 for k in (0, 2)]
            + [row_mm.ravel() / 700],
            axis=1,
        ),
        seed + 60,
    ).reshape(radius.shape)
    radius = radius + lower.fold * scale * np.maximum(flutes, -0.3) * np.sqrt(share)
    radius[:_BAND_ROWS] += _BAND_MM
    levels = [start[1] - row_mm]
    inner = [radius]
    for nearer, up in _HEM:
        inner.append(radius[-1:] - nearer)
        levels.append(start[1] - row_mm[-1:] + up)
    radius, level = np.concatenate(inner), np.concatenate(levels)
    places = (start + radius[..., None] * way).reshape(-1, 3)
    places[:, 1] = level.ravel()
    faces, inside = _lattice_faces(len(radius), rows)
    beside = places[:, 0] - start[0]
    smooth = np.clip(0.5 + 0.5 * beside / _BETWEEN_MM, 0, 1)
    shells = []
    for side in (1.0, -1.0):
        near = side * (skin[index, 0] - start[0]) > -5.0
        point = index[_nearest(tube, near, len(radius))]
        anchors = cloth.grid.anchors.taken(point)
        shells.append(_bound(body, anchors, faces, places - skin[point]))
    outside = faces.astype(np.int32)
    both = np.concatenate([outside, inside.astype(np.int32)])
    left, right = shells
    return Between(left, right, smooth * smooth * (3 - 2 * smooth)), both, outside


def _bound(body: ClothBody, anchors: Anchors, faces: NDArray[np.int64], offset: Array) -> Shell:
    grid = body.cloth.grid
    whole = SkinGrid(grid.base, grid.triangles, anchors, faces)
    return Shell(whole.taken(np.ones(len(faces), bool))[0], body.rest_mm, offset)


def _lattice_faces(rows: int, outer: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles of a closed lattice, and those of its inner side near the hem."""
    number = np.arange(rows * _COLUMNS).reshape(rows, _COLUMNS)
    left, right = number, np.roll(number, -1, axis=1)

    def between(first: int, last: int) -> NDArray[np.int64]:
        a, b, c, d = (
            part.ravel()
            for part in (left[first:last - 1], right[first:last - 1], right[first + 1:last],
                         left[first + 1:last])
        )  # fmt: skip
        return np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])

    inside = between(max(outer - _SEEN_ROWS, 0), outer)
    return between(0, rows), inside[:, ::-1]


def _nearest(tube: Tube, near: Mask, rows: int) -> NDArray[np.int64]:
    """Return (rows * columns,) the outermost of the chosen points in every cell or beside it.

    Rows beyond the tube's end, of the hem, have those of its last one.

    Args:
        tube: the tube.
        near: (M,) which points may be taken.
        rows: of the lattice.
    """
    own, cell = cells_of(tube)
    chosen = np.flatnonzero(near)
    order = chosen[np.argsort(tube.radius[chosen], kind="stable")]  # the outermost is written last
    found = np.full(own * tube.count, -1)
    found[cell[order]] = order
    lattice = found.reshape(own, tube.count)
    column = np.arange(tube.count)
    filled = np.flatnonzero((lattice >= 0).any(axis=1))
    for row in filled:
        have = np.flatnonzero(lattice[row] >= 0)
        apart = np.abs(column[:, None] - have)
        lattice[row] = lattice[row, have[np.minimum(apart, tube.count - apart).argmin(axis=1)]]
    nearest = filled[np.abs(np.arange(own)[:, None] - filled).argmin(axis=1)]
    whole = lattice[nearest][np.minimum(np.arange(rows), own - 1)]
    return np.asarray(whole.ravel())
