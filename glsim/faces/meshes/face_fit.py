"""Fit the mean face to a surface: the head's size and pose, and whether it is a face at all.

The nose template gives where to begin. Then Gauss-Newton steps of a rotation, a shift and a scale
bring the surface's heights onto those of the mean face, point to plane (Chen and Medioni 1992);
hair has no weight. Other round shapes, and faces upside down, fit to a few millimetres too: the
score is the match of the nose template where the fit puts the tip, times the covered share. On 40
people of MakeHuman, 20 of ICT-FaceKit and 80 other shapes the likeness to the mean face told
faces less well, even after 60 modes of identity were fitted to them.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np

from glsim.core.array_types import Array, Whole
from glsim.faces.meshes.nose_template import (
    TIP_MM,
    NoseMatch,
    match_nose,
    match_noses,
    sample_surface,
)

ORIGIN_BEHIND_NOSE_MM: Final = 45.0
"""Distance of the canonical origin, between the cheek bones, behind the nose tip, mm."""

_CELL_MM: Final = 4.0
_CELLS: Final = ((15, 16), (14, 26))  # to the right and left, below and above the tip of the nose
_FIRST: Final = np.array([[15], [14]])
_HALF_WIDTH_MM, _HALF_HEIGHT_MM, _MIDDLE_MM = 58.0, 74.0, 22.0  # an ellipse to the hairline
_LOWEST_MM = -24.0  # at the upper lip: jaws move
#: The mean of the embedded heads is turned and enlarged to the middle between them and 25 heads of
#: ICT-FaceKit, which look 6 degrees further down and are 6 % larger.
_PITCH_DEG, _ENLARGED = -2.3, 1.064
#: Damping of the Gauss-Newton steps per cell, which keeps them small where a face is flat. The
#: value was chosen, not measured.
_DAMPING: Final = 1e-3
_BACK_MM: Final = -60.0  # of the embedded heads: the face lies before it
_LAYER_MM: Final = 6.0  # depth of a cell's foremost layer
_STEPS: Final = 30
_FIRST_STEPS, _LEAST_NEAR = 9, 0.25  # chosen: half of a face or more lies within 5 mm at the end
_WIDEST_MM, _NARROWEST_MM, _NARROWER = 30.0, 9.0, 0.8  # residuals beyond have no weight
_LEAST_MATCH: Final = 0.5  # a face that is turned by 15 degrees matches a nose better
_REACH_MM: Final = 60.0  # a cell farther from the mean face has no surface
_NOSE_PLACE_MM: Final = 20.0  # 90 % of the noses of right fits lie 18 mm from the mean tip or less
_WINDOW_MM: Final = 110.0  # both sides of a face, for the comparison of left and right
_POINTS: Final = 10_000


class FaceFit(NamedTuple):
    """A similarity from a file to the canonical frame: ``mm_per_unit * rotation @ p + shift_mm``.

    ``score``: match of the nose in its place, times the share of the face with surface, 0 to 1.
    """

    score: float
    mm_per_unit: float
    rotation: Array
    shift_mm: Array


@dataclass(frozen=True)
class _MeanFace:
    """K cells of the mean face: (3, K) points and normals; number by place."""

    points: Array
    normals: Array
    number: Whole


@functools.cache
def _mean_face() -> _MeanFace:
    from glsim.faces.procedural.model import head_model

    model = head_model()
    turn = cv2.Rodrigues(np.radians([_PITCH_DEG, 0.0, 0.0]))[0]
    front = model.triangles[model.template_mm[model.triangles, 2].min(axis=1) > _BACK_MM]
    points = turn @ sample_surface(model.template_mm, front) * _ENLARGED
    tip = points[:, points[2] > points[2].max() - TIP_MM].mean(axis=1)
    points -= np.array([[0.0], [tip[1]], [points[2].max() - ORIGIN_BEHIND_NOSE_MM]])
    x, y = np.meshgrid(*(np.arange(-first, last) * _CELL_MM for first, last in _CELLS))
    every = np.arange(x.size).reshape(x.shape)
    cells, means = _foremost(points, every, np.zeros(x.size), 1e9)
    height = np.zeros(x.size)
    height[cells] = means[2]
    rise_y, rise_x = np.gradient(height.reshape(x.shape), _CELL_MM)
    normals = np.stack([-rise_x, -rise_y, np.ones_like(x)])
    normals /= np.linalg.norm(normals, axis=0)
    face = (x / _HALF_WIDTH_MM) ** 2 + ((y - _MIDDLE_MM) / _HALF_HEIGHT_MM) ** 2 < 1
    face &= y > _LOWEST_MM
    x, y, z = x[face], y[face], height.reshape(face.shape)[face]
    number = np.where(face, np.cumsum(face).reshape(face.shape) - 1, -1)
    return _MeanFace(np.stack([x, y, z]), normals[:, face], number)


def _foremost(
    points: Array, number: Whole, expected: Array, reach_mm: float
) -> tuple[Whole, Array]:
    """Return the cells with points near the expected heights, and the foremost layer's means."""
    column, row = np.rint(points[:2] / _CELL_MM).astype(int) + _FIRST
    rows, columns = number.shape
    inside = np.flatnonzero((column >= 0) & (column < columns) & (row >= 0) & (row < rows))
    cell = number[row[inside], column[inside]]
    near = (cell >= 0) & (np.abs(points[2, inside] - expected[cell]) < reach_mm)
    inside, cell = inside[near], cell[near]
    top = np.full(len(expected), -np.inf)
    np.maximum.at(top, cell, points[2, inside])
    front = points[2, inside] > top[cell] - _LAYER_MM
    inside, cell = inside[front], cell[front]
    counts = np.bincount(cell, minlength=len(expected))
    sums = np.stack([np.bincount(cell, side[inside], len(expected)) for side in points])
    filled = np.flatnonzero(counts)
    return filled, sums[:, filled] / counts[filled]


