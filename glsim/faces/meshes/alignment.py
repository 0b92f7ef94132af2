"""Find the unit and the pose of the head in a mesh, and align the mesh with the canonical frame.

The head decides both; walls and floors are left out first. The mean face is fitted (``face_fit``)
from the best matches of the nose template: in the metric units that make the mesh a head or a body,
then at any size; each in 24 orientations by quarter turns, then in all. The size of the face names
the unit, for metric units differ far more than faces do. Other sizes are refused with the unit.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array
from glsim.core.errors import ConfigError, MeshError, did_you_mean
from glsim.faces.meshes.face_fit import ORIGIN_BEHIND_NOSE_MM, FaceFit, even_rotations, search_face
from glsim.faces.meshes.nose_template import NoseMatch, find_tip, match_nose, sample_surface

UNITS_MM: Final = {"m": 1000.0, "dm": 100.0, "cm": 10.0, "mm": 1.0, "inch": 25.4, "foot": 304.8}
"""Length of each named unit, mm; ``unit`` may also be a number of millimetres, such as "125"."""
DETECTED_UNITS: Final = ("m", "dm", "cm", "mm")

#: Units that a face may have but a metric file has not: the name or the length, mm.
OTHER_UNITS: Final = {"inch": 25.4, "foot": 304.8, "20": 20.0}

MIN_HEAD_MM: Final = 80.0  # a cropped patch with eyes, nose and mouth
MAX_HEAD_MM: Final = 700.0  # a head with neck and shoulders
MAX_SCENE_MM: Final = 2600.0  # a body, or a head before a backdrop
#: Sizes of the mesh that are tried where no metric unit fits; the nose template has three scales
#: and covers the steps between them, a factor of 1.41.
SIZES_MM: Final = (200.0, 280.0, 400.0, 560.0, 800.0, 1130.0, 1600.0, 2260.0)

#: Largest distance of a head from its file's origin, over its size: steps of float32 are then 2 mm
#: on a head of 200 mm.
_MAX_AWAY: Final = 1e5

MIN_MATCH: Final = 0.6  # faces reach 0.8 to 0.97, shapes without a nose less than 0.4
GOOD_FIT: Final = 0.83  # of ``FaceFit.score``: 59 of 61 faces reach more, 80 other shapes 0.83
PLAIN_FIT: Final = 0.76  # is enough for upright heads in metric units
SURE_FIT: Final = 0.88  # ends the search in a metric unit
PERFECT_FIT: Final = 0.95  # ends the search over sizes: faces upside down at 1.5 times reach 0.93
FACE_RATIO: Final = 1.3  # of a face to the mean face: 0.83 to 1.18 in heads of three sources
METRIC_RATIO: Final = 1.45  # is doubted from FACE_RATIO on; 20 mm a unit differ from cm by 2
GIVEN_RATIO: Final = 1.95  # a given unit is obeyed below: 2.54 cm an inch, over FACE_RATIO
UPRIGHT_DEG: Final = 12.0  # heads of ICT-FaceKit seem tilted by up to 10 degrees, once by 13
PLAIN_DEG: Final = 20.0  # a weak fit gives the pose worse: quarter turns are taken instead
TRIES: Final = 40  # noses to fit; with 24 instead of 80, 6 of 26 whole bodies were not found
FINE_ROTATIONS: Final = 400  # 24 degrees apart
DENSE_SAMPLES: Final = 450_000  # a body has 1.8 m2: 4 in a cell of the mean face
FINE_SAMPLES: Final = 3  # every third: 2 in a cell of the nose template on a bust

_WALL_DRAWS: Final = 400  # triangles; their planes are tried
_WALL_SHARE: Final = 0.2  # of the area; 0.13 of a mask of 800 triangles lie in one plane
_WALL_THICKNESS: Final = 0.005  # of the largest side
_WALL_COSINE: Final = math.cos(math.radians(8))

_SAME_NOSE_MM: Final = 30.0
_OTHER_WAY_DEG: Final = 40.0  # a fit that differs by more from given axes contradicts them
_NORMALISED: Final = 2e-3  # difference of the largest side from 1 or 2

Turns = tuple[float, float, float]
NO_TURNS: Final = (0.0, 0.0, 0.0)

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
        rotation_deg: turns about the canonical x, y and z, in this order, after ``axes``.
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
    rotation_deg: Turns = NO_TURNS
    extent_mm: float = 0.0

    def apply(self, vertices: NDArray[np.floating]) -> NDArray[np.float32]:
        """Transform (V, 3) vertices of the file into (V, 3) float32 canonical millimetres."""
        with np.errstate(over="ignore", invalid="ignore"):  # the size is checked afterwards
            turn = rotation(self.axes, self.rotation_deg)
            rotated = vertices @ (turn.T * self.mm_per_unit)
            return np.ascontiguousarray(rotated - np.array(self.origin_mm), dtype=np.float32)

    def notes(self) -> dict[str, object]:
        """Return the manifest's notes; JSON values only."""
        return {
            "unit": self.unit,
            "axes": self.axes,
            **({"rotation_deg": list(self.rotation_deg)} if any(self.rotation_deg) else {}),
            "size_mm": round(self.extent_mm, 1),
            "origin_mm": [round(value, 3) for value in self.origin_mm],
            "winding_flipped": self.flip_winding,
            "nose_match": round(self.nose_match, 3),
            "found_by_rule": list(self.detected),
            "doubts": list(self.doubts),
        }

    def __str__(self) -> str:
        """Describe the alignment in one line for the log."""
        text, doubts = describe_notes(self.notes())
        return "; ".join([text, *doubts])


