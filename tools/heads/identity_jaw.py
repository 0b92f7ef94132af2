"""Identity fields of the mouth and the jaw (see identity.py)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tools.heads import mouth
from tools.heads.falloff import Array, bump, smoothstep
from tools.heads.fields import Field, FieldPoints, front_weight, widen
from tools.heads.volumes import SUBNASALE_Y


def mouth_width(p: FieldPoints) -> Array:
    """Width of the mouth, ch-ch (mm)."""
    weight = bump(p.y - mouth.STOMION_Y, 15.0) * smoothstep(46.0, 25.0, p.x) * (p.z > -60)
    return widen(p, mouth.CORNER_X, weight)


def _lip_taper(p: FieldPoints) -> Array:
    s = np.clip(p.x / mouth.CORNER_X, 0.0, 1.0)
    return np.asarray((1 - s**2) * (p.z > -10))


def upper_lip(p: FieldPoints) -> Array:
    """Height of the upper vermilion (mm)."""
    top = mouth.upper_border(p.x)
    share = (p.y - mouth.stomion_line(p.x)) / np.maximum(top - mouth.stomion_line(p.x), 1.0)
    lift = np.interp(share, (0.0, 1.0, 2.3), (0.0, 1.0, 0.0))
    full = bump(share - 0.5, 0.5)
    return p.displacement(0, _lip_taper(p) * lift * 0.9, 0.55 * _lip_taper(p) * full)


def lower_lip(p: FieldPoints) -> Array:
    """Height of the lower vermilion (mm)."""
    line, bottom = mouth.stomion_line(p.x), mouth.lower_border(p.x)
    share = (line - p.y) / np.maximum(line - bottom, 1.0)
    lift = np.interp(share, (0.0, 1.0, 1.9), (0.0, 1.0, 0.0))
    full = bump(share - 0.5, 0.5)
    return p.displacement(0, -_lip_taper(p) * lift * 0.9, 0.55 * _lip_taper(p) * full)


def lip_protrusion(p: FieldPoints) -> Array:
    """Protrusion of both lips relative to the face (mm)."""
    return p.displacement(0, 0, p.gaussian((0, -49, 20), (23, 12, 25)))


def philtrum_length(p: FieldPoints) -> Array:
    """Distance from nose to mouth (mm); moves the mouth, compresses the chin."""
    share = smoothstep(SUBNASALE_Y, -42.0, p.y) * smoothstep(-84.0, -54.0, p.y)
    return p.displacement(0, -share * smoothstep(58.0, 24.0, p.x) * (p.z > -60), 0)


def philtrum_depth(p: FieldPoints) -> Array:
    """Depth of the philtrum (mm)."""
    along = smoothstep(-30.0, -34.0, p.y) * smoothstep(-44.0, -41.0, p.y) * (p.z > 0)
    return p.displacement(0, 0, along * (0.6 * bump(p.x - 5.6, 2.6) - 1.0 * bump(p.x, 3.4)))


def mouth_tilt(p: FieldPoints) -> Array:
    """Height of the left corner above the right (mm)."""
    weight = p.gaussian((24, -49, 10), (16, 16, 30))
    return p.displacement(0, 0.5 * p.side * weight, 0)


def jaw_breadth(p: FieldPoints) -> Array:
    """Width of the jaw, go-go, skin to skin (mm)."""
    weight = bump(p.y + 60, 30.0) * smoothstep(12.0, 42.0, p.x) * smoothstep(-110.0, -70.0, p.z)
    return widen(p, 51.0, weight)


def jaw_angle_height(p: FieldPoints) -> Array:
    """Height of the gonion (mm)."""
    return p.displacement(0, p.gaussian((48, -68, -58), (20, 22, 30)), 0)


def chin_protrusion(p: FieldPoints) -> Array:
    """Protrusion of the pogonion relative to the mean (mm)."""
    weight = p.gaussian((0, -84, 12), (28, 17, 34))
    return p.displacement(0, 0, weight)


def chin_breadth(p: FieldPoints) -> Array:
    """Width of the mental tubercles (mm)."""
    weight = p.gaussian((18, -84, 6), (12, 13, 22))
    return p.displacement(0.5 * weight, 0, 0.25 * weight)


def chin_height(p: FieldPoints) -> Array:
    """Height of the chin, sl-gn, relative to the mean (mm)."""
    share = smoothstep(-62.0, -90.0, p.y) * smoothstep(-140.0, -104.0, p.y)
    return p.displacement(0, -share * smoothstep(-60.0, -10.0, p.z), 0)


def chin_cleft(p: FieldPoints) -> Array:
    """Depth of the chin cleft (mm)."""
    return p.displacement(0, 0, -p.gaussian((0, -83, 16), (4.5, 7, 12)))


def jaw_asymmetry(p: FieldPoints) -> Array:
    """Shift of the chin to the left (mm)."""
    weight = smoothstep(-45.0, -85.0, p.y) * smoothstep(-125.0, -100.0, p.y) * front_weight(p)
    return np.stack([weight, 0 * weight, 0 * weight], axis=1)


def double_chin(p: FieldPoints) -> Array:
    """Thickness of the fat under the chin (mm)."""
    weight = p.gaussian((0, -98, -30), (36, 17, 36))
    return p.displacement(0, -0.85 * weight, 0.5 * weight)


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
        double_chin,
    )
}
