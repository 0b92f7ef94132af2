"""Surfaces in a depth map: edges, interiors, normals, meshes and shadows.

Functions of ``Maps`` take and return arrays of NumPy or tensors of PyTorch, (..., H, W).

The module defines two kinds of normals. ``normals`` computes one for every pixel from the
differences to neighbours on the same surface; at the surface's edge the difference is one-sided.
``central_normals`` uses central differences, at pixels that the caller knows to be inside one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Floats, Mask, Reals, Triangles
from glsim.core.arrays import of
from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.mesh import Mesh

_T = TypeVar("_T", bound=np.generic)
#: An array of NumPy or a tensor of PyTorch.
Maps = Any


class SurfaceStep(NamedTuple):
    """The largest depth difference of neighbouring pixels on one surface: mm + share * depth."""

    mm: float
    share: float

    def limit_mm(self, depth_mm: Maps) -> Maps:
        """Compute the difference, mm, that is allowed at each depth, mm."""
        return self.mm + self.share * depth_mm


# Limits between surfaces. They differ because noisier maps need wider limits, and because scores
# and trained networks depend on the values that they were made with.
#
# limit          compares                                    source
# -------------  ------------------------------------------  ------------------------------------
# EDGE_SHARE     neighbours without noise: normals, meshes,  derived: a slope of 85 degrees at a
#                relative to the depth                       Kinect V2's 0.16 degrees a pixel
# JUMP_MM        neighbours of clean maps: scores, training; derived: the same at 0.9 m, 2.5 mm a
#                of noisy ones: filters, noise estimates     pixel; above every sensor's noise
# FITTED_STEP    neighbours of real frames: quadrics,        derived: 75 degrees at 2.7 mm a pixel
#                replays                                     and 1 m, and 4 sigma of two pixels'
#                                                            difference at a noise of 1.5 mm
# MEASURED_STEP  neighbours of measured maps: silhouettes,   derived: the last pixel of a head's
#                the composite "measured"                    rim at 0.9 m is 21 mm behind
# FLYING_MM      a depth and the truth, or the surface that  chosen: above any noise, less than
#                a network sees; pixels 4 px apart (heads)   from a head to a wall
EDGE_SHARE = 0.03
JUMP_MM = 30.0
FITTED_STEP = SurfaceStep(8.0, 0.01)
MEASURED_STEP = SurfaceStep(15.0, 0.015)
FLYING_MM = 50.0

#: The edge band of scores and training: pixels within BAND_PX rows and columns of an invalid pixel
#: or a jump. The other valid pixels are the interior.
BAND_PX = 3

#: Pairs of slices along axis -2 and axis -1: all pixels but the last, and their next neighbours.
NEIGHBOURS = ((np.s_[..., :-1, :], np.s_[..., 1:, :]), (np.s_[..., :-1], np.s_[..., 1:]))

#: A pixel blocks a ray to the emitter if it is nearer than the ray by more than this, metres. The
#: shader's bias, with its slope term, is about as large. The value was chosen, not measured.
_SHADOW_BIAS_M = 0.003


def jumps(depth_mm: Maps) -> Maps:
    """Mark pixels with a row or column neighbour that is over JUMP_MM nearer or farther."""
    marked = depth_mm < 0
    for near, far in NEIGHBOURS:
        first, second = depth_mm[near], depth_mm[far]
        jump = (abs(second - first) > JUMP_MM) & (first > 0) & (second > 0)
        marked[near] |= jump
        marked[far] |= jump
    return marked


def interior(valid: Maps, jumping: Maps) -> Maps:
    """Mark valid pixels more than BAND_PX from holes and ``jumps``; the border is no edge."""
    # Jumping pixels are part of the edge band themselves: hence BAND_PX - 1.
    return valid & ~dilated(~valid, BAND_PX) & ~dilated(jumping, BAND_PX - 1)


def dilated(mask: Maps, radius_px: int) -> Maps:
    """Dilate a mask by a square of half side ``radius_px``."""
    for axis in (-2, -1):
        reached = 0
        while reached < radius_px:
            step = min(reached + 1, radius_px - reached)  # the pixels between are marked already
            wider = (mask | mask).swapaxes(axis, -1)  # a copy
            narrow = mask.swapaxes(axis, -1)
            wider[..., :-step] |= narrow[..., step:]
            wider[..., step:] |= narrow[..., :-step]
            mask, reached = wider.swapaxes(axis, -1), reached + step
    return mask


def normals(depth_m: Maps, rays: Maps) -> Maps:
    """Compute (..., H, W, 3) unit normals towards the camera; (0, 0, -1) where depth is 0.

    A difference is central if both neighbours lie on the pixel's surface, one-sided if one does.

    Args:
        depth_m: (..., H, W) float32 metres, 0 = no depth.
        rays: (..., H, W, 2) float32 x/z, y/z.
    """
    xp = of(depth_m)
    points = [rays[..., 0] * depth_m, rays[..., 1] * depth_m, depth_m]
    (ax, ay, az), (bx, by, bz) = (_surface_steps(points, axis) for axis in (-1, -2))
    normal = [by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax]
    length = xp.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    outwards = sum(n * point for n, point in zip(normal, points, strict=True))
    known = (depth_m > 0) & (length > 0)
    length = xp.where(outwards > 0, -1.0, 1.0) * xp.where(known, length, 1.0)
    flat = (0.0, 0.0, -1.0)
    return xp.stack([xp.where(known, n / length, f) for n, f in zip(normal, flat, strict=True)], -1)


def _surface_steps(points: Sequence[Maps], axis: int) -> list[Maps]:
    """Compute the mean step to the neighbours on the same surface; without any, a unit vector.

    ``points`` and the steps are x, y and z, each (..., H, W). Axis -1 runs along the rows.
    """
    z = points[2]
    xp, last = of(z), z.shape[axis] - 1
    place = xp.range(0, last + 1, z)
    place = place if axis == -1 else place[:, None]
    ahead = [xp.roll(part, -1, axis) for part in points]
    least = xp.minimum(z, ahead[2])
    same = (least > 0) & (abs(ahead[2] - z) <= EDGE_SHARE * least) & (place < last)
    steps = [xp.where(same, b - a, 0.0) for a, b in zip(points, ahead, strict=True)]
    count = xp.floats(same) + xp.floats(xp.roll(same, 1, axis))
    alone = (1.0, 0.0, 0.0) if axis == -1 else (0.0, 1.0, 0.0)
    return [
        xp.where(count > 0, (step + xp.roll(step, 1, axis)) / xp.maximum(count, 1.0), axle)
        for step, axle in zip(steps, alone, strict=True)
    ]


def central_normals(depth: Reals, rays: Reals, at: Mask) -> Array:
    """Compute (N, 3) float64 normals, not of unit length, at the N pixels of ``at`` in row order.

    They are the cross products of the central differences of the back-projected points. ``depth``
    is (H, W) in any unit, ``rays`` (H, W, 2) x/z and y/z. ``at`` is False on the image's border.
    """
    row, column = np.nonzero(at)

    def point(dy: int, dx: int) -> tuple[Array, ...]:
        z = depth[row + dy, column + dx].astype(np.float64)
        ray = rays[row + dy, column + dx].astype(np.float64)
        return ray[:, 0] * z, ray[:, 1] * z, z

    ax, ay, az = (b - a for a, b in zip(point(0, -1), point(0, 1), strict=True))
    bx, by, bz = (b - a for a, b in zip(point(-1, 0), point(1, 0), strict=True))
    return np.stack([by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax], axis=-1)


def grid_triangles(shape: tuple[int, ...]) -> Triangles:
    """Return an (H, W) image's triangles, (T, 3) indices, counter-clockwise for the camera."""
    height, width = shape
    index = np.arange(height * width, dtype=np.int32).reshape(height, width)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)


