"""Detect the unit and the axes of a face mesh, and align the mesh with the canonical frame.

Unit: the largest side of a head's bounding box is 80 to 600 mm. Only one of metres, decimetres,
centimetres and millimetres gives such a size, because the four intervals do not overlap.

Axes: each of the 24 rotations by quarter turns gives a height map seen from +z. The nose template
(nose, eye hollows, lips; left-right symmetric, convex) slides over it, and the rotation with the
highest correlation wins. It fails where pouting lips reach further than the nose.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, MeshError, did_you_mean
from glsim.faces.meshes.nose_template import NoseMatch, find_tip, match_nose, sample_surface

UNITS_MM: Final = {"m": 1000.0, "dm": 100.0, "cm": 10.0, "mm": 1.0, "inch": 25.4}
"""Length of each named unit, mm; ``unit`` may also be a number of millimetres, such as "125"."""
DETECTED_UNITS: Final = ("m", "dm", "cm", "mm")

MIN_HEAD_MM: Final = 80.0  # a cropped patch with eyes, nose and mouth
MAX_HEAD_MM: Final = 600.0  # a head with neck and shoulders

#: Largest distance of a head from its file's origin, over its size: steps of float32 are then 2 mm
#: on a head of 200 mm.
_MAX_AWAY: Final = 1e5

ORIGIN_BEHIND_NOSE_MM: Final = 45.0
"""Distance of the canonical origin, between the cheek bones, behind the nose tip, mm."""

MIN_MATCH: Final = 0.6  # faces reach 0.8 to 0.97, shapes without a nose less than 0.4
TIE_LEAD: Final = 0.02  # the file's own axes win unless another rotation leads by more
CLEAR_LEAD: Final = 0.05  # the smallest lead on 100 neutral ICT-FaceKit people

_AXES = re.compile(r"([+-][xyz]){3}", re.ASCII)


@dataclass(frozen=True)
class Alignment:
    """The transform from a file's frame to the canonical frame, as the manifest records it.

    Args:
        unit, mm_per_unit: name of the file's unit and its length in mm.
        axes: the file's axes that become canonical x, y, z: "+x-y-z" negates y and z.
        origin_mm: offset subtracted after unit and axes are applied, canonical frame, mm.
        flip_winding: whether the file's triangles are clockwise and must be reversed.
        nose_match: correlation with the nose template, -1 to 1 (-1: nothing like a nose).
        detected: the names "unit" and "axes", if they were detected.
        doubts: problems that a person should check, one sentence each.
        better_axes: axes that fit the face clearly better than the user's; "" without.
    """

    unit: str
    mm_per_unit: float
    axes: str
    origin_mm: tuple[float, float, float]
    flip_winding: bool
    nose_match: float
    detected: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    better_axes: str = ""

    def apply(self, vertices: NDArray[np.floating]) -> NDArray[np.float32]:
        """Transform (V, 3) vertices of the file into (V, 3) float32 canonical millimetres."""
        with np.errstate(over="ignore", invalid="ignore"):  # the size is checked afterwards
            rotated = vertices @ (rotation(self.axes).T * self.mm_per_unit)
            return np.ascontiguousarray(rotated - np.array(self.origin_mm), dtype=np.float32)

    def notes(self) -> dict[str, object]:
        """Return the manifest's notes; JSON values only."""
        return {
            "unit": self.unit,
            "axes": self.axes,
            "origin_mm": [round(value, 3) for value in self.origin_mm],
            "winding_flipped": self.flip_winding,
            "nose_match": round(self.nose_match, 3),
            "found_by_rule": list(self.detected),
            "doubts": list(self.doubts),
        }

    def __str__(self) -> str:
        """Describe the alignment in one line for the log."""
        how = f"{' and '.join(self.detected)} found by rule" if self.detected else "as given"
        text = f"unit {self.unit}, axes {self.axes} ({how}; nose match {self.nose_match:.2f})"
        return "; ".join([text, *(["winding flipped"] if self.flip_winding else []), *self.doubts])


def estimate_alignment(
    vertices: NDArray[np.floating],
    faces: NDArray[np.integer],
    *,
    unit: str = "auto",
    axes: str = "auto",
    recentre: bool = True,
) -> Alignment:
    """Detect unit and axes where they are "auto", and check them where the user gives them.

    The best nose among all 24 rotations decides the axes, or is compared with the user's axes.

    Args:
        vertices: (V, 3) in the file's frame, each used by a triangle.
        faces: (F, 3).

    Raises:
        ConfigError: an invalid setting.
        MeshError: no unit gives the size of a head, or ``axes`` is "auto" and no nose is detected;
            the message has no file name.
    """
    check_axes(axes)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    unit_name, mm_per_unit = _find_unit(float((upper - lower).max()), unit)
    away = float(max(np.abs(lower).max(), np.abs(upper).max()) / (upper - lower).max())
    if away > _MAX_AWAY:
        raise MeshError(
            f"it lies {away:.3g} times its size away from the file's origin: move it there"
        )
    samples = sample_surface(vertices, faces) * mm_per_unit
    doubts: list[str] = []
    better = ""
    # Each row of a rotation has one entry that is not 0: a third of the time of a product.
    turned = {n: samples[np.abs(m).argmax(1)] * m.sum(1)[:, None] for n, m in _ROTATIONS.items()}
    matches = {name: match_nose(points) for name, points in turned.items()}
    best = max(matches, key=lambda name: matches[name].score)
    if axes == "auto":
        chosen = _best_axes(matches, best, doubts)
    else:
        chosen = axes
        if matches[best].score > max(MIN_MATCH, matches[axes].score + CLEAR_LEAD):
            better = best
            doubts.append(
                f"with axes={axes} the face may look away or stand on its head: {best} fits "
                f"better ({matches[best].score:.2f} against {matches[axes].score:.2f})"
            )
    nose = matches[chosen]
    points_mm = vertices @ (_ROTATIONS[chosen] * mm_per_unit).T
    flip = _is_clockwise(points_mm, faces)
    origin = (0.0, 0.0, 0.0)
    if recentre:
        if nose.score >= MIN_MATCH:
            x, y, z = find_tip(points_mm, faces, nose.near_mm)
        else:
            low, high = points_mm.min(axis=0), points_mm.max(axis=0)
            x, y, z = (float(value) for value in (*(low + high)[:2] / 2, high[2]))
            doubts.append("no nose is found: centred on the bounding box")
        origin = (x, y, z - ORIGIN_BEHIND_NOSE_MM)
    detected = tuple(name for name, value in (("unit", unit), ("axes", axes)) if value == "auto")
    return Alignment(
        unit_name, mm_per_unit, chosen, origin, flip, nose.score, detected, tuple(doubts), better
    )


