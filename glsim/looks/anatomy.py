"""Landmarks of a source's reference head: eyes, ears, mouth and hairline, found from its regions.

Coordinates are millimetres in the canonical frame of the source's reference head. The hairline of a
mean adult's head is scaled by the height from the eyes to the top of the head.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats, Mask, Reals, Triangles
from glsim.core.errors import ConfigError
from glsim.core.products import product
from glsim.looks.styles import STYLE_TABLE

_EYES: Final = ("sclera", "iris", "pupil", "eyes")
_INSIDE: Final = (*_EYES, "eye socket", "mouth socket", "gums", "teeth", "mouth", "tongue")
_SKULL: Final = ("scalp", "hair", "head", "forehead")
_BODY: Final = ("torso", "arm", "hand", "leg", "foot")

#: Height of a mean adult's head above the eyes, mm: 223 mm from chin to top minus 116 mm from chin
#: to eyes (Farkas, Anthropometry of the Head and Face, 1994, means of men and women).
_MEAN_EYE_TO_TOP_MM: Final = 107.0


@dataclass(frozen=True, eq=False)
class Anatomy:
    """A reference head, (V, 3) mm, with the region of each vertex, (V,) indices into ``names``."""

    source: str
    vertices_mm: Floats
    faces: Triangles
    regions: NDArray[np.integer[Any]]
    names: Sequence[str]

    def is_in(self, *names: str) -> Mask:
        """Mark the vertices of the named regions, (V,)."""
        numbers = [number for number, name in enumerate(self.names) if name in names]
        return np.isin(self.regions, numbers)

    @cached_property
    def outside(self) -> Mask:
        """Mask (V,) of the skin that is visible when eyes and mouth are closed."""
        return ~self.is_in(*_INSIDE)

    @cached_property
    def body(self) -> Mask:
        """Mask (V,) of the vertices below the neck."""
        return self.is_in(*_BODY)

    @cached_property
    def eye(self) -> Reals:
        """Midpoint between the eyes, (3,) mm."""
        points = self._of(*_EYES)
        return np.asarray(_pair(points, _middle(points)[0]).mean(axis=0))

    @cached_property
    def mouth(self) -> Reals:
        """Centre of the lips, (3,) mm."""
        return _middle(self._of("lips"))

    @cached_property
    def scale(self) -> float:
        """Ratio of the height from eyes to crown to the mean adult's height."""
        skull = self._of(*_SKULL)
        return float(skull[:, 1].max() - self.eye[1]) / _MEAN_EYE_TO_TOP_MM

    @cached_property
    def ears(self) -> Reals:
        """Centres of the left and the right ear, (2, 3) mm."""
        # Without a region for ears: 88 mm behind and 12 mm below the eyes, scaled, the position in
        # the procedural mean head.
        if "ear" in self.names:
            return _pair(self._of("ear"), self.eye[0])
        at = self.eye + np.array([0.0, -12.0, -88.0]) * self.scale
        near = self.vertices_mm[self.outside & ~self.body]
        near = near[np.abs(near - at)[:, 1:].max(axis=1) < 25 * self.scale]
        half = float(np.percentile(np.abs(near[:, 0] - self.eye[0]), 90))
        aside = np.array([half, 0.0, 0.0])
        return np.stack([at + aside, at - aside])

    @cached_property
    def centre(self) -> Reals:
        """Centre of the skull, (3,) mm, from which hair grows outwards."""
        skull = self._of(*_SKULL)
        back_z = float(skull[skull[:, 1] > self.eye[1], 2].min())
        behind = 0.5 * (self.eye[2] + back_z)
        return np.array([self.eye[0], self.eye[1] + 10 * self.scale, behind])

    def above_hairline_mm(self, points: Reals) -> Reals:
        """Compute points' heights above the hairline, (N,) mm; negative on bare skin."""
        local = (points - self.eye) / self.scale
        curve = STYLE_TABLE["hairline"]["z"], STYLE_TABLE["hairline"]["y"]
        line = np.interp(local[:, 2], *curve)
        step = np.interp(local[:, 2] + 1, *curve) - line
        inside = (local[:, 1] - line) / np.sqrt(1 + step**2)
        return np.asarray(inside * self.scale)

    def _of(self, *names: str) -> Reals:
        points = self.vertices_mm[self.is_in(*names)].astype(np.float64)
        if len(points) == 0:
            raise ConfigError(
                f"{self.source}: has no region {' or '.join(map(repr, names))}, so nobody can be "
                "dressed: leave appearance.wear out"
            )
        return points


def beside_line(points: Reals, skin: Reals, way: Reals, near_mm: float) -> Reals:
    """Return (N,) how far along a way skin (M, 3) reaches near the points' lines, mm, or -inf."""
    flat, skin_flat = (p - product(p, way)[:, None] * way for p in (points, skin))
    near = ((flat[:, None] - skin_flat) ** 2).sum(axis=2) < near_mm**2
    return np.asarray(np.where(near, product(skin, way), -np.inf).max(axis=1))


def _middle(points: Reals) -> Reals:
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _pair(points: Reals, middle_x: float) -> Reals:
    """Return the bounding-box centres, (2, 3), of points on the subject's left and right side."""
    left = points[:, 0] > middle_x
    return np.stack([_middle(points[left]), _middle(points[~left])])