def describe_notes(notes: Mapping[str, Any]) -> tuple[str, list[str]]:
    """Return one line about the unit and the pose in a face's notes, "" without; and its doubts."""
    if "axes" not in notes:
        return "", []
    detected = " and ".join(notes.get("found_by_rule", []))
    scale = f" {notes['scale']}" if "scale" in notes else ""
    text = f"unit {notes['unit']}{scale}"
    text += f", axes {notes['axes']}, {notes['size_mm']:.0f} mm across"
    if "rotation_deg" in notes:
        text += ", tilted: rotation_deg " + " ".join(f"{turn:g}" for turn in notes["rotation_deg"])
    return text + (f" ({detected} found by rule)" if detected else ""), list(notes["doubts"])


def estimate_alignment(
    vertices: NDArray[np.floating], faces: NDArray[np.integer], *, unit: str = "auto",
    axes: str = "auto", rotation_deg: Turns | None = None, recentre: bool = True,
) -> Alignment:  # fmt: skip
    """Find unit and pose where they are "auto", and check them where the user gives them.

    Args:
        vertices: (V, 3) in the file's frame, each used by a triangle.
        faces: (F, 3).
        rotation_deg: as of ``Alignment``; None: found if ``axes`` is "auto", otherwise 0.

    Raises:
        ConfigError: an invalid setting.
        MeshError: no face is found, or one of a size that no unit explains; without file name.
    """
    if rotation_deg is not None and axes == "auto":
        axes = "+x+y+z"
    check_axes(axes)
    check_unit(unit)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    extent = float((upper - lower).max())
    solid = _without_walls(vertices, faces, extent)
    size = float(np.ptp(vertices[solid.ravel()], axis=0).max())
    away = float(max(np.abs(lower).max(), np.abs(upper).max()) / extent)
    if away > _MAX_AWAY:
        raise MeshError(
            f"it lies {away:.3g} times its size away from the file's origin: move it there"
        )
    doubts: list[str] = []
    better = ""
    samples = sample_surface(vertices, solid)
    dense = partial(sample_surface, vertices, solid, DENSE_SAMPLES)
    given = None if axes == "auto" else rotation(axes, rotation_deg or NO_TURNS)
    fit = _find_face(samples, dense, _lengths(size, unit), given)
    if fit is None and unit != "auto":  # it may have another unit
        with suppress(MeshError):
            fit = _find_face(samples, dense, _lengths(size, "auto"), given)
    if fit is None and given is None:
        raise MeshError(
            f"no face is found{'' if unit == 'auto' else f' with unit={unit}; try unit=auto, or'}: "
            "give the axes yourself, such as axes='+x+y+z' for x the subject's left, y up, z out "
            "of the face"
        )
    name, mm_per_unit = _unit_of(fit, extent, unit, doubts)
    if given is None:
        assert fit is not None
        turn, chosen, degrees = _upright(fit)
    else:
        turn, chosen, degrees = given, axes, rotation_deg or NO_TURNS
        if fit is not None and _angle_deg(fit.rotation, turn) > _OTHER_WAY_DEG:
            better, fit = _nearest_axes(fit.rotation), None
            doubts.append(
                f"with axes={axes} the face may look away or stand on its head: {better} fits "
                "better"
            )
    nose = match_nose((turn * mm_per_unit) @ samples)
    points_mm = vertices @ (turn * mm_per_unit).T
    flip = _is_clockwise(points_mm, solid)
    origin = (0.0, 0.0, 0.0)
    if recentre:
        near = _nose_near(nose, turn, mm_per_unit, fit)
        if (tip := near and find_tip(points_mm, faces, near)) is not None:
            x, y, z = tip
        else:
            low, high = points_mm.min(axis=0), points_mm.max(axis=0)
            x, y, z = (float(value) for value in (*(low + high)[:2] / 2, high[2]))
            doubts.append("no nose is found: centred on the bounding box")
        origin = (x, y, z - ORIGIN_BEHIND_NOSE_MM)
    detected = tuple(word for word, value in (("unit", unit), ("axes", axes)) if value == "auto")
    return Alignment(
        name, mm_per_unit, chosen, origin, flip, nose.score, detected, tuple(doubts), better,
        degrees, extent * mm_per_unit,
    )  # fmt: skip


