"""The mouth: its line, the shape of the lips and the skin around them, and the inside.

Millimetres; ``x`` is the distance from the midline. Heights y are those of the template.
Farkas 1994: ch-ch 52, upper vermilion ls-sto 8, lower vermilion sto-li 9.5, philtrum cphs-cphs 11.
"""

from __future__ import annotations

import numpy as np

from tools.heads.falloff import Array, IntArray, bump, smoothstep
from tools.heads.volumes import SUBNASALE_Y

STOMION_Y = -49.0
CORNER_X = 26.4
CUPID_X = 5.5  # peaks of Cupid's bow
UPPER_LIP, LOWER_LIP = 8.4, 10.4  # vermilion heights at the midline and below it
SULCUS_Y = -65.5
# Rings of the oral cavity: mm behind the lip's edge, and mm above the upper or below the lower
# lip's edge. They line the lips, the vestibule in front of the teeth, then the palate above and the
# tongue below, to a dark back wall; the gums are where the teeth stand out of them. Chosen: an
# incisor's crown shows 9 mm below the gum, and the back wall is 50 mm behind the lips.
RING_DEPTH = (2.0, 4.5, 7.0, 12.0, 20.0, 32.0, 44.0, 50.0)
UPPER_SPREAD = (0.3, 2.0, 9.0, 11.0, 13.0, 13.0, 10.0, 4.0)
LOWER_SPREAD = (0.3, 2.0, 8.5, 8.0, 4.0, 3.0, 5.0, 4.0)
#: The cavity loses this share of its width per mm behind the lips: it is 34 mm wide at the back
#: molars (Burris and Harris 2000, less the teeth) and half as wide at the throat. Height of the
#: tongue's back over its edges, and depth of its groove, mm; chosen.
NARROWING = 0.008
TONGUE_MM, GROOVE_MM = 4.5, 1.2


def stomion_line(x: Array) -> Array:
    """Return heights (N,) of the line between closed lips, lower at tubercle and corners."""
    return np.asarray(
        STOMION_Y - 0.9 * bump(x, 4.0) + 0.5 * bump(x - 10, 6.0) - 0.6 * (x / 26) ** 2
    )


def upper_border(x: Array) -> Array:
    """Return heights (N,) of the upper vermilion border, with Cupid's bow."""
    s = np.clip(x / CORNER_X, 0.0, 1.0)
    arch = UPPER_LIP * (1 - s**1.8)
    return np.asarray(stomion_line(x) + arch + 1.0 * bump(x - CUPID_X, 3.2) - 0.6 * bump(x, 2.2))


def lower_border(x: Array) -> Array:
    """Return heights (N,) of the lower vermilion border."""
    s = np.clip(x / CORNER_X, 0.0, 1.0)
    return np.asarray(stomion_line(x) - LOWER_LIP * (1 - s**2.5))


def lip_offset(x: Array, y: Array) -> Array:
    """Return the z offset (N,) of the skin at lips, philtrum, corners and chin furrow (mm)."""
    line, top, bottom = stomion_line(x), upper_border(x), lower_border(x)
    fade = smoothstep(CORNER_X + 1.5, CORNER_X - 13.0, x)
    upper_t = (y - line) / np.maximum(top - line, 1.5)
    lower_t = (line - y) / np.maximum(line - bottom, 1.5)
    offset = fade * np.where(
        y >= line,
        3.4 * bump(upper_t - 0.50, 0.55) + 0.5 * bump(upper_t - 1.12, 0.16),
        4.2 * bump(lower_t - 0.48, 0.52),
    )
    inside = smoothstep(CORNER_X + 2.0, CORNER_X - 9.0, x)
    offset -= 2.4 * inside * bump(y - line, 1.4)
    offset -= 2.0 * bump(x - CORNER_X - 0.5, 4.5) * bump(y - line, 5.0)
    offset -= 1.5 * bump(y - SULCUS_Y, 5.5) * smoothstep(26.0, 8.0, x)
    column = smoothstep(SUBNASALE_Y - 1.0, SUBNASALE_Y - 8.0, y) * smoothstep(
        top - 1.0, top + 2.0, y
    )
    offset += column * (0.7 * bump(x - 5.6, 2.6) - 1.0 * bump(x, 3.4))
    return np.asarray(offset)


def lip_weight(x: Array, y: Array) -> Array:
    """Return (N,) weights of the vermilion in [0, 1], with a soft border of about 1 mm."""
    edge = np.minimum(upper_border(x) - y, y - lower_border(x))
    return np.asarray(smoothstep(-0.6, 0.6, edge) * smoothstep(CORNER_X + 0.8, CORNER_X - 0.8, x))


def mouth_rings(edge: Array, ring: IntArray, low: np.ndarray) -> Array:
    """Return positions (N, 3) of the rings of the oral cavity, from their lip vertices (N, 3)."""
    level = np.clip(ring - 1, 0, len(RING_DEPTH) - 1)
    depth = np.asarray(RING_DEPTH)[level]
    spread = np.where(low, -np.asarray(LOWER_SPREAD)[level], np.asarray(UPPER_SPREAD)[level])
    corner = smoothstep(CORNER_X + 0.5, CORNER_X - 8.0, edge[:, 0])
    # Behind the teeth the palate is a vault, narrower towards the throat; the tongue lies in it,
    # with a groove along its middle.
    deep = smoothstep(8.0, 22.0, depth)
    vault = np.sqrt(np.clip(1.0 - (edge[:, 0] / (CORNER_X + 0.5)) ** 2, 0.0, 1.0))
    round_off = corner + deep * (vault - corner)
    points = edge.copy()
    points[:, 0] *= 1.0 - NARROWING * depth
    points[:, 1] += round_off * spread
    tongue = TONGUE_MM * bump(edge[:, 0], 11.0) - GROOVE_MM * bump(edge[:, 0], 3.0)
    back = smoothstep(50.0, 38.0, depth)
    points[:, 1] += np.where(low, deep * back * tongue, 0.0)
    points[:, 2] -= depth * (0.35 + 0.65 * round_off)
    return points
