"""Match a template of the nose and its surroundings to a surface seen from +z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

CELL_MM: Final = 5.0  # a nose is 30 mm wide: six cells
SAMPLES: Final = 150_000  # a bust with its inner surfaces has 6000 cm2 or more: 6 per cell
TIP_SAMPLES: Final = 80_000  # 120 per mm2: they place the tip to 0.03 mm
TIP_MM: Final = 2.0  # depth of the ball of the tip
SCALES: Final = (0.8, 1.0, 1.25)  # children to the largest adults
GAIN: Final = (0.5, 2.0)  # a nose is half to twice as deep as the template; others are no nose
CLIP_MM: Final = (-45.0, 15.0)  # clips hair, ears and background, so that they do not dominate
HOLE_MM: Final = -30.0  # depth assumed in a hole: about that of the cheek behind the nose tip
MIN_COVERAGE: Final = 0.6  # share of template cells with surface: more than at an edge of the mesh
RIDGE_MM: Final = 6.0  # least height of a nose tip over the points 20 mm beside it
FAR_MM: Final = 25.0  # allowed distance of the tip behind the foremost point (chin, cap, fringe)
FAR_COST: Final = 0.004  # correlation subtracted per mm beyond FAR_MM
FARTHEST_MM: Final = 50.0  # beyond, what is in front is no part of the head: an arm, a table
APART_CELLS: Final = 6  # 30 mm: the width of a nose
ASYMMETRY_COST: Final = 0.005  # subtracted per mm of left-right difference, mean over 140 mm
ASYMMETRY_CLIP_MM: Final = (-60.0, 15.0)  # mm; ears, 90 mm behind the tip, are clipped

# The template's cells around the nose tip: 35 mm to each side, 50 mm down (chin), 55 mm up (brows).
_X, _Y = np.meshgrid(np.arange(-7, 8) * CELL_MM, np.arange(-10, 12) * CELL_MM)
_BELOW, _ABOVE, _SIDE = 10, 11, 7
_HALF_FACE = 14  # cells, 70 mm: width on each side for the comparison of left and right


@dataclass(frozen=True)
class NoseMatch:
    """A match: correlation (-1: none), (x, y) of the template's middle cell, and its height, mm."""

    score: float
    near_mm: tuple[float, float]
    top_mm: float = 0.0


def sample_surface(
    vertices: NDArray[np.floating], faces: NDArray[np.integer], count: int = SAMPLES
) -> NDArray[np.float64]:
    """Return (3, count) points spread evenly by area over a mesh (V, 3), (F, 3); deterministic.

    Each of ``count`` equal shares of the area gets a random point. Points at even steps would beat
    with the rows of a fine mesh and leave empty stripes.
    """
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    cumulative = np.cumsum(area)
    share, u, v = np.random.default_rng(0).random((3, count))
    hit = np.searchsorted(cumulative, (np.arange(count) + share) / count * cumulative[-1])
    hit = np.minimum(hit, len(faces) - 1)
    outside = u + v > 1
    u[outside], v[outside] = 1 - u[outside], 1 - v[outside]
    points = first[hit] + (second - first)[hit] * u[:, None] + (third - first)[hit] * v[:, None]
    return np.ascontiguousarray(points.T, dtype=np.float64)


def find_tip(
    points_mm: NDArray[np.floating], faces: NDArray[np.integer], near_mm: tuple[float, float]
) -> tuple[float, float, float] | None:
    """Return the nose tip, whatever the triangles: x and y of the ball's middle, z of its front.

    None where there is no surface.

    Points (V, 3) have z out of the face; ``near_mm`` is (x, y) within a few cells of the tip.
    """
    x, y, z = near_mm[0], near_mm[1], 0.0
    columns, corners = points_mm.T[:2], np.ascontiguousarray(faces.T)
    for _ in range(4):  # until the square holds the whole ball
        middle = np.array([x, y])
        near = np.ones(len(faces), bool)
        for column, centre in zip(columns, middle, strict=True):
            for beyond in (column <= centre + 2 * CELL_MM, column >= centre - 2 * CELL_MM):
                near &= np.logical_or.reduce(beyond[corners])
        if not near.any():
            return None
        samples = sample_surface(points_mm, faces[near], TIP_SAMPLES)
        inside = (np.abs(samples[:2] - middle[:, None]) <= 2 * CELL_MM).all(axis=0)
        samples = samples[:, inside]
        if samples.shape[1] == 0:
            return None
        z = float(samples[2].max())
        x, y = samples[:2, samples[2] >= z - TIP_MM].mean(axis=1)
    return float(x), float(y), z


def match_nose(points_mm: NDArray[np.floating]) -> NoseMatch:
    """Return the best match of the template in points (3, N) seen from +z."""
    return match_noses(points_mm, 1)[0]


