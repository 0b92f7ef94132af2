"""Lay cloth over a subject at rest: it rests on the shoulders, spans hollows, hangs, and folds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from glsim.appearance.anatomy import Array
from glsim.appearance.cloth import ClothBody
from glsim.appearance.folds import limb_folds, trunk_folds
from glsim.appearance.tubes import Tube, hang
from glsim.geometry.mesh import vertex_normals

#: Cloth that rests on the skin lies this far off, mm, besides its thickness; chosen.
_REST_MM: Final = 1.5
#: Columns over which cloth on a trunk spans hollows: all around people, and on heads with a bust
#: not from the chest to the arms, which are one surface there.
_REACH: Final = {"body": 40, "head": 4}
#: Passes of smoothing that join trunk and limbs.
_SMOOTHING: Final = 8
#: Near the armpits cloth stays closer: it would stand in the way of the arms when they come down.
_ARMPIT_MM: Final = 10.0
_AWAY: Final = 0.3
#: Radius at which the folds of sleeves and legs are drawn, mm.
_LIMB_MM: Final = 60.0
#: Folds of legs are so many times wider and higher than those of sleeves; chosen.
_LEG_FOLDS: Final = (1.7, 0.6)
#: Share of a limb over which it widens into the trunk.
_ROOT: Final = 0.2


@dataclass(frozen=True)
class Fit:
    """How cloth is cut, mm on the subject.

    Args:
        ease: room between skin and cloth where it hangs.
        flare: further room at the hem.
        slope: mm per mm by which the trunk's cloth comes back to the body.
        limb_ease: room around the limbs at their roots.
        limb_flare: further room at their ends.
        limb_slope: as slope, along the limbs.
        fold: height of folds.
        thick: thickness of the cloth.
        hem_mm: height (y) of the trunk's hem.
        cuff: share of the limb that is covered.
        gathered: whether the hem holds the cloth.
        cuffed: whether the cuffs do.
    """

    ease: float
    flare: float
    slope: float
    limb_ease: float
    limb_flare: float
    limb_slope: float
    fold: float
    thick: float
    hem_mm: float
    cuff: float
    gathered: bool
    cuffed: bool


def drape(body: ClothBody, fit: Fit, limbs: tuple[Tube, ...], joint: float, seed: int) -> Array:
    """Return (N, 3) mm where cloth lies over the points of a subject at rest.

    Args:
        body: the subject.
        fit: the cut.
        limbs: arms or legs.
        joint: place of elbow or knee along them, 0 to 1.
        seed: of the folds.
    """
    skin, normal = body.skin, body.normal
    rest = _REST_MM + 0.5 * fit.thick
    offset, fold = rest * normal, np.zeros(len(skin))
    _drape_trunk(body, fit, rest, offset, fold, seed)
    for number, limb in enumerate(limbs):
        _drape_limb(fit, rest, limb, joint, limbs is body.arms, offset, fold, seed + 11 + number)
    surface = _smoothed(body, skin + offset, _SMOOTHING)
    room = ((surface - skin) * normal).sum(axis=1) - rest
    surface += np.maximum(-room, 0.0)[:, None] * normal
    surface = _smoothed(body, surface, 2)
    room = np.maximum(room, 0.0)
    amount = fit.fold * np.clip(0.35 + room / 14.0, 0.35, 1.35)
    height = np.maximum(amount * fold, -0.4 * room)
    out = vertex_normals(surface, body.cloth.grid.faces)
    return np.asarray(surface + height[:, None] * out)


def _drape_trunk(
    body: ClothBody, fit: Fit, rest: float, offset: Array, fold: Array, seed: int
) -> None:
    """Lay cloth around the trunk: change (N, 3) offsets and (N,) heights of folds in place."""
    trunk, skin = body.trunk, body.skin[body.trunk.index]
    hem = float(np.clip(body.neck[1] + 10 - fit.hem_mm, 100.0, None))
    ease = _eases(fit.ease, fit.flare, hem / max(trunk.length_mm, hem), fit.gathered)
    cloth = hang(trunk, rest + ease, fit.slope, _REACH["body" if body.arms else "head"])
    level = 1 - _step(body.normal[trunk.index, 1], 0.35, 0.85)
    weight = level * _step(trunk.along, 15.0, 110.0)
    away = np.linalg.norm(skin[:, None] - body.armpits, axis=2).min(axis=1)
    room = np.minimum(cloth - trunk.radius, rest + _ARMPIT_MM + _AWAY * away)
    _lay(offset, trunk, weight, room)
    local, pits = ((p - body.neck) * (1.0, -1.0, 1.0) for p in (skin, body.armpits))
    share = np.clip(trunk.along / hem, 0, 1)
    fold[trunk.index] = trunk_folds(local, share, pits, seed)


def _drape_limb(
    fit: Fit,
    rest: float,
    limb: Tube,
    joint: float,
    is_arm: bool,
    offset: Array,
    fold: Array,
    seed: int,
) -> None:
    """Lay cloth around a limb: change (N, 3) offsets and (N,) heights of folds in place."""
    share = limb.along / limb.length_mm
    ease = _eases(fit.limb_ease, fit.limb_flare, min(fit.cuff, 1.0), fit.cuffed)
    cloth = hang(limb, rest + ease, fit.limb_slope, 15, _ROOT * limb.length_mm)
    # Over a knee, and over an elbow from behind, cloth is tight when the limb is bent.
    outer = np.cos(limb.angle) * (-1.0 if is_arm else 1.0)
    bend = np.exp(-(((share - joint) / 0.11) ** 2))
    loose = 1 - 0.8 * np.clip(outer + 0.3, 0, 1) * bend
    room = rest + loose * (cloth - limb.radius - rest)
    _lay(offset, limb, _step(limb.along, 0.0, 70.0), room)
    turn = _LIMB_MM * np.stack([np.sin(limb.angle), np.cos(limb.angle)])
    local = np.stack([turn[0], limb.along, turn[1]], axis=1)
    wide, high = (1.0, 1.0) if is_arm else _LEG_FOLDS
    heights = high * loose * limb_folds(local / wide, share, joint, fit.cuff, seed)
    own = np.clip(share / min(fit.cuff, 1.0), 0, 1)
    fade = _step(limb.along, 0.0, 60.0)
    fold[limb.index] = (1 - fade) * fold[limb.index] + fade * heights * (0.4 + 0.6 * own)


def _eases(ease: float, flare: float, hem: float, gathered: bool) -> Array:
    """Return (64,) mm of room from the upper end of a tube to the lower.

    Args:
        ease: where cloth hangs.
        flare: further room at the hem.
        hem: place of the hem, as a share of the tube.
        gathered: whether the hem holds the cloth, which then bulges over it.
    """
    place = np.linspace(0, 1, 64) / hem
    room = ease * _step(place, 0.0, 0.3) + flare * np.clip(place, 0, 1.1)
    if gathered:
        room += 0.3 * (ease + flare) * np.exp(-(((place - 0.86) / 0.08) ** 2))
        room *= 1 - 0.85 * _step(place, 0.9, 0.98)
    return np.asarray(room)


def _lay(offset: Array, tube: Tube, weight: Array, room: Array) -> None:
    """Move the cloth at a tube's points, in place, to ``room`` mm from the skin by a weight."""
    index = tube.index
    offset[index] = (1 - weight)[:, None] * offset[index] + (weight * room)[:, None] * tube.out


def _smoothed(body: ClothBody, surface: Array, passes: int) -> Array:
    """Smooth (N, 3) mm over the grid."""
    edges = body.cloth.grid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = len(surface)
    degree = np.maximum(np.bincount(edges[:, 0], minlength=count), 1)
    columns = [np.ascontiguousarray(surface[:, k]) for k in range(3)]
    start, end = np.ascontiguousarray(edges[:, 0]), np.ascontiguousarray(edges[:, 1])
    for _ in range(passes):
        columns = [0.4 * c + 0.6 * np.bincount(start, c[end], count) / degree for c in columns]
    return np.stack(columns, axis=1)


def _step(value: Array, low: float, high: float) -> Array:
    """Return 0 below low, 1 above high, and a smooth curve between."""
    share = np.clip((value - low) / (high - low), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))