def _without_walls(
    vertices: NDArray[np.floating], faces: NDArray[np.integer], extent: float
) -> NDArray[np.integer]:
    """Return the triangles without walls, floors and table tops, among which a head is small."""
    rng = np.random.default_rng(0)
    while True:
        first, second, third = (vertices[faces[:, corner]] for corner in range(3))
        normals, middles = np.cross(second - first, third - first), (first + second + third) / 3
        area = np.linalg.norm(normals, axis=1)
        if not area.sum() > 0:
            return faces
        normals /= np.maximum(area, np.finfo(float).tiny)[:, None]
        drawn = rng.choice(len(faces), _WALL_DRAWS, p=area / area.sum())
        offsets = (middles[drawn] * normals[drawn]).sum(axis=1)

        drawn_on = _on_planes(normals[drawn], middles[drawn], normals[drawn], offsets, extent)
        shares = drawn_on.mean(axis=0)
        best = slice(shares.argmax(), shares.argmax() + 1)
        on = _on_planes(normals, middles, normals[drawn[best]], offsets[best], extent)[:, 0]
        if shares.max() < _WALL_SHARE or on.all():
            return faces
        faces = faces[~on]


def _on_planes(
    normals: Array, middles: Array, plane_normals: Array, offsets: Array, extent: float
) -> NDArray[np.bool_]:
    """Return (N, P): whether each of N triangles lies in each of P planes."""
    near = np.abs(middles @ plane_normals.T - offsets) < _WALL_THICKNESS * extent
    return near & (np.abs(normals @ plane_normals.T) > _WALL_COSINE)


def _upright(fit: FaceFit) -> tuple[Array, str, Turns]:
    """Return a rotation, axes and turns of an upright head: quarter turns, unless it is tilted."""
    turn, axes = fit.rotation, _nearest_axes(fit.rotation)
    if fit.score < GOOD_FIT or _angle_deg(turn, _ROTATIONS[axes]) <= UPRIGHT_DEG:
        return _ROTATIONS[axes], axes, NO_TURNS
    degrees = _degrees(turn @ _ROTATIONS[axes].T)
    return rotation(axes, degrees), axes, degrees


