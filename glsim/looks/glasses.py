"""Glasses: rims, bridge, temples and lenses, fitted to a subject's eyes, nose and ears."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from glsim.core.array_types import Floats, Mask, Reals
from glsim.core.seeds import keyed_rng
from glsim.looks.anatomy import Anatomy, beside_line
from glsim.looks.shapes import Shape, joined, tube

_SIDES: Final = 28  # corners of a rim
#: Distance from the cornea to the back of a lens, mm: opticians fit 12 to 14 mm.
_VERTEX_MM: Final = 13.0
#: Smallest gap between frame and skin, mm. The value was chosen, not measured.
_CLEARANCE_MM: Final = 1.5


def make_glasses(
    anatomy: Anatomy, skin_mm: Floats, style: Mapping[str, Any], lens: str, seed: int
) -> tuple[Shape, Mask]:
    """Fit glasses of a ``style`` of styles.toml to a subject's reference head, (V, 3) mm.

    ``lens``: "clear" has no surface, "dark" fills the rims, "glint" puts a bright spot in each rim.
    Returns the mesh, and the mask of the lenses' vertices, (N,).
    """
    rng = keyed_rng(seed, 0x61A5)
    scale = anatomy.scale
    skin = skin_mm[anatomy.outside & ~anatomy.body & ~anatomy.is_in("ear")].astype(np.float64)
    skin = skin[np.abs(skin[:, 1] - anatomy.eye[1]) < 60 * scale]
    balls = skin_mm[anatomy.is_in("sclera", "iris", "pupil", "eyes")].astype(np.float64)
    middle = 0.5 * (balls.min(axis=0) + balls.max(axis=0))
    apart = float(np.abs(balls[:, 0] - middle[0]).mean())
    half_width, half_height = np.array([style["width"], style["height"]]) * 0.5 * min(scale, 1.05)
    # A lens has its centre at the pupil or farther out; the rims are at least 19 mm apart.
    centre_x = max(apart + 1.0, half_width + 9.5)
    turn = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    cosine, sine = np.cos(turn), np.sin(turn)
    corner = (np.abs(cosine) ** style["power"] + np.abs(sine) ** style["power"]) ** (
        -1 / style["power"]
    )
    x, y = centre_x + cosine * corner * half_width, sine * corner * half_height
    wrap, tilt = np.radians(rng.uniform(3, 8)), np.radians(rng.uniform(4, 10))
    front = balls[:, 2].max() + _VERTEX_MM
    z = -np.tan(wrap) * np.maximum(x - 10, 0) + np.tan(tilt) * y
    outline = np.stack([x, y, z], axis=1)  # the left lens; the right one is its mirror image
    origin = np.array([middle[0], middle[1] - 2.0, front])
    both = np.concatenate([outline, outline * (-1, 1, 1)]) + origin
    origin[2] += max(_overlap(both, skin) + _CLEARANCE_MM, -5.0)
    frame: list[Shape] = []
    lenses: list[Shape] = []
    for side in (1.0, -1.0):
        ring = outline * (side, 1, 1) + origin
        frame.append(tube(ring, style["rim"], 0.8 * style["rim"], closed=True))
        hinge = ring[np.argmax(side * ring[:, 0] + 0.3 * ring[:, 1])]
        frame.append(
            tube(_temple(anatomy, skin, hinge, side), style["rim"] + 0.5, 2.2, closed=False)
        )
        if lens != "clear":
            lenses.append(_lens(ring, side, 1.0 if lens == "dark" else 0.2, rng))
    frame.append(tube(_bridge(outline, origin, skin), style["rim"], style["rim"], closed=False))
    mesh = joined(frame + lenses)
    is_lens = np.arange(len(mesh.vertices_mm)) >= sum(len(part.vertices_mm) for part in frame)
    return mesh, is_lens


def _overlap(points: Reals, skin: Reals) -> float:
    """Compute the largest distance by which the skin lies in front of the points, mm."""
    skin = skin[skin[:, 2] > points[:, 2].min() - 40.0]
    ahead = beside_line(points, skin, np.array([0.0, 0.0, 1.0]), 4.0) - points[:, 2]
    return float(ahead.max()) if np.isfinite(ahead).any() else 0.0


def _bridge(outline: Reals, origin: Reals, skin: Reals) -> Reals:
    """Return the centre line of the bridge, (9, 3) mm, from rim to rim over the nose."""
    inner = outline[np.argmin(outline[:, 0] - 0.35 * outline[:, 1])]
    x = np.linspace(-inner[0], inner[0], 9)
    line = np.stack([x, np.full(9, inner[1]), np.full(9, inner[2])], axis=1) + origin
    arch = np.cos(np.linspace(-np.pi / 2, np.pi / 2, 9))
    line[:, 1] += 2.0 * arch
    line[:, 2] += arch * max(_overlap(line, skin) + _CLEARANCE_MM, 1.5)
    return line


def _temple(anatomy: Anatomy, skin: Reals, hinge: Reals, side: float) -> Reals:
    """Return the centre line of a temple, (12, 3) mm, from the hinge to behind the ear."""
    ear = anatomy.ears[0 if side > 0 else 1]
    top = np.array([ear[0], ear[1] + 22 * anatomy.scale, ear[2] + 2.0])
    line = hinge + np.linspace(0, 1, 9)[:, None] * (top - hinge)
    tip = top + np.array([[0, -5, -12], [-2 * side, -16, -20], [-4 * side, -30, -24]])
    line = np.concatenate([line, tip])
    skin = skin[side * (skin[:, 0] - anatomy.eye[0]) > 20]
    half = beside_line(line[1:], skin, np.array([side, 0.0, 0.0]), 6.0)
    line[1:, 0] = np.where(np.isfinite(half), side * (half + 2.5), line[1:, 0])  # out of the skin
    line[1:, 0] = np.convolve(np.pad(line[1:, 0], 1, mode="edge"), [0.25, 0.5, 0.25], "valid")
    return line


def _lens(ring: Reals, side: float, share: float, rng: np.random.Generator) -> Shape:
    """Make a disc in a rim: for ``share`` 1 the lens, else a bright spot at a random position."""
    middle = ring.mean(axis=0)
    if share < 1:
        middle = middle + (ring[rng.integers(len(ring))] - middle) * rng.uniform(0.2, 0.6)
    rim = middle + (ring - ring.mean(axis=0)) * share
    points = np.concatenate([middle[None] + (0, 0, 0.8 * share), rim])
    a = 1 + np.arange(len(ring))
    b, centre = np.roll(a, -1), np.zeros(len(ring), int)
    return Shape(points, np.stack([centre, a, b] if side > 0 else [centre, b, a], 1))
