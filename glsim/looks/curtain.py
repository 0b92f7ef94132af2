"""Hair that hangs: a rough sheet from the sides and the back of the head down, open at the face."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.core.products import product
from glsim.looks.anatomy import Anatomy, Array, Mask
from glsim.looks.locks import Locks, Obstacle
from glsim.looks.noise import ridges, smooth_noise
from glsim.looks.scalp import Scalp
from glsim.looks.styles import HairStyle

#: Columns of the sheet around the head, 6 mm apart, and mm between its rows; chosen: as fine as
#: two pixels of a Kinect V2 at 0.9 m.
_COLUMNS, _ROW_MM = 76, 10.0
#: The sheet begins at this height over the middle of the skull, as a sine.
_START = 0.18
#: Ridges between strands across the sheet, mm, and how far they are drawn out.
_RIDGE_MM, _ALONG = 13.0, 0.13


def hanging_hair(
    anatomy: Anatomy,
    scalp: Scalp,
    base: Array,
    thickness: Array,
    obstacle: Obstacle,
    style: HairStyle,
    rng: np.random.Generator,
) -> Locks:
    """Return the sheet of a style with ``hang``; it is seen from both sides.

    Args:
        base: (N, 3) the scalp's points.
        thickness: (N,) mm.
    """
    scale = anatomy.scale
    # From the left temple over the back to the right one; the face stays open.
    front = np.radians(style.open_deg)
    angle = np.linspace(front, 2 * np.pi - front, _COLUMNS)
    level = np.sqrt(1 - _START**2)
    rays = np.stack([np.sin(angle) * level, np.full(_COLUMNS, _START), np.cos(angle) * level], 1)
    root = np.argmax(product(rays.astype(np.float32), scalp.directions.T), axis=1)
    fall = style.hang * scale * rng.uniform(0.85, 1.15)
    rows = int(np.ceil(fall * 1.1 / _ROW_MM)) + 1
    place = base[root] + rays * (0.75 * thickness[root])[:, None]
    flare = np.stack([np.sin(angle), np.zeros(_COLUMNS), np.cos(angle)], 1) * style.flare
    lines = [place]
    for row in range(1, rows):
        share = row / rows
        step = np.array([0.0, -1.0, 0.0]) + flare * (1 - 1.6 * share)
        place = place + step * _ROW_MM
        place = obstacle.push_out(place, np.full(_COLUMNS, 0.45 * style.side * scale))
        lines.append(place)
    sheet = _smoothed(np.stack(lines))  # (rows, columns, 3)
    out = np.stack([np.sin(angle), np.full(_COLUMNS, 0.1), np.cos(angle)], 1)
    arc = angle * 85.0 * scale
    down = np.arange(rows) * _ROW_MM
    where = np.stack(np.broadcast_arrays(arc[None, :], down[:, None], 0.0), axis=2)
    seed = int(rng.integers(1 << 31))
    stretch = np.array([1.0, 1.0 if style.comb == "curls" else _ALONG, 1.0])
    strands = (where * stretch).reshape(-1, 3)
    relief = 0.7 * ridges(strands / _RIDGE_MM, seed) + 0.4 * smooth_noise(strands / 7.0, seed + 1)
    slow = smooth_noise((where * (0.5, 0.3, 1)).reshape(-1, 3) / 25.0, seed + 2)
    swing = np.sin(2 * np.pi * down[:, None] / (52 * scale) + 2.5 * slow.reshape(rows, -1))
    grown = np.minimum(down / 30.0, 1.0)[:, None]
    height = style.relief * 1.1 * relief.reshape(rows, -1) + grown * (
        0.5 * style.wave * swing + 3.0 * slow.reshape(rows, -1)
    )
    sheet = sheet + height[..., None] * out
    end = fall * (1 + 0.10 * smooth_noise(np.stack([arc / 16, 0 * arc, 0 * arc], 1), seed + 3))
    end += 12 * smooth_noise(np.stack([arc / 7, 0 * arc, 0 * arc], 1), seed + 4)
    sheet = _stretched(sheet, end / down[-1])
    # Gaps open towards the tips and at the two edges beside the face.
    torn = smooth_noise((where * (1 / 9, 1 / 60, 1)).reshape(-1, 3), seed + 5).reshape(rows, -1)
    rim = np.minimum(np.arange(_COLUMNS), np.arange(_COLUMNS)[::-1])
    kept = torn < 1.15 - 0.75 * (down / fall)[:, None] ** 3
    kept &= torn < 0.1 + rim[None, :] * 0.35
    return _two_sided(sheet, kept, root)


def _stretched(sheet: Array, share: Array) -> Array:
    """Shorten each column of (rows, columns, 3) to its (columns,) share of the length."""
    rows = len(sheet)
    at = np.arange(rows)[:, None] * np.minimum(share, 1.0)[None, :]
    low = np.minimum(at.astype(int), rows - 2)
    part = (at - low)[..., None]
    lower = np.take_along_axis(sheet, low[..., None], axis=0)
    upper = np.take_along_axis(sheet, low[..., None] + 1, axis=0)
    return np.asarray(lower + part * (upper - lower))


def _smoothed(sheet: Array) -> Array:
    """Smooth (rows, columns, 3) over neighbours; the first row stays."""
    for _ in range(4):
        wide = np.concatenate([sheet[:, :1], sheet, sheet[:, -1:]], axis=1)
        sheet = 0.25 * wide[:, :-2] + 0.5 * sheet + 0.25 * wide[:, 2:]
        middle = 0.25 * sheet[:-2] + 0.5 * sheet[1:-1] + 0.25 * sheet[2:]
        sheet = np.concatenate([sheet[:1], middle, sheet[-1:]])
    return sheet


def _two_sided(sheet: Array, kept: Mask, root: NDArray[np.int64]) -> Locks:
    rows, columns = kept.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    whole = kept[:-1, :-1] & kept[:-1, 1:] & kept[1:, :-1] & kept[1:, 1:]
    p, q, r, s = (
        part[whole] for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
    )
    outer = np.concatenate([np.stack([p, r, q], 1), np.stack([p, s, r], 1)])
    faces = np.concatenate([outer, outer[:, ::-1]])
    return Locks(np.broadcast_to(root, (rows, columns)).reshape(-1), sheet.reshape(-1, 3), faces)
