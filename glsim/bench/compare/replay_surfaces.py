"""Surfaces of one real frame, without its noise, for a replay.

A frame is cut into surfaces where neighbouring depths jump; tiny surfaces are flying pixels. Local
planes in 1/z smooth each surface; relief rougher than the camera's noise stays. A gap between a
near and a far surface (a shadow, or the rim that cameras leave) is filled by the far surface, which
also continues behind the rim of the near surface; a hole within a surface is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Mask
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import DepthFrame
from glsim.core.depth_map import FITTED_STEP, grid_triangles
from glsim.core.mesh import Mesh
from glsim.core.units import MM_PER_M
from glsim.measures.quadrics import local_planes

Labels = NDArray[np.int64]

#: Where noise is large, neighbours on one surface differ by at most this multiple of the median
#: difference at their distance. The second constant has the bounds of the classes of distance, mm.
#: Both were chosen, not measured.
_STEP_NOISE, _BINS_MM = 8.0, np.geomspace(200.0, 8000.0, 17)
#: Smallest surface, pixels; smaller groups are flying pixels and speckle. Chosen, not measured.
_LEAST_PX = 40
#: The smoothing divides depth into slabs and fits each plane to three of them: thickness of a slab
#: as a share of the depth, and the share of a window's pixels that must lie in the slab. Chosen: a
#: rail 5 px wide fills half of its window.
_SLAB, _LEAST_NEIGHBOURS = 0.06, 0.2
#: The two ends of a gap belong to different surfaces if their depths differ by more than this
#: multiple of the largest difference of neighbours on one surface. Chosen, not measured.
_APART = 3.0
#: Number of pixels by which a near surface is extended into the gap beside it. Chosen: half of the
#: two to three pixels that all cameras leave empty on the side without shadow.
_RIM_PX = 1
#: Widest gap that is filled, px. Inside the image: a head at 0.6 m before a wall at 3 m has a gap
#: of 24 px. At the image border: a D435 at 0.4 m leaves an empty band.
_WIDEST_GAP_PX, _WIDEST_BAND_PX = 80, 60
#: Pixels by which a far surface continues behind a near surface; no camera here sees so far.
_BEHIND_PX = 60
#: Noise is measured in classes of infrared, or of depth without infrared: the bounds of the
#: classes, counts or mm; the smallest number of pixels in a class; and the quantile of the variance
#: that represents the smoothest surfaces. All three were chosen, not measured.
_CLASSES, _LEAST_CLASS_PX, _SMOOTHEST = np.geomspace(100.0, 65_000.0, 34), 500, 0.25
#: Variance is relief only above this multiple of the noise floor. Chosen: for noise alone, the
#: lower quartile in a window of 3 px is 0.8 of the variance, so that three quarters of a plane keep
#: no relief.
_RELIEF_OVER_NOISE = 1.7
#: Relief is removed up to this distance from a rim, px (flying pixels). Chosen, not measured.
_RELIEF_RIM_PX = 2


@dataclass(frozen=True, eq=False)
class ReplaySurfaces:
    """Smoothed surfaces of one frame; far surfaces continue behind the rims of near surfaces.

    Attributes:
        front_mm: (H, W) smoothed depth of the visible surfaces, mm; NaN = unknown.
        behind_mm: (H, W) depth of far surfaces behind the rims of near surfaces; NaN elsewhere.
        label: (H, W) number of the surface of ``front_mm``; -1 = none.
        light_from: (H, W) flat index of the pixel from which ``front_mm`` takes its reflectivity.
            It is the pixel itself; in a filled gap, it is the last pixel of the filling surface.
        behind_from: (H, W) flat index of the pixel from which ``behind_mm`` takes its reflectivity.
    """

    front_mm: Array
    behind_mm: Array
    label: Labels
    light_from: Labels
    behind_from: Labels


def find_surfaces(
    depth_mm: NDArray[np.float32],
    smooth_px: float,
    widest_hole_px: int,
    noise_mm2: Array | None = None,
) -> ReplaySurfaces:
    """Find the surfaces of a depth map and smooth them.

    Args:
        depth_mm: (H, W) mm, NaN where there is no depth.
        smooth_px: standard deviation of the Gaussian window of the smoothing, px.
        widest_hole_px: widest hole within a surface to close.
        noise_mm2: (H, W) variance of the noise, mm^2; relief above it stays. None: no relief.
    """
    label, front = smooth_surfaces(depth_mm, smooth_px)
    if noise_mm2 is not None:
        front = keep_relief(depth_mm, front, label, noise_mm2, smooth_px)
    index = np.arange(front.size, dtype=np.int64).reshape(front.shape)
    light_from = index.copy()
    _fill_rows(front, label, light_from, widest_hole_px)
    _fill_rows(front.T, label.T, light_from.T, widest_hole_px)
    behind, place = _behind_rows(front, index)
    below, place_below = (part.T for part in _behind_rows(front.T, index.T))
    by_rows = np.isfinite(behind)
    behind_from = light_from.ravel()[np.where(by_rows, place, place_below)]
    return ReplaySurfaces(front, np.where(by_rows, behind, below), label, light_from, behind_from)


def mesh_of(surfaces: ReplaySurfaces, camera: Intrinsics, albedo: Array) -> Mesh:
    """Join the pixels of all surfaces into one mesh in the camera frame, mm.

    Raises MeshError if there is no surface. ``albedo``: (H, W), relative to a white wall.
    """
    rays = camera.rays().astype(np.float64)
    front = surfaces.front_mm, surfaces.label, surfaces.light_from
    behind = surfaces.behind_mm, None, surfaces.behind_from
    vertices, faces, lights = [], [], []
    count = 0
    for depth, label, light_from in (front, behind):
        used, corners = _triangles(depth, label)
        points = np.concatenate([rays * depth[..., None], depth[..., None]], axis=-1)
        vertices.append(points.reshape(-1, 3)[used])
        lights.append(albedo.ravel()[light_from.ravel()[used]])
        faces.append(corners + count)
        count += len(used)
    return Mesh(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(lights).astype(np.float32),
    )


def _triangles(depth: Array, label: Labels | None) -> tuple[Labels, NDArray[np.int32]]:
    """Return the flat indices of the pixels with depth, and the triangles between them."""
    corners = grid_triangles(depth.shape)
    z = depth.ravel()[corners]
    low, high = z.min(axis=1), z.max(axis=1)
    with np.errstate(invalid="ignore"):
        joined = high - low <= FITTED_STEP.limit_mm(low)
    if label is not None:
        of = label.ravel()[corners]
        joined |= (of[:, 0] == of[:, 1]) & (of[:, 1] == of[:, 2])
    used, faces = np.unique(corners[np.isfinite(low) & joined], return_inverse=True)
    return used, faces.reshape(-1, 3).astype(np.int32)


# --- surfaces and their smoothing ---------------------------------------------------------------


def smooth_surfaces(depth_mm: NDArray[np.float32], smooth_px: float) -> tuple[Labels, Array]:
    """Number the surfaces of a depth map and smooth each surface.

    Returns:
        (H, W) number of each pixel's surface, -1 = none; and (H, W) smoothed depth, mm, NaN for
        pixels without a surface.
    """
    label = _connected(depth_mm)
    smooth = _smoothed(depth_mm, label >= 0, smooth_px)
    return np.where(np.isfinite(smooth), label, -1), smooth


def _connected(depth_mm: NDArray[np.float32]) -> Labels:
    """Number the connected surfaces; -1 for pixels without depth and for tiny surfaces."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    z = depth_mm.astype(np.float64)
    across, down = np.abs(np.diff(z, axis=1)), np.abs(np.diff(z, axis=0))
    differences = np.concatenate([across.ravel(), down.ravel()])
    at = np.concatenate([z[:, :-1].ravel(), z[:-1].ravel()])
    limit = _limit_mm(np.nan_to_num(z), differences, at)
    index = np.arange(z.size).reshape(z.shape)
    with np.errstate(invalid="ignore"):
        right, below = across <= limit[:, :-1], down <= limit[:-1]
    first = np.concatenate([index[:, :-1][right], index[:-1][below]])
    second = np.concatenate([index[:, 1:][right], index[1:][below]])
    graph = coo_matrix((np.ones(first.size, np.bool_), (first, second)), shape=(z.size, z.size))
    label = connected_components(graph, directed=False)[1]
    kept = (np.bincount(label)[label] >= _LEAST_PX) & np.isfinite(z.ravel())
    return np.asarray(np.where(kept, label, -1).reshape(z.shape), np.int64)


