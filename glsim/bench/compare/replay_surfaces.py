"""Surfaces of one real frame, without its noise, for a replay.

A frame is cut into surfaces where neighbouring depths jump; tiny surfaces are flying pixels. Local
planes in 1/z smooth each surface; relief that exceeds the camera's noise stays. A gap between a
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
#: A band keeps no relief where its energy is below this multiple of the noise. Chosen: the energy
#: of noise alone exceeds it in 3 to 8 % of the pixels.
_RELIEF_OVER_NOISE = 2.0
#: Relief is removed up to this distance from a rim, px (flying pixels). Chosen, not measured.
_RELIEF_RIM_PX = 2
#: Depths that belong to no surface are joined where a Gaussian window of this width, px, that is as
#: far from all surfaces, has at least this share of them, and they differ by less than this share
#: of their depth. Chosen, not measured.
_SCATTERED_PX, _LEAST_SCATTERED, _ONE_WALL = 4.0, 0.05, 0.05


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
    depth_mm: NDArray[np.float32], scales_px: Sequence[float], widest_hole_px: int,
    noise_mm2: Array | None = None,
) -> ReplaySurfaces:  # fmt: skip
    """Find the surfaces of a depth map and smooth them.

    Args:
        depth_mm: (H, W) mm, NaN where there is no depth.
        scales_px: standard deviations of the Gaussian windows of the smoothing, finest first.
        widest_hole_px: widest hole within a surface to close.
        noise_mm2: (bands, H, W) variance of noise, mm^2; relief above it stays. None: no relief.
    """
    smooth = smooth_surfaces(depth_mm, scales_px)
    label, front = smooth.label, smooth.widest_mm
    if noise_mm2 is not None:
        front = smooth.with_relief(noise_mm2)
    _add_scattered(depth_mm, label, front)
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


@dataclass(frozen=True, eq=False)
class SmoothSurfaces:
    """The surfaces of one frame, and what successive smoothings take from them.

    Attributes:
        label: (H, W) number of each pixel's surface; -1 = none.
        widest_mm: (H, W) depth after the widest smoothing, mm; NaN without a surface.
        bands_mm: (bands, H, W) what each smoothing takes, mm, finest first.
        energy: (bands, H, W) mean square of each band within its window, mm^2.
    """

    label: Labels
    widest_mm: Array
    bands_mm: Array
    energy: Array

    def with_relief(self, noise_mm2: Array) -> Array:
        """Give back the relief that exceeds the noise in its band: noses, cloth, hair, print.

        If real noise were rendered as relief, a sensor with too little noise would seem realistic.
        Returns (H, W) mm: the widest smoothing plus 1 - (2 noise / energy)^2 of each band, from the
        (bands, H, W) variance of the camera's noise, mm^2.
        """
        with np.errstate(over="ignore"):
            excess = _RELIEF_OVER_NOISE * noise_mm2 / np.maximum(self.energy, 1e-9)
            share = np.clip(1.0 - excess**2, 0.0, 1.0)
        relief = np.where(far_from_rims(self.label), (share * self.bands_mm).sum(axis=0), 0.0)
        return np.asarray(self.widest_mm + relief)


def smooth_surfaces(depth_mm: NDArray[np.float32], scales_px: Sequence[float]) -> SmoothSurfaces:
    """Number the surfaces of a depth map and smooth each surface by windows, finest first."""
    label = _connected(depth_mm)
    last, bands, energy = np.where(label >= 0, depth_mm.astype(np.float64), np.nan), [], []
    for scale in scales_px:
        smooth = _smoothed(depth_mm, label >= 0, scale)
        band = np.nan_to_num(last - smooth)
        bands.append(band)
        known = np.isfinite(smooth).astype(np.float64)
        images = np.dstack([known, band * band])
        blurred = cv2.GaussianBlur(images, (0, 0), scale, borderType=cv2.BORDER_CONSTANT)
        energy.append(blurred[..., 1] / np.maximum(blurred[..., 0], 1e-6))
        last = smooth
    kept = np.where(np.isfinite(last), label, -1)
    return SmoothSurfaces(kept, last, np.stack(bands), np.stack(energy))


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
        fitted, _, near = local_planes(d, inside, gaussian)
        dense = share[part] * (near > _LEAST_NEIGHBOURS)
        total[part] += dense * fitted
        weight[part] += dense
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(weight > 0.5, MM_PER_M * weight / total, np.nan)


def far_from_rims(label: Labels) -> Mask:
    """Mark the (H, W) pixels whose window lies on one surface."""
    window = np.ones((2 * _RELIEF_RIM_PX + 1, 2 * _RELIEF_RIM_PX + 1), np.uint8)
    image = label.astype(np.float32)  # a frame has fewer surfaces than 2^24
    return np.asarray((cv2.erode(image, window) == cv2.dilate(image, window)) & (label >= 0))


def _add_scattered(depth_mm: NDArray[np.float32], label: Labels, front_mm: Array) -> None:
    """Join scattered depths without a surface, as on far dark walls, to surfaces, in place."""
    alone = np.isfinite(depth_mm) & (label < 0)
    near = cv2.distanceTransform((label < 0).astype(np.uint8), cv2.DIST_L2, 3)
    alone &= near > _SCATTERED_PX
    inverse = np.where(alone, MM_PER_M / np.where(alone, depth_mm, 1.0), 0.0)
    images = np.dstack([alone.astype(np.float64), inverse, inverse**2])
    count, first, second = np.moveaxis(cv2.GaussianBlur(images, (0, 0), _SCATTERED_PX), -1, 0)
    mean, square = first / np.maximum(count, 1e-9), second / np.maximum(count, 1e-9)
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))
    found = (label < 0) & (near > _SCATTERED_PX) & (count > _LEAST_SCATTERED)
    found &= spread < _ONE_WALL * mean
    front_mm[found] = MM_PER_M / mean[found]
    label[found] = label.max(initial=0) + 1


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
