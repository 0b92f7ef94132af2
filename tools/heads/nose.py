"""Fine shape of the nose: the grooves around its wings and its tip.

Millimetres, template heights; Farkas 1994: al-al 34, wings about 13 mm high.
"""

from __future__ import annotations

import numpy as np

from tools.heads.falloff import Array, bump, smoothstep

ALA_CENTER, ALA_RADII = (12.0, -23.0), (5.6, 7.2)


def nose_offset(x: Array, y: Array) -> Array:
    """Return the z offset (N,) of the skin near the nose (mm); ``x``: distance from the midline."""
    u, v = (x - ALA_CENTER[0]) / ALA_RADII[0], (y - ALA_CENTER[1]) / ALA_RADII[1]
    from_ala = np.hypot(u, v)
    above_or_behind = smoothstep(-0.9, 0.2, u + v)
    groove = -0.9 * bump(from_ala - 1.12, 0.24) * above_or_behind
    wing = 0.5 * bump(from_ala, 0.75)
    floor = smoothstep(-29.0, -26.5, y)
    return np.asarray((groove + wing) * floor)
