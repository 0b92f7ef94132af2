"""The nose and the surroundings of the eyes: identity fields (see identity.py)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from glsim.faces.procedural.fields import Canvas, Field, front_share, widen
from glsim.faces.procedural.sculpt import Array, bump, smoothstep
from glsim.faces.procedural.volumes import NASION_Y, SUBNASALE_Y


def nose_height(c: Canvas) -> Array:
    """n-sn (mm)."""
    share = smoothstep(NASION_Y, SUBNASALE_Y, c.y) * smoothstep(-90.0, -45.0, c.y)
    return c.vector(0, -share * smoothstep(52.0, 14.0, c.x) * front_share(c), 0)


def nose_protrusion(c: Canvas) -> Array:
    """sn-prn, from subnasale to the tip (mm)."""
    share = np.interp(c.y, (-30.5, -27.0, -20.0, 26.0), (0.0, 0.4, 1.0, 0.0))
    height = smoothstep(19.0, 39.0, c.z + 0.30 * np.maximum(c.y + 20, 0))
    return c.vector(0, 0, share * (0.25 + 0.75 * height) * smoothstep(22.0, 6.0, c.x))


def nose_breadth(c: Canvas) -> Array:
    """al-al, across the wings (mm)."""
    weight = bump(c.y + 22, 12.0) * smoothstep(34.0, 19.0, c.x) * (c.z > -20)
    return widen(c, 17.3, weight)


def nose_hump(c: Canvas) -> Array:
    """Height of the dorsum at its middle (mm)."""
    return c.vector(0, 0, c.near((0, 4, 24), (8.5, 13, 18)))


def nose_root(c: Canvas) -> Array:
    """Depth of the sellion (mm)."""
    return c.vector(0, 0, -c.near((0, 23, 14), (9, 9, 20)))


def nose_bridge_breadth(c: Canvas) -> Array:
    """Width of the bony bridge (mm)."""
    weight = c.near((8, 6, 16), (7, 17, 16))
    return c.vector(0.6 * weight, 0, 0)


def nose_tip_breadth(c: Canvas) -> Array:
    """Width of the lobule (mm)."""
    weight = c.near((6, -18, 34), (6, 8, 10))
    return c.vector(0.6 * weight, 0, -0.1 * weight)


def nose_tip_lift(c: Canvas) -> Array:
    """Height of the tip (nasolabial angle) (mm)."""
    weight = c.near((0, -20, 37), (12, 11, 13))
    return c.vector(0, weight, 0.15 * weight)


def nose_deviation(c: Canvas) -> Array:
    """Sideways bend (mm)."""
    weight = np.interp(c.y, (-30, -18, 20), (0.4, 1.0, 0.0)) * smoothstep(20.0, 6.0, c.x)
    weight = weight * (c.z > 0)
    return np.stack([weight, 0 * weight, 0 * weight], axis=1)


def interocular(c: Canvas) -> Array:
    """en-en, between the inner corners (mm)."""
    weight = bump(c.y - 17, 20.0) * smoothstep(3.0, 16.0, c.x) * smoothstep(75.0, 44.0, c.x)
    return c.vector(0.5 * weight * front_share(c), 0, 0)


def eye_depth(c: Canvas) -> Array:
    """Globe behind the orbital rim (mm)."""
    return c.vector(0, 0, -c.near((33, 14, 2), (25, 21, 36)))


def lid_hood(c: Canvas) -> Array:
    """Fullness above the upper lid (mm)."""
    weight = c.near((36, 25, 2), (15, 5.0, 20))
    return c.vector(0, -0.35 * weight, 0.9 * weight)


def tear_trough(c: Canvas) -> Array:
    """Depth of the furrow under the lower lid (mm)."""
    x = np.clip(c.x, 17.0, 42.0)
    y = 3.5 - 5.0 * np.sin(np.pi * (x - 17.0) / 50.0)
    weight = bump(c.y - y, 3.0) * bump(c.x - 27, 10.0) * (c.z > -25)
    return c.vector(0, 0, -1.2 * weight)


def eye_level_asymmetry(c: Canvas) -> Array:
    """Left eye higher than the right (mm)."""
    weight = bump(c.y - 17, 20.0) * smoothstep(8.0, 22.0, c.x) * front_share(c)
    return c.vector(0, 0.5 * c.side * weight, 0)


FIELDS: Mapping[str, Field] = {
    field.__name__: field
    for field in (
        nose_height,
        nose_protrusion,
        nose_breadth,
        nose_hump,
        nose_root,
        nose_bridge_breadth,
        nose_tip_breadth,
        nose_tip_lift,
        nose_deviation,
        interocular,
        eye_depth,
        lid_hood,
        tear_trough,
        eye_level_asymmetry,
    )
}