def match_noses(
    points_mm: NDArray[np.floating], count: int, least: float = -1.0
) -> list[NoseMatch]:
    """Slide the template over the height map of points (3, N) seen from +z; best matches first.

    At least APART_CELLS apart, and better than ``least``; without any, one of correlation -1.
    """
    lower = points_mm[:2].min(axis=1)
    column, row = ((points_mm[:2] - lower[:, None]) / CELL_MM).astype(np.int64)
    width, height = int(column.max()) + 1, int(row.max()) + 1
    flat = np.full(width * height, -np.inf)
    np.maximum.at(flat, row * width + column, points_mm[2])
    top = flat.reshape(height, width)
    padded = np.pad(top, ((_BELOW, _ABOVE), (_SIDE, _SIDE)), constant_values=-np.inf)
    rows = slice(_BELOW, _BELOW + height)
    beside = np.maximum(
        padded[rows, _SIDE - 4 : _SIDE - 4 + width], padded[rows, _SIDE + 4 : _SIDE + 4 + width]
    )
    kernel, anchor = _X.shape[::-1], (_SIDE, _BELOW)
    surface = np.isfinite(top).astype(np.float32)
    covered = cv2.boxFilter(surface, -1, kernel, anchor=anchor, borderType=cv2.BORDER_CONSTANT)
    y, x = np.nonzero((surface > 0) & (covered > MIN_COVERAGE) & (top > beside + RIDGE_MM))
    if len(y) == 0:
        return [NoseMatch(-1.0, (0.0, 0.0))]
    windows = np.lib.stride_tricks.sliding_window_view(padded, _X.shape)[y, x]
    depth = windows.reshape(len(y), -1) - top[y, x][:, None]
    depth = np.where(np.isfinite(depth), np.clip(depth, *CLIP_MM), HOLE_MM)
    depth -= depth @ _PLANE @ _PLANE.T
    product = depth @ _TEMPLATES.T
    correlation = product / (np.linalg.norm(depth, axis=1)[:, None] * _TEMPLATE_NORMS + 1e-9)
    gain = product / _TEMPLATE_NORMS**2
    fits = (gain > GAIN[0]) & (gain < GAIN[1])
    score = np.where(fits, correlation, correlation * 0.5).max(axis=1)
    score -= FAR_COST * np.clip(top.max() - top[y, x] - FAR_MM, 0.0, FARTHEST_MM)
    high = score > least  # asymmetry, which takes most of the time, only lowers the score
    y, x, score = y[high], x[high], score[high]
    score -= ASYMMETRY_COST * _asymmetry(top, y, x)
    score[score <= least] = -np.inf
    matches: list[NoseMatch] = []
    while len(matches) < count and np.isfinite(score).any():
        best = int(np.argmax(score))
        x_mm, y_mm = lower + (np.array([x[best], y[best]]) + 0.5) * CELL_MM
        near = float(x_mm), float(y_mm)
        matches.append(NoseMatch(float(score[best]), near, float(top[y[best], x[best]])))
        score[np.hypot(x - x[best], y - y[best]) < APART_CELLS] = -np.inf
    return matches or [NoseMatch(-1.0, (0.0, 0.0))]


def _asymmetry(
    top: NDArray[np.float64], y: NDArray[np.int64], x: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return (N,) mean difference, mm, between left and right of cells of a height map (H, W)."""
    padded = np.pad(top, ((_BELOW, _ABOVE), (_HALF_FACE, _HALF_FACE)), constant_values=-np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (len(_X), 2 * _HALF_FACE + 1))[y, x]
    depth = np.clip(windows - top[y, x][:, None, None], *ASYMMETRY_CLIP_MM)
    left, right = depth[:, :, :_HALF_FACE], depth[:, :, : -_HALF_FACE - 1 : -1]
    return np.asarray(np.abs(left - right).mean(axis=(1, 2)))


def _nose_template(scale: float) -> NDArray[np.float64]:
    """Return the template (22, 15): height relative to the nose tip, mm.

    Adult proportions as in any drawing manual: nose 21 mm high, bridge falling over 40 mm upwards,
    base over 16 mm downwards, lips 28 mm below the tip. The hollows beside the bridge are twice as
    deep as in reality, because they distinguish up from down.
    """
    x, y = _X / scale, _Y / scale
    base = np.interp(y, [-55, -45, 10, 25, 60], [-21, -19, -21, -24, -22]) - x**2 / (2 * 70)
    height = np.interp(y, [-16, -8, 0, 10, 20, 30, 40], [4, 11, 21, 19, 14, 6, 0])
    half_width = np.interp(y, [-14, 0, 10, 30], [13, 12, 10, 8])
    nose = height * np.exp(-((x / half_width) ** 4) / 2)
    hollows = -14 * np.exp(-((np.abs(x) - 21) ** 2) / (2 * 8**2) - (y - 30) ** 2 / (2 * 13**2))
    lips = 6 * np.exp(-(x**2) / (2 * 20**2) - (y + 28) ** 2 / (2 * 10**2))
    return np.asarray((base + nose + hollows + lips) * scale)


# A head's pitch and yaw tilt its surface: planes are removed from the surface and the template.
_PLANE: Final = np.linalg.qr(np.stack([np.ones(_X.size), _X.ravel(), _Y.ravel()], axis=1))[0]
_HEIGHTS: Final = np.stack([_nose_template(scale).ravel() for scale in SCALES])
_TEMPLATES: Final = _HEIGHTS - _HEIGHTS @ _PLANE @ _PLANE.T
_TEMPLATE_NORMS: Final = np.linalg.norm(_TEMPLATES, axis=1)
