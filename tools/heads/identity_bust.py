"""Identity fields of the neck and the shoulders (see identity.py)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from glsim.faces.neck import head_share
from tools.heads.falloff import Array, smoothstep
from tools.heads.fields import Field, FieldPoints, widen

ACROMION_X = 195.0  # half the biacromial breadth of the template
CHEST_MIDDLE_Z, CHEST_DEPTH = -115.0, 200.0  # of the template at y = -300


def neck_breadth(p: FieldPoints) -> Array:
    """Width under the jaw (mm)."""
    weight = smoothstep(-62.0, -105.0, p.y) * smoothstep(0.0, -45.0, p.z)
    weight = weight * smoothstep(-220.0, -165.0, p.y)
    side = 0.5 * np.minimum(p.x / 55.0, 1.0) * weight
    return p.displacement(side, 0, 0.35 * weight * smoothstep(-150.0, -90.0, p.z))


def adams_apple(p: FieldPoints) -> Array:
    """Size of the laryngeal prominence (mm)."""
    return p.displacement(0, 0, p.gaussian((0, -122, -48), (11, 15, 25)))


def _trunk(p: FieldPoints) -> Array:
    return 1.0 - head_share(p.points.astype(np.float32)).astype(np.float64)


def neck_length(p: FieldPoints) -> Array:
    """Distance from head to shoulders (mm)."""
    return p.displacement(0, -_trunk(p), 0)


def stoop(p: FieldPoints) -> Array:
    """Distance of the head in front of the shoulders, relative to the mean (mm)."""
    return p.displacement(0, 0, -_trunk(p))


def shoulder_breadth(p: FieldPoints) -> Array:
    """Biacromial breadth (mm)."""
    return widen(p, ACROMION_X, smoothstep(-118.0, -190.0, p.y))


def shoulder_drop(p: FieldPoints) -> Array:
    """Height by which the acromion hangs below that of the template (mm)."""
    weight = smoothstep(50.0, 185.0, p.x) * smoothstep(-118.0, -160.0, p.y)
    return p.displacement(0, -weight, 0)


def chest_depth(p: FieldPoints) -> Array:
    """Depth of the chest (mm)."""
    share = (p.z - CHEST_MIDDLE_Z) / CHEST_DEPTH
    return p.displacement(0, 0, share * smoothstep(-165.0, -270.0, p.y))


FIELDS: Mapping[str, Field] = {
    field.__name__: field
    for field in (
        neck_breadth,
        adams_apple,
        neck_length,
        stoop,
        shoulder_breadth,
        shoulder_drop,
        chest_depth,
    )
}