def _limit_mm(depth_mm: Array, differences: Array, at: Array) -> Array:
    """Compute the largest depth difference of neighbours on one surface, for each depth, mm."""
    near = np.isfinite(differences)
    place = np.digitize(at[near], _BINS_MM)
    medians = np.full(len(_BINS_MM) + 1, np.nan)
    for k in np.unique(place):
        chosen = differences[near][place == k]
        if chosen.size >= 100:
            medians[k] = np.median(chosen)
    known = np.isfinite(medians)
    rule: Array = FITTED_STEP.limit_mm(depth_mm)
    if not known.any():
        return rule
    centres = np.concatenate([_BINS_MM[:1], np.sqrt(_BINS_MM[1:] * _BINS_MM[:-1]), _BINS_MM[-1:]])
    noise = np.interp(depth_mm, centres[known], medians[known])
    return np.asarray(np.maximum(rule, _STEP_NOISE * noise))


def _smoothed(depth_mm: NDArray[np.float32], known: Mask, sigma_px: float) -> Array:
    """Smooth by planes in 1 / z. Planes are fitted within depth slabs, so surfaces do not mix."""
    if not known.any():
        return np.full(depth_mm.shape, np.nan)
    level = np.where(known, np.log(np.where(known, depth_mm, 1.0)) / _SLAB, -10.0)
    lower = np.floor(level)
    above = level - lower  # weight of the next slab, so that slabs blend smoothly
    total, weight = np.zeros(depth_mm.shape), np.zeros(depth_mm.shape)
    away = np.arange(-np.ceil(3 * sigma_px), np.ceil(3 * sigma_px) + 1)
    gaussian = np.exp(-0.5 * (away / sigma_px) ** 2)
    for centre in range(int(lower[known].min()), int(lower[known].max()) + 2):
        share = np.where(lower == centre, 1.0 - above, np.where(lower == centre - 1, above, 0.0))
        mask = np.abs(level - centre) < 1.5
        if not share.any():
            continue
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        inside = mask[part]
        d = np.where(inside, MM_PER_M / np.where(inside, depth_mm[part], 1.0), 0.0)
        fitted, near = local_planes(d, inside, gaussian)
        dense = share[part] * (near > _LEAST_NEIGHBOURS)
        total[part] += dense * fitted
        weight[part] += dense
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(weight > 0.5, MM_PER_M * weight / total, np.nan)