def fit_face(
    samples: Array, rotation: Array, mm_per_unit: float, nose: NoseMatch
) -> FaceFit | None:
    """Fit the mean face from a first guess; None where most of it is missing.

    ``samples`` (3, N) lie on the surface, in the file's frame and unit; ``rotation`` (3, 3) turns
    file directions to canonical ones; ``match_noses`` found ``nose`` in the turned points, mm.
    """
    face = _mean_face()
    tip = np.array([*nose.near_mm, nose.top_mm])
    shift, scale = np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM]) - tip, mm_per_unit
    points = scale * (rotation @ samples) + shift[:, None]
    every = samples[:, (np.abs(points) < 1.5 * _WINDOW_MM).all(axis=0)]
    samples = samples[:, (np.abs(points) < _WINDOW_MM).all(axis=0)]
    samples = samples[:, :: len(samples[0]) // _POINTS + 1]
    for step in range(_STEPS):
        points = scale * (rotation @ samples) + shift[:, None]
        gate = max(_WIDEST_MM * _NARROWER**step, _NARROWEST_MM)
        cells, means = _foremost(points, face.number, face.points[2], 1.5 * gate)
        if len(cells) < 0.3 * face.points.shape[1]:
            return None
        normals, away = face.normals[:, cells], means - face.points[:, cells]
        residual = (normals * away).sum(axis=0)
        weight = np.clip(1 - (residual / gate) ** 2, 0, 1) ** 2
        if step == _FIRST_STEPS and weight.sum() < _LEAST_NEAR * face.points.shape[1]:
            return None
        turns = np.cross(means.T, normals.T)
        moves = np.column_stack([turns, normals.T, (normals * means).sum(axis=0)])
        normal_matrix = (moves * weight[:, None]).T @ moves + _DAMPING * len(cells) * np.eye(7)
        change = -np.linalg.solve(normal_matrix, moves.T @ (weight * residual))
        turn = cv2.Rodrigues(np.clip(change[:3], -0.2, 0.2))[0]
        growth = 1 + float(np.clip(change[6], -0.1, 0.1))
        rotation, scale = turn @ rotation, scale * growth
        shift = growth * (turn @ shift) + np.clip(change[3:6], -15, 15)
        if gate == _NARROWEST_MM and np.abs(change * [99, 99, 99, 1, 1, 1, 99]).max() < 0.3:
            break
    points = scale * (rotation @ every) + shift[:, None]
    cells, _ = _foremost(points, face.number, face.points[2], _REACH_MM)
    points = points[:, (np.abs(points) < _WINDOW_MM).all(axis=0)]
    found = match_nose(points) if points.shape[1] else NoseMatch(-1.0, (0.0, 0.0))
    score = max(found.score, 0.0) * len(cells) / face.points.shape[1]
    if np.hypot(*found.near_mm) > _NOSE_PLACE_MM:
        score = 0.0
    return FaceFit(score, scale, rotation, shift)


def search_face(
    samples: Array, scales: Sequence[float], rotations: Iterable[Array], tries: int, good: float,
    dense: Array | None = None,
) -> FaceFit | None:  # fmt: skip
    """Return the best fit of ``tries`` noses, the best of all scales and rotations; None without.

    The first fit whose score is at least ``good`` ends the search. Noses are found in ``samples``,
    and fitted to the ``dense`` ones, which default to them.
    """
    begins = [
        (nose, scale, rotation)
        for rotation in rotations
        for turned in [rotation @ samples]
        for scale in scales
        for nose in match_noses(turned * scale, 2, _LEAST_MATCH)
        if nose.score > _LEAST_MATCH
    ]
    begins.sort(key=lambda begin: -begin[0].score)
    best = None
    for nose, scale, rotation in begins[:tries]:
        fit = fit_face(samples if dense is None else dense, rotation, scale, nose)
        if fit is not None and (best is None or fit.score > best.score):
            best = fit
            if fit.score >= good:
                break
    return best


@functools.cache
def even_rotations(count: int) -> list[Array]:
    """Return rotations spread evenly: super-Fibonacci quaternions (Alexa 2022)."""
    number = np.arange(count) + 0.5
    inner, outer = np.sqrt(number / count), np.sqrt(1 - number / count)
    a, b = 2 * np.pi * number / np.sqrt(2), 2 * np.pi * number / 1.533751168755204288118041
    quaternions = np.stack(
        [outer * np.cos(b), inner * np.sin(a), inner * np.cos(a), outer * np.sin(b)]
    )
    half = np.arccos(np.clip(quaternions[0], -1, 1))
    vectors = quaternions[1:] * 2 * half / np.maximum(np.sin(half), 1e-12)
    return [cv2.Rodrigues(vector)[0] for vector in vectors.T]
