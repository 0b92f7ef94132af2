"""Geometry of a depth map: its normals, its surface as a mesh, its shadows.

The module defines two kinds of normals. ``normals`` gives one for every pixel, from differences
within one surface, one-sided at its edges. ``central_normals`` uses the plain central differences
of the metrics, for pixels that the caller has found to lie within one surface.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.mesh import Mesh

_T = TypeVar("_T", bound=np.generic)

#: In evaluation and training an edge of a clean map is an invalid pixel, or a jump of more than
#: JUMP_MM between two neighbours: one surface would have to be seen at 85 degrees, at 0.9 m and the
#: Kinect V2's 2.5 mm per pixel. The edge band reaches BAND_PX rows and columns from an edge; the
#: other valid pixels are the interior.
JUMP_MM, BAND_PX = 30.0, 3

#: Depth difference between neighbouring pixels that separates surfaces, relative to the depth: a
#: surface seen at 85 degrees changes by 3 % per pixel at the Kinect V2's 0.16 degrees per pixel.
_EDGE_SHARE = 0.03

#: A pixel hides a point from the emitter if it is nearer than the line of light by more than this,
#: metres. The shader's bias, with its slope term, is of the same size.
_SHADOW_BIAS_M = 0.003


def normals(depth_m: NDArray[np.float32], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """Compute (H, W, 3) float32 unit normals towards the camera; (0, 0, -1) where depth is 0.

    Differences are taken to neighbours on the same surface only: central if both neighbours are,
    one-sided if one is.

    Args:
        depth_m: (H, W) metres, 0 = no depth.
        rays: (H, W, 2) x/z, y/z.
    """
    points = np.concatenate([rays * depth_m[..., None], depth_m[..., None]], axis=-1)
    along_x = _difference(points, depth_m, axis=1)
    along_y = _difference(points, depth_m, axis=0)
    normal = np.cross(along_y, along_x)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    flat = np.array([0.0, 0.0, -1.0], dtype=np.float32)
    unit = np.where(length > 0, normal / np.where(length > 0, length, 1), flat)
    unit *= np.where((unit * points).sum(axis=-1, keepdims=True) > 0, -1, 1)
    unit[depth_m <= 0] = flat
    return unit.astype(np.float32)


def central_normals(
    depth: NDArray[np.floating], rays: NDArray[np.floating], at: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Compute (N, 3) float64 normals, not of unit length, at the N pixels of ``at`` in row order.

    The cross product of the central differences of the back-projected points.

    Args:
        depth: (H, W), any unit.
        rays: (H, W, 2), x/z and y/z of each pixel.
        at: (H, W), False on the image's border.
    """
    row, column = np.nonzero(at)

    def point(dy: int, dx: int) -> tuple[NDArray[np.float64], ...]:
        z = depth[row + dy, column + dx].astype(np.float64)
        ray = rays[row + dy, column + dx].astype(np.float64)
        return ray[:, 0] * z, ray[:, 1] * z, z

    ax, ay, az = (b - a for a, b in zip(point(0, -1), point(0, 1), strict=True))
    bx, by, bz = (b - a for a, b in zip(point(-1, 0), point(1, 0), strict=True))
    return np.stack([by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax], axis=-1)


def _difference(
    points: NDArray[np.float32], depth_m: NDArray[np.float32], axis: int
) -> NDArray[np.float32]:
    """Compute the (H, W, 3) mean step to neighbours on the same surface, or else a unit axis."""
    n = depth_m.shape[axis]
    first, last = (np.take(points, range(a, b), axis) for a, b in ((0, n - 1), (1, n)))
    z0, z1 = (np.take(depth_m, range(a, b), axis) for a, b in ((0, n - 1), (1, n)))
    same = (np.minimum(z0, z1) > 0) & (np.abs(z1 - z0) <= _EDGE_SHARE * np.minimum(z0, z1))
    step = np.where(same[..., None], last - first, np.float32(0))
    front: list[tuple[int, int]] = [(0, 0)] * 3
    back: list[tuple[int, int]] = [(0, 0)] * 3
    front[axis], back[axis] = (1, 0), (0, 1)
    total = np.pad(step, front) + np.pad(step, back)
    count = np.pad(same, front[:2]).astype(np.float32) + np.pad(same, back[:2])
    alone = np.zeros(3, dtype=np.float32)
    alone[1 - axis] = 1.0
    mean: NDArray[np.float32] = np.where(
        count[..., None] > 0, total / np.maximum(count, 1)[..., None], alone
    )
    return mean


def grid_triangles(shape: tuple[int, ...]) -> NDArray[np.int32]:
    """Return the triangles between neighbouring pixels of an image, (T, 3) flat pixel indices.

    They are counter-clockwise seen from the camera.

    Args:
        shape: (H, W) of the image.
    """
    height, width = shape
    index = np.arange(height * width, dtype=np.int32).reshape(height, width)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)