def _nose_near(
    nose: NoseMatch, turn: Array, mm_per_unit: float, fit: FaceFit | None
) -> tuple[float, float] | None:
    """Return (x, y) near the tip of the nose, mm: the template's, if the fit agrees."""
    near = None if nose.score < MIN_MATCH else nose.near_mm
    if fit is not None:
        behind = np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM]) - fit.shift_mm
        x, y, _ = (mm_per_unit / fit.mm_per_unit) * (turn @ fit.rotation.T @ behind)
        if near is None or math.dist(near, (x, y)) > _SAME_NOSE_MM:
            near = float(x), float(y)
    return near


def _lengths(size: float, unit: str) -> list[list[float]]:
    """Return the lengths of a unit to try, mm: metric ones, then steps of the mesh's size."""
    if unit != "auto":
        length = UNITS_MM[unit] if unit in UNITS_MM else float(unit)
        if MIN_HEAD_MM <= size * length <= MAX_SCENE_MM:
            return [[length]]
        raise MeshError(
            f"with unit={unit} it is {size * length:,.0f} mm across, and should be "
            f"{MIN_HEAD_MM:.0f} to {MAX_SCENE_MM:.0f} mm; try unit='auto' or another unit"
        )
    metric = [UNITS_MM[name] for name in DETECTED_UNITS]
    metric.sort(key=lambda mm: not MIN_HEAD_MM <= size * mm <= MAX_HEAD_MM)
    metric = [mm for mm in metric if MIN_HEAD_MM <= size * mm <= MAX_SCENE_MM]
    return [metric, [size_mm / size for size_mm in SIZES_MM]]


def _find_face(
    samples: Array, dense: Callable[[], Array], lengths: list[list[float]], given: Array | None
) -> FaceFit | None:
    """Return the fit of the face, in the ``given`` rotation if it is one there; None: no face.

    ``dense`` makes more samples: the face of a body is a small part.
    """
    if given is not None:
        fit = search_face(samples, lengths[0], [given], 3, SURE_FIT)
        if fit and fit.score >= GOOD_FIT and _angle_deg(fit.rotation, given) < _OTHER_WAY_DEG:
            return fit
    quarters, size = list(_ROTATIONS.values()), float(np.ptp(samples, axis=1).max())
    best = None
    for sure, group in zip((SURE_FIT, PERFECT_FIT), lengths, strict=False):
        heads = [mm for mm in group if size * mm <= MAX_HEAD_MM]
        bodies = [mm for mm in group if size * mm > MAX_HEAD_MM]
        fit = search_face(samples, heads, quarters, TRIES, sure)
        if bodies and _score(fit) < GOOD_FIT:
            near = search_face(samples, bodies, quarters, 2 * TRIES, sure, dense())
            fit = max(fit, near, key=_score)
        if given is None and _score(fit) < GOOD_FIT:
            some, turns = samples[:, ::FINE_SAMPLES], even_rotations(FINE_ROTATIONS)
            fit = max(fit, search_face(some, heads, turns, TRIES, sure, samples), key=_score)
        known = fit and any(_ratio(fit.mm_per_unit, mm) < METRIC_RATIO for mm in lengths[0])
        if fit and known:
            off_deg = _angle_deg(fit.rotation, rotation(_nearest_axes(fit.rotation)))
            if fit.score >= (PLAIN_FIT if off_deg <= PLAIN_DEG else GOOD_FIT):
                return fit
        best = max(best, fit, key=_score)
    return best if _score(best) >= GOOD_FIT else None


def _score(fit: FaceFit | None) -> float:
    return -1.0 if fit is None else fit.score


def _ratio(first: float, second: float) -> float:
    return max(first / second, second / first)