def _best_axes(matches: dict[str, NoseMatch], best: str, doubts: list[str]) -> str:
    """Return the axes of a face with the best nose; append to ``doubts``. Raises MeshError."""
    score = matches[best].score
    if score < MIN_MATCH:
        raise MeshError(
            f"no nose is found in any of the 24 orientations (best match {score:.2f}, wanted "
            f"{MIN_MATCH}): give the axes yourself, such as axes='+x+y+z' for x the subject's "
            "left, y up, z out of the face"
        )
    chosen = "+x+y+z" if matches["+x+y+z"].score > score - TIE_LEAD else best
    runner_up = max(match.score for name, match in matches.items() if name != chosen)
    if runner_up > matches[chosen].score - CLEAR_LEAD:
        doubts.append(f"another orientation fits nearly as well as {chosen}: look at a picture")
    return chosen


def rotation(axes: str) -> NDArray[np.float64]:
    """Return the (3, 3) rotation from file directions to canonical ones. Raises ConfigError."""
    check_axes(axes)
    return _ROTATIONS[axes]


def check_unit(unit: str) -> None:
    """Reject an unknown unit before any file is read. Raises ConfigError."""
    if unit != "auto" and unit not in UNITS_MM:
        try:
            length = float(unit)
        except ValueError:
            length = math.nan
        if not (math.isfinite(length) and length > 0):
            raise ConfigError(
                f"unit={unit!r}: no such unit ({did_you_mean(unit, [*UNITS_MM, 'auto'])}); "
                "a number of millimetres is valid too"
            )


def check_axes(axes: str) -> None:
    """Reject invalid axes before any file is read. Raises ConfigError."""
    if axes == "auto" or axes in _ROTATIONS:
        return
    if _AXES.fullmatch(axes) and len(set(axes[1::2])) == 3:
        raise ConfigError(
            f"axes={axes!r} mirrors the face: change the sign of one axis (24 rotations are valid)"
        )
    raise ConfigError(
        f"axes={axes!r}: write which axis of the file is canonical x (subject's left), y (up) and "
        "z (out of the face), such as '+x+y+z' or '+x-y-z', or 'auto'"
    )


def _find_unit(extent: float, unit: str) -> tuple[str, float]:
    """Return name and length (mm) of the unit; ``extent``: largest side of the bounding box."""
    check_unit(unit)
    if unit == "auto":
        for name in DETECTED_UNITS:
            if MIN_HEAD_MM <= extent * UNITS_MM[name] <= MAX_HEAD_MM:
                return name, UNITS_MM[name]
        raise MeshError(
            f"the mesh is {extent:.4g} units across: read as m, dm, cm or mm that is not a head of "
            f"{MIN_HEAD_MM:.0f} to {MAX_HEAD_MM:.0f} mm; give the length of a unit in millimetres, "
            f"such as unit='{float(f'{250 / extent:.2g}'):g}' for a head of 250 mm"
        )
    length = UNITS_MM[unit] if unit in UNITS_MM else float(unit)
    size = extent * length
    if not MIN_HEAD_MM <= size <= MAX_HEAD_MM:
        raise MeshError(
            f"with unit={unit} the head is {size:.4g} mm across, and should be "
            f"{MIN_HEAD_MM:.0f} to {MAX_HEAD_MM:.0f} mm; try unit='auto' or another unit"
        )
    return (unit if unit in UNITS_MM else f"{length:g} mm"), length


def _is_clockwise(points_mm: NDArray[np.floating], faces: NDArray[np.integer]) -> bool:
    """Return whether most triangles seen from +z are clockwise, by area.

    Args:
        points_mm: (V, 3), z out of the face.
        faces: (F, 3).
    """
    a, b, c = (points_mm.T[:, corner] for corner in faces.T)
    (ux, uy, _), (vx, vy, _) = b - a, c - a
    x, y, z = (a + b + c) / 3
    cell_mm, slack_mm = 5.0, 5.0  # within a cell a face recedes by about the cell's width
    column, row = ((side - side.min()) // cell_mm for side in (x, y))
    key = (column * (row.max() + 1) + row).astype(np.int64)
    top = np.full(key.max() + 1, -np.inf)
    np.maximum.at(top, key, z)
    return float((ux * vy - uy * vx)[z >= top[key] - slack_mm].sum()) < 0


def _rotations() -> dict[str, NDArray[np.float64]]:
    """Return the 24 rotations by quarter turns, (3, 3) float64, by axes."""
    rotations = {}
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                name = "".join(
                    f"{'+' if sign > 0 else '-'}{'xyz'[axis]}"
                    for sign, axis in zip(signs, order, strict=True)
                )
                rotations[name] = matrix
    return rotations


_ROTATIONS: Final = _rotations()
