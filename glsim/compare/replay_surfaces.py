"""The surfaces of one real frame without its noise: what a replay renders.

A frame is cut into surfaces where neighbouring depths jump (tiny ones are flying pixels), smoothed
(``replay_smoothing``) down to the relief that is rougher than noise (``replay_relief``), and its
gaps are given to the surfaces (``replay_gaps``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.compare.replay_gaps import continue_behind, fill_columns, fill_rows
from glsim.compare.replay_relief import keep_relief
from glsim.compare.replay_smoothing import smooth_depth
from glsim.geometry.camera import Intrinsics
from glsim.geometry.depth_map import grid_triangles
from glsim.geometry.mesh import Mesh
from glsim.measures.surfaces import step_limit_mm

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Where noise is large, neighbours on one surface differ by up to this many times the median
#: difference at their distance; chosen.
_STEP_NOISE = 8.0
#: Distances between which the median difference of neighbours is measured, mm; chosen.
_BINS_MM = np.geomspace(200.0, 8000.0, 17)
#: Least pixels of a surface; smaller ones are flying pixels and speckle. Chosen.
_LEAST_PX = 40


@dataclass(frozen=True, eq=False)
class ReplaySurfaces:
    """Surfaces of one frame.

    Attributes:
        front_mm: (H, W) smoothed depth of what the camera sees, mm; NaN where nothing is known.
        behind_mm: (H, W) depth of what goes on behind the rim of a nearer surface; NaN elsewhere.
        label: (H, W) number of the surface of ``front_mm``; -1 = none.
        light_from: (H, W) flat index of the pixel whose reflectivity a pixel has: its own, or, in
            gaps, that of the surface which the gap was given to.
        behind_from: (H, W) the same of ``behind_mm``.

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
    """Find the surfaces of a depth map.

    Args:
        depth_mm: (H, W) mm, NaN where there is no depth.
        smooth_px: standard deviation of the Gaussian window of the smoothing, px.
        widest_hole_px: holes within a surface are closed up to this width.
        noise_mm2: (H, W) variance of the camera's noise, mm^2: relief that is rougher is kept.
            None: none is.

    """
    label, smooth = smooth_surfaces(depth_mm, smooth_px)
    if noise_mm2 is not None:
        smooth = keep_relief(depth_mm, smooth, label, noise_mm2, smooth_px)
    front, filled, source = fill_rows(smooth, label, widest_hole_px)
    front, filled, source = fill_columns(front, filled, source, widest_hole_px)
    behind, behind_source = continue_behind(front)
    return ReplaySurfaces(front, behind, filled, source, source.ravel()[behind_source])


def smooth_surfaces(depth_mm: NDArray[np.float32], smooth_px: float) -> tuple[Labels, Array]:
    """Number the surfaces of a depth map and smooth each.

    Returns:
        (H, W) number of the surface, -1 = none, and (H, W) smoothed depth, mm, NaN there.

    """
    label = _connected(depth_mm)
    smooth = smooth_depth(depth_mm, label >= 0, smooth_px)
    return np.where(np.isfinite(smooth), label, -1), smooth


def mesh_of(surfaces: ReplaySurfaces, camera: Intrinsics, albedo: Array) -> Mesh:
    """Join the pixels of all surfaces into one mesh, in the camera frame, mm.

    Raises MeshError if there is no surface.

    Args:
        camera: of the depth map.
        albedo: (H, W) of each pixel, relative to a white wall.

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
    rule = step_limit_mm(depth_mm)
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


def _triangles(depth: Array, label: Labels | None) -> tuple[Labels, NDArray[np.int32]]:
    """Return the used pixels (flat indices) and the triangles between them, facing the camera."""
    corners = grid_triangles(depth.shape)
    z = depth.ravel()[corners]
    low, high = z.min(axis=1), z.max(axis=1)
    kept = np.isfinite(low)
    with np.errstate(invalid="ignore"):
        joined = high - low <= step_limit_mm(low)
    if label is not None:
        of = label.ravel()[corners]
        joined |= (of[:, 0] == of[:, 1]) & (of[:, 1] == of[:, 2])
    used, faces = np.unique(corners[kept & joined], return_inverse=True)
    return used, faces.reshape(-1, 3).astype(np.int32)