def surface(depth_m: Floats, rig: SensorRig, steepest_deg: float | None = None) -> Mesh | None:
    """Make a mesh of the triangles between pixel centres, cut at edges; None without triangles.

    Vertices are in millimetres, in camera axes with y and z negated: ``pose_matrix({})`` moves them
    back to the measured points. Across a jump in depth the triangles are no surface. With
    ``steepest_deg``, triangles are cut that the camera sees at a greater angle. By default steps of
    up to 9 % of the depth are bridged, and so a head casts a shadow without gaps.
    """
    if steepest_deg is None:
        largest_share = 3 * EDGE_SHARE
    else:  # the depth step from a pixel to the next, divided by the depth
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


def lit_by_marching(depth_m: Floats, rig: SensorRig) -> Floats:
    """Compute the (H, W) share of the emitters' light that reaches each pixel, by ray marching.

    It is the reference for tests of the shadow shader, and replaces it without OpenGL. The ray from
    a point to an emitter is a line in the image; a nearer pixel on it puts the point in shadow.
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


def lit_share(
    depth_m: Maps,
    focal_px: Any,
    lights: Sequence[tuple[int, int, Any, float]],
    bias_m: Any = _SHADOW_BIAS_M,
) -> Maps:
    """Compute the (B, H, W) share of light that reaches each pixel from lights beside the camera.

    The ray from a surface point to such a light follows a row or a column of the image, and along
    it 1 / depth grows by the same step per pixel. A pixel is in shadow if a pixel further along
    lies nearer than the ray: objects count as infinitely thick.

    Args:
        depth_m: (B, H, W) metres, 0 = no depth.
        focal_px: focal length along the row or column, a number or (B, 1, 1).
        lights: for each light the first two results of ``beside_camera``, its distance from the
            camera in metres (a number or (B, 1, 1)), and its share of the light.
        bias_m: smallest distance from a surface to a ray behind it at which it blocks the ray.
    """
    xp = of(depth_m)
    seen = depth_m > 0
    inverse = 1.0 / xp.where(seen, depth_m, 1.0)
    lit = xp.zeros_like(depth_m)
    for axis, way, baseline_m, share in lights:
        last = depth_m.shape[axis] - 1
        place = xp.floats(xp.range(0, last + 1, depth_m))
        place = place if axis == -1 else place[:, None]
        height = inverse - way * place / xp.maximum(focal_px * baseline_m, 1e-3)
        reaching: Any = xp.where(seen, height, -1e6)
        reaching = reaching.flip(axis) if way > 0 else reaching
        highest = xp.roll(reaching.cummax(axis).values, 1, axis)
        highest = highest.flip(axis) if way > 0 else highest
        hidden = (highest - height > bias_m * inverse * inverse) & (place != max(last * way, 0))
        lit = lit + share * xp.floats(~hidden)
    return xp.where(seen, lit, 0.0)


def _march_shares(
    image: Intrinsics, nearest_m: float, farthest_m: float, emitter_m: Array
) -> Array:
    """Return (S,) positions on the ray to the emitter, 0 to 1, at most half a pixel apart."""
    # Take a point at share s of the ray from depth z to an emitter in the image plane. In the image
    # it lies f b / z * t from the start, with t = s / (1 - s). No surface that casts a shadow is
    # nearer than ``nearest_m``: t ends at z / nearest - 1.
    shift_px = image.fx * float(np.hypot(*emitter_m[:2])) / nearest_m
    step, end = 0.5 / max(shift_px, 0.5), farthest_m / nearest_m - 1.0
    t = np.arange(step, end + step, step)
    return t / (1 + t)


def _sample(depth_m: Floats, image: Intrinsics, at: Array) -> Floats:
    """Return the depth at the pixels to which points (..., 3) project; 0 outside the image."""
    z = np.where(at[..., 2] > 0, at[..., 2], np.inf)
    column = np.floor(image.fx * at[..., 0] / z + image.cx).astype(np.int64)
    row = np.floor(image.fy * at[..., 1] / z + image.cy).astype(np.int64)
    height, width = depth_m.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    seen = depth_m[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.where(inside, seen, np.float32(0))


def around(image: NDArray[_T], radius: int, at: Mask, outside: float) -> NDArray[_T]:
    """Cut (N, (2 radius + 1)^2) windows around the N pixels of ``at``; ``outside`` is padding."""
    padded = np.pad(image, radius, constant_values=outside)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1,) * 2)
    return windows[at].reshape(int(np.count_nonzero(at)), (2 * radius + 1) ** 2)
