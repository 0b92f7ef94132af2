"""A relief of the middle of a face, and where it fits best on a surface seen from +z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

CELL_MM: Final = 5.0  # a nose is 30 mm wide: six cells
SAMPLES: Final = 40_000  # a head and what is in it have 3000 cm2 and more: 3 samples a cell
SCALES: Final = (0.8, 1.0, 1.25)  # children to the largest adults
GAIN: Final = (0.5, 2.0)  # relief may be half to twice as deep; anything else is another thing
CLIP_MM: Final = (-45.0, 15.0)  # depths beyond are hair, ears, background: they must not dominate
HOLE_MM: Final = -30.0  # what a hole counts as: about the cheek's depth behind the nose tip
COVERED: Final = 0.6  # of the relief must lie on the surface: an open mouth passes, an edge not
RIDGE_MM: Final = 6.0  # a nose tip stands out by more than this over the points 20 mm beside it
FAR_MM: Final = 25.0  # the tip may lie this far behind the foremost point (chin, cap, fringe) ...
FAR_COST: Final = 0.004  # ... and loses this much correlation for each mm more
SKEW_COST: Final = 0.005  # so does each mm by which left and right differ, mean over 140 mm
SKEW_CLIP_MM: Final = (-60.0, 15.0)  # the ears lie some 90 mm back: how far does not matter

# Cells around the nose tip: 35 mm to either side, 50 mm down (chin), 55 mm up (brows).
_X, _Y = np.meshgrid(np.arange(-7, 8) * CELL_MM, np.arange(-10, 12) * CELL_MM)
_BELOW, _ABOVE, _SIDE = 10, 11, 7
_WIDE = 14  # 70 mm: half a face for the comparison of left and right


@dataclass(frozen=True)
class Nose:
    """Best place of the relief: correlation (-1: none at all), and the tip of the nose in mm."""

    score: float
    tip_mm: tuple[float, float, float]


def sample_surface(
    vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> NDArray[np.float32]:
    """(SAMPLES, 3) points spread evenly by area, the same on every call."""
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    steps = np.cumsum(area)
    index = np.arange(SAMPLES)
    hit = np.searchsorted(steps, (index + 0.5) / SAMPLES * steps[-1])
    hit = np.minimum(hit, len(faces) - 1)
    # The plastic number's sequence fills the unit square evenly (Roberts 2018, "R2").
    u, v = (index * 0.7548776662466927) % 1, (index * 0.5698402909980532) % 1
    outside = u + v > 1
    u[outside], v[outside] = 1 - u[outside], 1 - v[outside]
    points = first[hit] + (second - first)[hit] * u[:, None] + (third - first)[hit] * v[:, None]
    return np.asarray(points, dtype=np.float32)


def best_nose(points_mm: NDArray[np.floating]) -> Nose:
    """Slide the relief over the height map of points (N, 3) seen from +z."""
    lower = points_mm.min(axis=0)
    cell = ((points_mm[:, :2] - lower[:2]) / CELL_MM).astype(np.int64)
    width, height = (int(size) + 1 for size in cell.max(axis=0))
    flat = np.full(width * height, -np.inf)
    np.maximum.at(flat, cell[:, 1] * width + cell[:, 0], points_mm[:, 2])
    top = flat.reshape(height, width)
    padded = np.pad(top, ((_BELOW, _ABOVE), (_SIDE, _SIDE)), constant_values=-np.inf)
    rows = slice(_BELOW, _BELOW + height)
    beside = np.maximum(
        padded[rows, _SIDE - 4 : _SIDE - 4 + width], padded[rows, _SIDE + 4 : _SIDE + 4 + width]
    )
    y, x = np.nonzero(np.isfinite(top) & (top > beside + RIDGE_MM))
    if len(y) == 0:
        return Nose(-1.0, (0.0, 0.0, 0.0))
    windows = np.lib.stride_tricks.sliding_window_view(padded, _X.shape)[y, x]
    depth = windows.reshape(len(y), -1) - top[y, x][:, None]
    surface = np.isfinite(depth)
    depth = np.where(surface, np.clip(depth, *CLIP_MM), HOLE_MM)
    depth -= depth @ _PLANE @ _PLANE.T
    product = depth @ _RELIEFS.T
    correlation = product / (np.linalg.norm(depth, axis=1)[:, None] * _NORMS + 1e-9)
    gain = product / _NORMS**2
    fits = (gain > GAIN[0]) & (gain < GAIN[1]) & (surface.mean(axis=1) > COVERED)[:, None]
    score = np.where(fits, correlation, correlation * 0.5).max(axis=1)
    score -= SKEW_COST * _skew(top, y, x)
    score -= FAR_COST * np.clip(top.max() - top[y, x] - FAR_MM, 0.0, None)
    best = int(np.argmax(score))
    middle = lower[:2] + (np.array([x[best], y[best]]) + 0.5) * CELL_MM
    near = points_mm[(np.abs(points_mm[:, :2] - middle) <= 2 * CELL_MM).all(axis=1)]
    tip = near[near[:, 2] >= near[:, 2].max() - 2.0].mean(axis=0)  # 2 mm: the ball of the tip
    return Nose(float(score[best]), (float(tip[0]), float(tip[1]), float(near[:, 2].max())))


def _skew(
    top: NDArray[np.float64], y: NDArray[np.int64], x: NDArray[np.int64]
) -> NDArray[np.float64]:
    """(N,) mean difference between left and right of each candidate, mm."""
    padded = np.pad(top, ((_BELOW, _ABOVE), (_WIDE, _WIDE)), constant_values=-np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (len(_X), 2 * _WIDE + 1))[y, x]
    depth = np.clip(windows - top[y, x][:, None, None], *SKEW_CLIP_MM)
    left, right = depth[:, :, :_WIDE], depth[:, :, : -_WIDE - 1 : -1]
    return np.asarray(np.abs(left - right).mean(axis=(1, 2)))


def _relief(scale: float) -> NDArray[np.float64]:
    """Depth behind the nose tip, mm: adult proportions as in any drawing manual.

    Nose 21 mm high, its bridge falling over 40 mm upwards and its base over 16 mm downwards,
    lips 28 mm below the tip; the hollows beside the bridge twice as deep as they are, because they
    are what tells up from down.
    """
    x, y = _X / scale, _Y / scale
    base = np.interp(y, [-55, -45, 10, 25, 60], [-21, -19, -21, -24, -22]) - x**2 / (2 * 70)
    height = np.interp(y, [-16, -8, 0, 10, 20, 30, 40], [4, 11, 21, 19, 14, 6, 0])
    half_width = np.interp(y, [-14, 0, 10, 30], [13, 12, 10, 8])
    nose = height * np.exp(-((x / half_width) ** 4) / 2)
    hollows = -14 * np.exp(-((np.abs(x) - 21) ** 2) / (2 * 8**2) - (y - 30) ** 2 / (2 * 13**2))
    lips = 6 * np.exp(-(x**2) / (2 * 20**2) - (y + 28) ** 2 / (2 * 10**2))
    return np.asarray((base + nose + hollows + lips) * scale)


# A head's pitch and yaw tilt the relief: planes are taken out of both sides.
_PLANE: Final = np.linalg.qr(np.stack([np.ones(_X.size), _X.ravel(), _Y.ravel()], axis=1))[0]
_TILTED: Final = np.stack([_relief(scale).ravel() for scale in SCALES])
_RELIEFS: Final = _TILTED - _TILTED @ _PLANE @ _PLANE.T
_NORMS: Final = np.linalg.norm(_RELIEFS, axis=1)