def surface(
    depth_m: NDArray[np.float32], rig: SensorRig, steepest_deg: float | None = None
) -> Mesh | None:
    """Make a mesh of the triangles between pixel centres, cut at edges; None without triangles.

    Vertices are in millimetres, in camera axes with y and z negated: ``pose_matrix({})`` moves them
    back to where they were seen. Seen from elsewhere, triangles across a jump in depth are fins
    between two surfaces; by default steps of up to 9 % of the depth are bridged, so that a head
    casts a shadow without gaps.

    Args:
        depth_m: (H, W) metres.
        steepest_deg: cut what the camera would see at a larger angle of incidence.
    """
    if steepest_deg is None:
        largest_share = 3 * _EDGE_SHARE
    else:  # the step in depth from a pixel to the next, over the depth
        largest_share = math.tan(math.radians(steepest_deg)) / rig.intrinsics.fx
    triangles = grid_triangles(depth_m.shape)
    z = depth_m.ravel()[triangles]
    low, high = z.min(axis=1), z.max(axis=1)
    kept = triangles[(low > 0) & (high - low <= largest_share * low)]
    if len(kept) == 0:
        return None
    rays = rig.rays()
    points = np.concatenate([rays * depth_m[..., None], depth_m[..., None]], axis=-1)
    used, faces = np.unique(kept, return_inverse=True)
    vertices = points.reshape(-1, 3)[used] * np.array([1000.0, -1000.0, -1000.0])
    return Mesh(vertices.astype(np.float32), faces.reshape(-1, 3).astype(np.int32))


def lit_by_marching(depth_m: NDArray[np.float32], rig: SensorRig) -> NDArray[np.float32]:
    """Compute the (H, W) share of the emitters' light that reaches each pixel, by ray marching.

    Reference for tests of the shadow shader; its substitute without GL. The line from a point to
    an emitter is a line in the image; a pixel on it that is nearer than the line hides the point.
    """
    if not rig.emitters:
        return np.ones_like(depth_m)
    image, rays = rig.intrinsics, rig.rays().astype(np.float64)
    points = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1) * depth_m[..., None]
    lit = np.zeros(depth_m.shape, dtype=np.float32)
    valid = depth_m > 0
    if not valid.any():
        return lit
    nearest, farthest = float(depth_m[valid].min()), float(depth_m[valid].max())
    sources = [
        (point, share / len(rig.emitters))
        for emitter in rig.emitters
        for point, share in emitter.shared_points_m()
    ]
    for source, weight in sources:
        hidden = np.zeros(depth_m.shape, dtype=bool)
        towards = source - points
        for share in _march_shares(image, nearest, farthest, source):
            at = points + share * towards
            depth_there = _sample(depth_m, image, at)
            hidden |= (depth_there > 0) & (depth_there < at[..., 2] - _SHADOW_BIAS_M)
        lit += np.float32(weight) * (valid & ~hidden)
    return lit


def _march_shares(
    image: Intrinsics, nearest_m: float, farthest_m: float, emitter_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (S,) places along the line to the emitter, 0 to 1, at most half a pixel apart.

    In the image, the point at share s of a line from depth z to an emitter in the image plane lies
    f b / z * t beside its start, with t = s / (1 - s). No surface that casts a shadow is nearer
    than ``nearest_m``, so t ends at z / nearest - 1.
    """
    shift_px = image.fx * float(np.hypot(*emitter_m[:2])) / nearest_m
    step, end = 0.5 / max(shift_px, 0.5), farthest_m / nearest_m - 1.0
    t = np.arange(step, end + step, step)
    return t / (1 + t)


def _sample(
    depth_m: NDArray[np.float32], image: Intrinsics, at: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return the depth at the pixels to which points (..., 3) project; 0 outside the image."""
    z = np.where(at[..., 2] > 0, at[..., 2], np.inf)
    column = np.floor(image.fx * at[..., 0] / z + image.cx).astype(np.int64)
    row = np.floor(image.fy * at[..., 1] / z + image.cy).astype(np.int64)
    height, width = depth_m.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    sampled: NDArray[np.float32] = np.where(
        inside, depth_m[row.clip(0, height - 1), column.clip(0, width - 1)], np.float32(0)
    )
    return sampled


def around(image: NDArray[_T], radius: int, at: NDArray[np.bool_], outside: float) -> NDArray[_T]:
    """Cut the square neighbourhoods, (N, (2 radius + 1)^2), of the N pixels of ``at``.

    outside: the value beyond the image.
    """
    padded = np.pad(image, radius, constant_values=outside)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1,) * 2)
    return windows[at].reshape(int(np.count_nonzero(at)), (2 * radius + 1) ** 2)