def _unit_of(fit: FaceFit | None, extent: float, unit: str, doubts: list[str]) -> tuple[str, float]:
    """Return name and length (mm) of the unit; append to ``doubts``. Raises MeshError."""
    if unit != "auto":
        length = UNITS_MM[unit] if unit in UNITS_MM else float(unit)
        if fit is not None and (ratio := _ratio(length, fit.mm_per_unit)) > METRIC_RATIO:
            size = f"{length / fit.mm_per_unit:.2g} times as large as a mean one"
            if ratio > GIVEN_RATIO:
                mean = f"unit='{float(f'{fit.mm_per_unit:.3g}'):g}' makes it so"
                raise MeshError(f"with unit={unit} the face is {size}; {mean}, or try unit='auto'")
            doubts.append(f"with unit {unit} the face is {size}")
        return (unit if unit in UNITS_MM else f"{length:g} mm"), length
    if fit is None:
        lengths = _lengths(extent, unit)[0]
        if not lengths:
            raise MeshError(
                f"it is {extent:.4g} units across and has no face: as {', '.join(UNITS_MM)} it "
                "is no head or body; give the unit's length in millimetres, such as unit='110'"
            )
        length = lengths[0]
        return next((n for n, mm in UNITS_MM.items() if mm == length), f"{length:g} mm"), length
    normalised = min(abs(extent - 1), abs(extent - 2)) < _NORMALISED
    metric = min(DETECTED_UNITS, key=lambda name: _ratio(UNITS_MM[name], fit.mm_per_unit))
    if not normalised and (ratio := _ratio(UNITS_MM[metric], fit.mm_per_unit)) < METRIC_RATIO:
        if ratio > FACE_RATIO:
            size = f"{UNITS_MM[metric] / fit.mm_per_unit:.2g} times as large as a mean one"
            doubts.append(f"with unit {metric} the face is {size}")
        return metric, UNITS_MM[metric]
    if not normalised and _ratio(UNITS_MM["foot"], fit.mm_per_unit) < FACE_RATIO:
        doubts.append("the unit foot is found by the size of the face alone")
        return "foot", UNITS_MM["foot"]
    near = [
        f"'{name}'"
        for name in ("inch", "20")
        if _ratio(OTHER_UNITS[name], fit.mm_per_unit) < FACE_RATIO
    ]
    near += [f"'{float(f'{fit.mm_per_unit:.3g}'):g}'"]
    raise MeshError(
        f"it is of unknown scale, {extent:.4g} units across"
        f"{' (normalised)' if normalised else ''}: unit={near[-1]} gives its face the mean size; "
        f"take unit={' or unit='.join(near)}, or what is true"
    )


def _angle_deg(first: Array, second: Array) -> float:
    """Return the angle of the rotation from one to the other."""
    return math.degrees(math.acos(np.clip((np.trace(first @ second.T) - 1) / 2, -1, 1)))


def _nearest_axes(turn: Array) -> str:
    return max(_ROTATIONS, key=lambda name: float(np.sum(_ROTATIONS[name] * turn)))


def _degrees(turn: Array) -> Turns:
    """Return the turns about x, y and z, in this order, to 0.1 degrees."""
    x, z = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    y = math.asin(np.clip(-turn[2, 0], -1, 1))
    return round(math.degrees(x), 1), round(math.degrees(y), 1), round(math.degrees(z), 1)


def rotation(axes: str, rotation_deg: Turns = NO_TURNS) -> NDArray[np.float64]:
    """Return the (3, 3) rotation from file directions to canonical ones. Raises ConfigError."""
    check_axes(axes)
    turn = _ROTATIONS[axes]
    for vector, degrees in zip(np.eye(3), rotation_deg, strict=True):
        turn = cv2.Rodrigues(vector * math.radians(degrees))[0] @ turn if degrees else turn
    return turn


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


def _is_clockwise(points_mm: NDArray[np.floating], faces: NDArray[np.integer]) -> bool:
    """Return whether most triangles (F, 3) of (V, 3) points seen from +z are clockwise, by area."""
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
