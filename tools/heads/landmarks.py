"""The 68 landmarks of embedded heads: vertices of the template, so the same in every subject.

Eyes and inner lips are vertices of the slits; all others are the skin vertices nearest to places
that the template's own shape defines (brows, vermilion borders) or that are chosen on it, by the
drawings of Multi-PIE (R. Gross et al., Image and Vision Computing 28, 2010): the bridge of the nose
from nasion to tip, its base, the contour from the ear to the chin. Left is the mirror of right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.heads.grid import EYE_KNOT, MOUTH_KNOT, knot_row
from tools.heads.mouth import CORNER_X, CUPID_X, lower_border, upper_border
from tools.heads.regions import brow_arch
from tools.heads.template import PART_SKIN, Template
from tools.heads.topology import EYE_COLUMNS, MOUTH_COLUMN, SLIT_EYE, SLIT_MOUTH
from tools.heads.volumes import MENTON_Y, NASION_Y, SUBNASALE_Y

#: The contour in front of the ear, then along the edge of the mandible: y and z, mm. Chosen on the
#: mandible's capsules (volumes.py); the ninth point is the chin.
_CONTOUR = (
    *((12.0, -79.0), (-7.0, -78.0), (-26.0, -76.0), (-45.0, -71.0), (-63.0, -60.0)),
    *((-75.0, -42.0), (-84.0, -23.0), (-90.0, -5.0)),
)
#: Distance of the points of a brow from the midline, mm, outer end first: evenly along its arch.
_BROW_X = (49.0, 41.0, 32.0, 22.5, 13.0)
#: Heights of the bridge between nasion and tip, as shares of the way down.
_BRIDGE = (0.0, 1 / 3, 2 / 3)
#: The base of the nose beside its middle: distance from the midline and y, mm. Chosen: the lower
#: ends of the wings and the middles of the nostrils' lower rims (volumes.py).
_NOSE_BASE = ((13.0, -27.0), (6.5, -28.5))


def landmark_vertices(template: Template) -> NDArray[np.int64]:
    """Return the (68,) vertices of the template in the order of ``glsim.faces.regions``."""
    right, left = _Half(template, -1), _Half(template, 1)
    middle = right.nearest  # on the midline both halves agree
    nose_tip = right.tip()
    tip_y = template.points[nose_tip, 1]
    chin = middle(0.0, MENTON_Y)
    contour = [*right.contour(), chin, *left.contour()[::-1]]
    brows = [*right.brow(), *left.brow()[::-1]]
    bridge = [middle(0.0, NASION_Y + share * (tip_y - NASION_Y)) for share in _BRIDGE]
    base = [*right.nose_base(), right.subnasale(), *left.nose_base()[::-1]]
    upper = [right.upper_lip(x) for x in (0.62 * CORNER_X, CUPID_X)]
    upper += [middle(0.0, float(upper_border(np.zeros(1))[0]))]
    upper += [left.upper_lip(x) for x in (CUPID_X, 0.62 * CORNER_X)]
    lower = [left.lower_lip(x) for x in (0.62 * CORNER_X, 0.3 * CORNER_X)]
    lower += [middle(0.0, float(lower_border(np.zeros(1))[0]))]
    lower += [right.lower_lip(x) for x in (0.3 * CORNER_X, 0.62 * CORNER_X)]
    outer = [right.mouth_corner(0), *upper, left.mouth_corner(0), *lower]
    inner = [right.mouth_corner(1), right.slit_mouth(False), right.middle_mouth(False)]
    inner += [left.slit_mouth(False), left.mouth_corner(1)]
    inner += [left.slit_mouth(True), right.middle_mouth(True), right.slit_mouth(True)]
    return np.array(
        [*contour, *brows, *bridge, nose_tip, *base, *right.eye(), *left.eye(), *outer, *inner],
        np.int64,
    )


class _Half:
    """One half of the head; ``side`` is the sign of x: -1 is the subject's right."""

    def __init__(self, template: Template, side: int) -> None:
        self._template, self._side = template, side
        points = template.points
        self._skin = np.flatnonzero((template.part == PART_SKIN) & (points[:, 0] * side > -1e-6))
        front = (points[self._skin, 2] > -50) & (template.ring[self._skin] == 0)
        self._front = self._skin[front]

    def subnasale(self) -> int:
        """Return the vertex of the subnasale, where the columella meets the upper lip.

        The columella hangs over it in the frontal view: take the rearmost vertex nearby.
        """
        points = self._template.points[self._front]
        near = np.hypot(points[:, 0], points[:, 1] - SUBNASALE_Y) < 1.0
        return int(self._front[near][points[near, 2].argmin()])

    def nearest(self, x: float, y: float) -> int:
        """Return the vertex of the face's front nearest to a place in the frontal view, mm."""
        points = self._template.points[self._front]
        off = np.hypot(points[:, 0] - self._side * x, points[:, 1] - y)
        # Of several one behind the other (the nose and what is under it) the foremost.
        near = off < off.min() + 0.5
        return int(self._front[near][points[near, 2].argmax()])

    def contour(self) -> list[int]:
        """Return the eight points from the ear to the chin."""
        points = self._template.points[self._skin]
        return [
            int(self._skin[np.hypot(points[:, 1] - y, points[:, 2] - z).argmin()])
            for y, z in _CONTOUR
        ]

    def brow(self) -> list[int]:
        """Return the five points of a brow, outer end first."""
        heights = brow_arch(np.array(_BROW_X))
        return [self.nearest(x, float(y)) for x, y in zip(_BROW_X, heights, strict=True)]

    def tip(self) -> int:
        """Return the foremost point of the nose, on the midline."""
        points = self._template.points[self._front]
        on_midline = (np.abs(points[:, 0]) < 1e-6) & (points[:, 1] < 0) & (points[:, 1] > -40)
        return int(self._front[on_midline][points[on_midline, 2].argmax()])

    def nose_base(self) -> list[int]:
        """Return the two points of the nose's base beside the middle, the wing first."""
        return [self.nearest(x, y) for x, y in _NOSE_BASE]

    def upper_lip(self, x: float) -> int:
        """Return a point of the upper vermilion border."""
        return self.nearest(x, float(upper_border(np.array([x]))[0]))

    def lower_lip(self, x: float) -> int:
        """Return a point of the lower vermilion border."""
        return self.nearest(x, float(lower_border(np.array([x]))[0]))

    def eye(self) -> list[int]:
        """Return the six points of an eye, clockwise in the image from its left corner."""
        first, last = EYE_COLUMNS
        inner, outer = (self._grid(knot_row(EYE_KNOT), column) for column in (first, last))
        near, far = (round(first + share * (last - first)) for share in (1 / 3, 2 / 3))
        upper = [self._slit(SLIT_EYE, column, False) for column in (near, far)]
        lower = [self._slit(SLIT_EYE, column, True) for column in (near, far)]
        if self._side > 0:  # the left eye begins at its inner corner
            return [inner, *upper, outer, *lower[::-1]]
        return [outer, *upper[::-1], inner, *lower]

    def mouth_corner(self, columns_inside: int) -> int:
        """Return the corner of the mouth, or the lips' contact some columns inside of it."""
        last = MOUTH_COLUMN
        if columns_inside:
            return self._slit(SLIT_MOUTH, last - columns_inside, False)
        return self._grid(knot_row(MOUTH_KNOT), last)

    def slit_mouth(self, low: bool) -> int:
        """Return the point of an inner lip 0.3 of the way to the corner."""
        return self._slit(SLIT_MOUTH, round(0.3 * MOUTH_COLUMN), low)

    def middle_mouth(self, low: bool) -> int:
        """Return the middle of an inner lip."""
        return self._slit(SLIT_MOUTH, 0, low)

    def _grid(self, row: int, column: int) -> int:
        template = self._template
        found = (template.row == row) & (template.column == self._side * column)
        return int(np.flatnonzero(found & (template.part == PART_SKIN) & (template.ring == 0))[0])

    def _slit(self, kind: int, column: int, low: bool) -> int:
        template = self._template
        found = (template.slit == kind) & (template.column == self._side * column)
        return int(np.flatnonzero(found & (template.low == low) & (template.ring == 0))[0])
