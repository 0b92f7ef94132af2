"""The mouth, the jaw and the neck: identity fields (see identity.py)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from glsim.faces.procedural import mouth
from glsim.faces.procedural.fields import Canvas, Field, front_share, widen
from glsim.faces.procedural.sculpt import Array, bump, smoothstep
from glsim.faces.procedural.volumes import SUBNASALE_Y


def mouth_width(c: Canvas) -> Array:
    """ch-ch (mm)."""
    weight = bump(c.y - mouth.STOMION_Y, 15.0) * smoothstep(46.0, 25.0, c.x) * (c.z > -60)
    return widen(c, mouth.CORNER_X, weight)


def _lip_taper(c: Canvas) -> Array:
    s = np.clip(c.x / mouth.CORNER_X, 0.0, 1.0)
    return np.asarray((1 - s**2) * (c.z > -10))


def upper_lip(c: Canvas) -> Array:
    """Height of the upper vermilion (mm)."""
    top = mouth.upper_border(c.x)
    share = (c.y - mouth.stomion_line(c.x)) / np.maximum(top - mouth.stomion_line(c.x), 1.0)
    lift = np.interp(share, (0.0, 1.0, 2.3), (0.0, 1.0, 0.0))
    full = bump(share - 0.5, 0.5)
    return c.vector(0, _lip_taper(c) * lift * 0.9, 0.55 * _lip_taper(c) * full)


def lower_lip(c: Canvas) -> Array:
    """Height of the lower vermilion (mm)."""
    line, bottom = mouth.stomion_line(c.x), mouth.lower_border(c.x)
    share = (line - c.y) / np.maximum(line - bottom, 1.0)
    lift = np.interp(share, (0.0, 1.0, 1.9), (0.0, 1.0, 0.0))
    full = bump(share - 0.5, 0.5)
    return c.vector(0, -_lip_taper(c) * lift * 0.9, 0.55 * _lip_taper(c) * full)


def lip_protrusion(c: Canvas) -> Array:
    """Of both lips, against the face (mm)."""
    return c.vector(0, 0, c.near((0, -49, 20), (23, 12, 25)))


def philtrum_length(c: Canvas) -> Array:
    """Moves the mouth down under a fixed nose; the chin gives way."""
    share = smoothstep(SUBNASALE_Y, -42.0, c.y) * smoothstep(-84.0, -54.0, c.y)
    return c.vector(0, -share * smoothstep(58.0, 24.0, c.x) * (c.z > -60), 0)


def philtrum_depth(c: Canvas) -> Array:
    """Depth of the groove (mm)."""
    along = smoothstep(-30.0, -34.0, c.y) * smoothstep(-44.0, -41.0, c.y) * (c.z > 0)
    return c.vector(0, 0, along * (0.6 * bump(c.x - 5.6, 2.6) - 1.0 * bump(c.x, 3.4)))


def mouth_tilt(c: Canvas) -> Array:
    """Left corner higher than the right (mm)."""
    weight = c.near((24, -49, 10), (16, 16, 30))
    return c.vector(0, 0.5 * c.side * weight, 0)


def jaw_breadth(c: Canvas) -> Array:
    """go-go, across the jaw, skin to skin (mm)."""
    weight = bump(c.y + 60, 30.0) * smoothstep(12.0, 42.0, c.x) * smoothstep(-110.0, -70.0, c.z)
    return widen(c, 51.0, weight)


def jaw_angle_height(c: Canvas) -> Array:
    """Height of the gonion (mm)."""
    return c.vector(0, c.near((48, -68, -58), (20, 22, 30)), 0)


def chin_protrusion(c: Canvas) -> Array:
    """Pogonion against the mean (mm)."""
    weight = c.near((0, -84, 12), (28, 17, 34))
    return c.vector(0, 0, weight)


def chin_breadth(c: Canvas) -> Array:
    """Width of the mental tubercles (mm)."""
    weight = c.near((18, -84, 6), (12, 13, 22))
    return c.vector(0.5 * weight, 0, 0.25 * weight)


def chin_height(c: Canvas) -> Array:
    """sl-gn against the mean (mm)."""
    share = smoothstep(-62.0, -90.0, c.y) * smoothstep(-140.0, -104.0, c.y)
    return c.vector(0, -share * smoothstep(-60.0, -10.0, c.z), 0)


def chin_cleft(c: Canvas) -> Array:
    """Depth of the cleft (mm)."""
    return c.vector(0, 0, -c.near((0, -83, 16), (4.5, 7, 12)))


def jaw_asymmetry(c: Canvas) -> Array:
    """Chin to the left (mm)."""
    weight = smoothstep(-45.0, -85.0, c.y) * smoothstep(-125.0, -100.0, c.y) * front_share(c)
    return np.stack([weight, 0 * weight, 0 * weight], axis=1)


def neck_breadth(c: Canvas) -> Array:
    """Width under the jaw (mm)."""
    weight = smoothstep(-62.0, -105.0, c.y) * smoothstep(0.0, -45.0, c.z)
    side = 0.5 * np.minimum(c.x / 55.0, 1.0) * weight
    return c.vector(side, 0, 0.35 * weight * smoothstep(-150.0, -90.0, c.z))


def adams_apple(c: Canvas) -> Array:
    """Laryngeal prominence (mm)."""
    return c.vector(0, 0, c.near((0, -122, -48), (11, 15, 25)))


FIELDS: Mapping[str, Field] = {
    field.__name__: field
    for field in (
        mouth_width,
        upper_lip,
        lower_lip,
        lip_protrusion,
        philtrum_length,
        philtrum_depth,
        mouth_tilt,
        jaw_breadth,
        jaw_angle_height,
        chin_protrusion,
        chin_breadth,
        chin_height,
        chin_cleft,
        jaw_asymmetry,
        neck_breadth,
        adams_apple,
    )
}
