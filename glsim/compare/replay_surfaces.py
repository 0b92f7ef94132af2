"""The surfaces of one real frame without its noise: what a replay renders.

A frame is cut into surfaces where neighbouring depths jump. Each surface is smoothed on its own, by
a local plane in inverse depth under a Gaussian window. Gaps between a near and a far surface
(shadows, rims) are given to the far one, holes within a surface are closed, and the far surface is
continued behind the rim of the near one, so that pixels on the rim can mix both.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.geometry.camera import Intrinsics
from glsim.geometry.mesh import Mesh

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Largest difference of neighbours on one surface, mm and mm per m of distance: that of
#: ``glsim.measures.surfaces``; and, where noise is larger, times the local median difference.
_STEP_MM, _STEP_MM_PER_M, _STEP_NOISE = 8.0, 10.0, 8.0
#: Distances between which the median difference of neighbours is measured, mm; chosen.
_BINS_MM = np.geomspace(200.0, 8000.0, 17)
#: Least pixels of a surface; smaller ones are flying pixels and speckle. Chosen.
_LEAST_PX = 40
#: Step between slabs of the smoothing, share of the depth (a plane is fitted to three of them), and
#: least share of a window that has depth in its slab. Chosen: a rail of 5 px has half.
_SLAB, _LEAST_NEIGHBOURS = 0.06, 0.2
#: The rim of a near surface is its last measured pixel plus this many; chosen: half of the gap of
#: two to three pixels that all cameras leave on the side without shadow.
_RIM_PX = 1
#: Widest gap that is given to a surface, px: a head at 0.6 m before a wall at 3 m has 24.
_WIDEST_GAP_PX = 80
#: Widest empty band at the image's border onto which a surface goes on, px: a D435's at 0.4 m.
_WIDEST_BAND_PX = 60
#: How far a far surface goes on behind a near one, px: more than any camera here sees around it.
_BEHIND_PX = 60


@dataclass(frozen=True, eq=False)
class ReplaySurfaces:
    """Surfaces of one frame.

    Attributes:
        front_mm: (H, W) smoothed depth of what the camera sees, mm; NaN where nothing is known.
        behind_mm: (H, W) depth of what goes on behind the rim of a nearer surface; NaN elsewhere.
        label: (H, W) number of the surface of ``front_mm``; -1 = none.
        light_from: (H, W) flat index of the pixel whose reflectivity a pixel has: its own, or, in
            gaps, that of the surface which the gap was given to.

    """

    front_mm: Array
    behind_mm: Array
    label: Labels
    light_from: Labels


def find_surfaces(
    depth_mm: NDArray[np.float32], smooth_px: float, widest_hole_px: int
) -> ReplaySurfaces:
    """Find the surfaces of a depth map.

    Args:
        depth_mm: (H, W) mm, NaN where there is no depth.
        smooth_px: standard deviation of the Gaussian window of the smoothing, px.
        widest_hole_px: holes within a surface are closed up to this width.

    """
    label = _connected(depth_mm)
    smooth = _smoothed(depth_mm, label, smooth_px)
    label = np.where(np.isfinite(smooth), label, -1)
    front, filled, source = _filled_rows(smooth, label, widest_hole_px)
    front, filled, source = _filled_columns(front, filled, source, widest_hole_px)
    return ReplaySurfaces(front, _behind(front), filled, source)


def mesh_of(surfaces: ReplaySurfaces, camera: Intrinsics, albedo: Array) -> Mesh:
    """Return the triangles of all surfaces, in the camera frame, mm.

    Args:
        camera: of the depth map.
        albedo: (H, W) of each pixel, relative to a white wall.

    """
    rays = camera.rays().astype(np.float64)
    light = albedo.ravel()[surfaces.light_from.ravel()].reshape(albedo.shape)
    vertices, faces, lights = [], [], []
    count = 0
    for depth, label in ((surfaces.front_mm, surfaces.label), (surfaces.behind_mm, None)):
        used, corners = _triangles(depth, label)
        if len(corners) == 0:
            continue
        points = np.concatenate([rays * depth[..., None], depth[..., None]], axis=-1)
        vertices.append(points.reshape(-1, 3)[used])
        lights.append(light.ravel()[used])
        faces.append(corners + count)
        count += len(used)
    return Mesh(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(lights).astype(np.float32),
    )


def _limit_mm(depth_mm: Array, differences: Array, at: Array) -> Array:
    """Return the largest difference of neighbours on one surface, for each depth."""
    near = np.isfinite(differences)
    place = np.digitize(at[near], _BINS_MM)
    medians = np.full(len(_BINS_MM) + 1, np.nan)
    for k in np.unique(place):
        chosen = differences[near][place == k]
        if chosen.size >= 100:
            medians[k] = np.median(chosen)
    known = np.isfinite(medians)
    centres = np.concatenate([_BINS_MM[:1], np.sqrt(_BINS_MM[1:] * _BINS_MM[:-1]), _BINS_MM[-1:]])
    rule = _STEP_MM + _STEP_MM_PER_M * depth_mm / 1000.0
    if not known.any():
        return rule
    noise = np.interp(depth_mm, centres[known], medians[known])
    return np.asarray(np.maximum(rule, _STEP_NOISE * noise))


def _connected(depth_mm: NDArray[np.float32]) -> Labels:
    """Number the connected surfaces; -1 where there is no depth or a surface is tiny."""
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
    size = np.bincount(label)
    label = np.where((size[label] >= _LEAST_PX) & np.isfinite(z.ravel()), label, -1)
    return np.asarray(label.reshape(z.shape), np.int64)


def _smoothed(depth_mm: NDArray[np.float32], label: Labels, sigma_px: float) -> Array:
    """Return the surfaces by local planes in inverse depth, in which real planes are planes.

    A plane is fitted to the pixels of a slab of depths alone, so that a near and a far surface that
    touch elsewhere are not mixed. Pixels with few neighbours in their slab are flying: NaN.
    """
    known = label >= 0
    level = np.where(known, np.log(np.where(known, depth_mm, 1.0)) / _SLAB, -10.0)
    lower = np.floor(level)
    above = level - lower  # share of the slab above, for a smooth change from slab to slab
    total, weight = np.zeros(depth_mm.shape), np.zeros(depth_mm.shape)
    pad = int(np.ceil(3 * sigma_px))
    for centre in (
        range(int(lower[known].min()), int(lower[known].max()) + 2) if known.any() else ()
    ):
        share = np.where(lower == centre, 1.0 - above, np.where(lower == centre - 1, above, 0.0))
        mask = np.abs(level - centre) < 1.5
        if not share.any():
            continue
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        inside = mask[part]
        d = np.where(inside, 1000.0 / np.where(inside, depth_mm[part], 1.0), 0.0)
        fitted, near = _local_planes(np.pad(d, pad), np.pad(inside, pad) * 1.0, sigma_px)
        inner = np.s_[pad : pad + inside.shape[0], pad : pad + inside.shape[1]]
        dense = share[part] * (near[inner] > _LEAST_NEIGHBOURS)
        total[part] += dense * fitted[inner]
        weight[part] += dense
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(weight > 0.5, 1000.0 * weight / total, np.nan)


def _local_planes(values: Array, mask: Array, sigma_px: float) -> tuple[Array, Array]:
    """Fit a plane around every pixel, weighted by a Gaussian and a mask.

    Returns:
        Its value at the pixel, and the share of the window that the mask has.
    """
    y, x = np.mgrid[: values.shape[0], : values.shape[1]].astype(np.float64)
    known = mask > 0
    offset = float(values[known].mean())
    d = np.where(known, values - offset, 0.0)

    def blur(image: Array) -> Array:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT))

    weight = np.maximum(blur(mask), 1e-12)
    mean_x, mean_y, mean = (blur(mask * v) / weight for v in (x, y, d))
    xx = blur(mask * x * x) / weight - mean_x**2 + 0.05
    yy = blur(mask * y * y) / weight - mean_y**2 + 0.05
    xy = blur(mask * x * y) / weight - mean_x * mean_y
    xd = blur(mask * x * d) / weight - mean_x * mean
    yd = blur(mask * y * d) / weight - mean_y * mean
    scale = np.maximum(xx * yy - xy * xy, 1e-9)
    slope_x, slope_y = (xd * yy - yd * xy) / scale, (yd * xx - xd * xy) / scale
    value = offset + mean + slope_x * (x - mean_x) + slope_y * (y - mean_y)
    return np.asarray(value), weight


def _apart(near: float, far: float) -> bool:
    """Say whether two depths at the ends of a gap belong to different surfaces."""
    return far - near > 3.0 * (_STEP_MM + _STEP_MM_PER_M * near / 1000.0)


def _filled_rows(z: Array, label: Labels, widest_hole_px: int) -> tuple[Array, Labels, Labels]:
    """Give the gaps of each row to surfaces: depth, labels and where the light comes from."""
    out, own = z.copy(), label.copy()
    source = np.arange(z.size, dtype=np.int64).reshape(z.shape)
    width = z.shape[1]
    for row in range(z.shape[0]):
        known = np.flatnonzero(np.isfinite(z[row]))
        if known.size == 0:
            continue
        for a, b in _gaps(known, width):
            _fill_gap((out[row], own[row], source[row]), z[row], a, b, widest_hole_px)
    return out, own, source


def _filled_columns(
    z: Array, label: Labels, source: Labels, widest_hole_px: int
) -> tuple[Array, Labels, Labels]:
    """Close what the rows left open, column by column."""
    turned = _filled_rows(np.ascontiguousarray(z.T), np.ascontiguousarray(label.T), widest_hole_px)
    out, own, place = turned
    height = z.shape[0]  # indices count along the columns of the turned image
    rows, columns = place.T % height, place.T // height
    return np.ascontiguousarray(out.T), np.ascontiguousarray(own.T), source[rows, columns]


def _gaps(known: NDArray[np.int64], width: int) -> list[tuple[int, int]]:
    """Return (last known pixel before, first after) of each gap; -1 and width at the borders."""
    ends = np.concatenate([[-1], known, [width]])
    wide = np.flatnonzero(np.diff(ends) > 1)
    return [(int(ends[k]), int(ends[k + 1])) for k in wide]


def _fill_gap(
    row: tuple[Array, Labels, Labels], z: Array, a: int, b: int, widest_hole_px: int
) -> None:
    """Fill the pixels between a and b of a row (depth, label, source of the light) in place."""
    out, label, source = row
    width = len(z)
    if b - a - 1 > _WIDEST_GAP_PX:
        return
    if a < 0 or b >= width:  # the band at the border: the surface goes on
        if b - a - 1 > _WIDEST_BAND_PX:
            return
        inner = b if a < 0 else a
        chosen = slice(0, b) if a < 0 else slice(a + 1, width)
        out[chosen], label[chosen], source[chosen] = z[inner], label[inner], source[inner]
        return
    near_left = z[a] < z[b]
    near, far = (a, b) if near_left else (b, a)
    if not _apart(z[near], z[far]):
        if b - a - 1 > widest_hole_px:
            return
        share = (np.arange(a + 1, b) - a) / (b - a)
        out[a + 1 : b] = 1.0 / ((1 - share) / z[a] + share / z[b])
        label[a + 1 : b] = label[a]
        return
    rim = min(_RIM_PX, b - a - 1)
    fronts = slice(a + 1, a + 1 + rim) if near_left else slice(b - rim, b)
    backs = slice(a + 1 + rim, b) if near_left else slice(a + 1, b - rim)
    for chosen, end in ((fronts, near), (backs, far)):
        out[chosen], label[chosen], source[chosen] = z[end], label[end], source[end]


def _behind(front: Array) -> Array:
    """Continue far surfaces behind the rims of near ones, along rows, then along columns."""
    along_rows = _behind_rows(front)
    along_columns = _behind_rows(np.ascontiguousarray(front.T)).T
    return np.where(np.isfinite(along_rows), along_rows, along_columns)


def _behind_rows(front: Array) -> Array:
    out = np.full(front.shape, np.nan)
    width = front.shape[1]
    with np.errstate(invalid="ignore"):
        change = np.diff(front, axis=1)
        limit = 3.0 * (_STEP_MM + _STEP_MM_PER_M * np.minimum(front[:, 1:], front[:, :-1]) / 1000.0)
        rows, columns = np.nonzero(np.abs(change) > limit)
    for row, column in zip(rows, columns, strict=True):
        z = front[row]
        near, far, way = (column, column + 1, -1) if z[column] < z[column + 1] else (
            column + 1, column, 1)  # fmt: skip
        depth = z[far]
        end = near + way * _BEHIND_PX
        span = np.arange(near, np.clip(end, -1, width), way)
        with np.errstate(invalid="ignore"):
            open_from = np.flatnonzero(~(z[span] < depth - 1.0))
        span = span[: open_from[0]] if open_from.size else span
        held = out[row, span]
        out[row, span] = np.where(np.isfinite(held), np.minimum(held, depth), depth)
        out[row, far] = depth  # the two meshes overlap by a pixel
    return out


def _triangles(depth: Array, label: Labels | None) -> tuple[Labels, NDArray[np.int32]]:
    """Return the used pixels (flat indices) and the triangles between them, facing the camera."""
    height, width = depth.shape
    index = np.arange(height * width).reshape(height, width)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    corners = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    z = depth.ravel()[corners]
    low, high = z.min(axis=1), z.max(axis=1)
    kept = np.isfinite(low)
    with np.errstate(invalid="ignore"):
        joined = high - low <= _STEP_MM + _STEP_MM_PER_M * low / 1000.0
    if label is not None:
        of = label.ravel()[corners]
        joined |= (of[:, 0] == of[:, 1]) & (of[:, 1] == of[:, 2])
    used, faces = np.unique(corners[kept & joined], return_inverse=True)
    return used, faces.reshape(-1, 3).astype(np.int32)