# --- relief -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """Variance of the camera's noise, from measured minus smoothed depth on smooth surfaces.

    Attributes:
        at: (N,) middle of each class: infrared in counts, or depth in mm.
        variance_mm2: (N,) variance of measured minus smoothed depth; empty with too few pixels.
    """

    at: Array
    variance_mm2: Array

    def variance(self, frame: DepthFrame) -> Array:
        """Compute the (H, W) noise variance of a frame, mm^2; infinite without measurements."""
        if self.at.size == 0:
            return np.full(frame.measured_mm.shape, np.inf)
        driver = np.maximum(_driver(frame), _CLASSES[0])
        return np.asarray(np.interp(np.log(driver), np.log(self.at), self.variance_mm2))


def measure_noise_floor(frames: Sequence[DepthFrame], sigma_px: float) -> NoiseFloor:
    """Measure the noise of the smoothest surfaces over infrared (or over depth without infrared).

    All frames or none have infrared. ``sigma_px``: standard deviation of the window, px.
    """
    variances, drivers = [], []
    for frame in frames:
        label, smooth = smooth_surfaces(frame.measured_mm, sigma_px)
        inner = _far_from_rims(label)
        variances.append(_local_variance(frame.measured_mm - smooth, label >= 0, sigma_px)[inner])
        drivers.append(_driver(frame)[inner])
    variance, driver = np.concatenate(variances), np.concatenate(drivers)
    place = np.digitize(driver, _CLASSES)
    at, floor = [], []
    for k in range(1, len(_CLASSES)):
        chosen = variance[place == k]
        if chosen.size >= _LEAST_CLASS_PX:
            at.append(np.sqrt(_CLASSES[k - 1] * _CLASSES[k]))
            floor.append(np.quantile(chosen, _SMOOTHEST))
    return NoiseFloor(np.array(at), np.array(floor))


def keep_relief(
    depth_mm: NDArray[np.float32],
    smooth_mm: Array,
    label: Labels,
    variance_mm2: Array,
    sigma_px: float,
) -> Array:
    """Restore in smoothed depth the relief that exceeds the noise: cloth, hair, print.

    The noise floor is measured in the real frames. If real noise were rendered as relief, a
    simulated sensor with too little noise would seem realistic.

    Args:
        depth_mm: (H, W) measured depth, mm.
        smooth_mm: (H, W) smoothed depth, mm, NaN where unknown.
        label: (H, W) number of the surface of each pixel; -1 = none.
        variance_mm2: (H, W) variance of the camera's noise, mm^2.
        sigma_px: standard deviation of the Gaussian window, px.

    Returns:
        (H, W) mm: smoothed depth plus (variance - noise) / variance of the difference between
        measured and smoothed depth.
    """
    difference = depth_mm - smooth_mm
    variance = _local_variance(difference, label >= 0, sigma_px)
    share = np.clip(1.0 - _RELIEF_OVER_NOISE * variance_mm2 / np.maximum(variance, 1e-9), 0.0, 1.0)
    return np.asarray(smooth_mm + np.where(_far_from_rims(label), share * difference, 0.0))


def _driver(frame: DepthFrame) -> Array:
    """Return the quantity that noise depends on: (H, W) infrared, or depth without infrared."""
    source = frame.measured_mm if frame.infrared is None else frame.infrared
    return np.nan_to_num(source.astype(np.float64))


def _far_from_rims(label: Labels) -> Mask:
    """Mark the (H, W) pixels whose window lies on one surface."""
    window = np.ones((2 * _RELIEF_RIM_PX + 1, 2 * _RELIEF_RIM_PX + 1), np.uint8)
    image = label.astype(np.float32)  # a frame has fewer surfaces than 2^24
    return np.asarray((cv2.erode(image, window) == cv2.dilate(image, window)) & (label >= 0))


def _local_variance(difference_mm: Array, known: Mask, sigma_px: float) -> Array:
    """Compute the (H, W) variance of known pixels within a Gaussian window."""
    filled = np.where(known, difference_mm, 0.0)
    images = np.dstack([known.astype(np.float64), filled, filled * filled])
    blurred = cv2.GaussianBlur(images, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT)
    mean, square = np.moveaxis(blurred[..., 1:] / np.maximum(blurred[..., :1], 1e-6), -1, 0)
    return np.asarray(np.maximum(square - mean * mean, 0.0))


# --- gaps ---------------------------------------------------------------------------------------


def _fill_rows(z: Array, label: Labels, light_from: Labels, widest_hole_px: int) -> None:
    """Fill the gaps of each row with the surfaces at their ends, in place (all (H, W))."""
    for row in zip(z, label, light_from, strict=True):
        known = np.flatnonzero(np.isfinite(row[0]))
        ends = np.concatenate([[-1], known, [len(row[0])]])
        for k in np.flatnonzero(np.diff(ends) > 1) if known.size else ():
            _fill_gap(*row, int(ends[k]), int(ends[k + 1]), widest_hole_px)


def _fill_gap(
    z: Array, label: Labels, light_from: Labels, a: int, b: int, widest_hole_px: int
) -> None:
    """Fill the pixels between columns a and b of a row; -1 and the width mean the image border."""
    width = len(z)
    if a < 0 or b >= width:  # a gap at the image border: the surface continues to it
        chosen, end = (slice(0, b), b) if a < 0 else (slice(a + 1, width), a)
        parts = [(chosen, end)] if b - a - 1 <= _WIDEST_BAND_PX else []
    elif b - a - 1 > _WIDEST_GAP_PX:
        parts = []
    else:
        near_left = z[a] < z[b]
        near, far = (a, b) if near_left else (b, a)
        if z[far] - z[near] <= _APART * FITTED_STEP.limit_mm(z[near]):
            if b - a - 1 <= widest_hole_px:
                share = (np.arange(a + 1, b) - a) / (b - a)
                z[a + 1 : b] = 1.0 / ((1 - share) / z[a] + share / z[b])
                label[a + 1 : b] = label[a]
            return
        rim = min(_RIM_PX, b - a - 1)
        fronts = slice(a + 1, a + 1 + rim) if near_left else slice(b - rim, b)
        backs = slice(a + 1 + rim, b) if near_left else slice(a + 1, b - rim)
        parts = [(fronts, near), (backs, far)]
    for chosen, end in parts:
        z[chosen], label[chosen], light_from[chosen] = z[end], label[end], light_from[end]


def _behind_rows(front: Array, index: Labels) -> tuple[Array, Labels]:
    """Extend far surfaces behind near surfaces; return (H, W) depth, mm, and source pixels."""
    out, place = np.full(front.shape, np.nan), np.zeros(front.shape, np.int64)
    width = front.shape[1]
    with np.errstate(invalid="ignore"):
        change = np.diff(front, axis=1)
        limit = _APART * FITTED_STEP.limit_mm(np.minimum(front[:, 1:], front[:, :-1]))
        rows, columns = np.nonzero(np.abs(change) > limit)
    for row, column in zip(rows, columns, strict=True):
        z = front[row]
        leftwards = z[column] < z[column + 1]
        near, far, way = (column, column + 1, -1) if leftwards else (column + 1, column, 1)
        span = np.arange(near, np.clip(near + way * _BEHIND_PX, -1, width), way)
        with np.errstate(invalid="ignore"):
            open_from = np.flatnonzero(~(z[span] < z[far] - 1.0))
        span = span[: open_from[0]] if open_from.size else span
        span = span[~(out[row, span] <= z[far])]  # NaN: no surface was extended to this pixel yet
        # The two meshes overlap by a pixel.
        out[row, span], place[row, span] = z[far], index[row, far]
        out[row, far], place[row, far] = z[far], index[row, far]
    return out, place
