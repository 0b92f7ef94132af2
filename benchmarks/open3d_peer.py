"""Clean depth and shadow by Open3D's ray casting, on one core."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from benchmarks.contender import SHADOW_BIAS_M
from glsim.camera import SensorRig
from glsim.frame import Rect
from glsim.mesh import Mesh
from glsim.pose import pose_matrix


class Open3DRenderer:
    """A new scene (and BVH) for each mesh; camera rays are made once."""

    def __init__(self, rig: SensorRig, step: Callable[[str], AbstractContextManager[None]]) -> None:
        self._step = step
        self._emitter = np.asarray(rig.emitters[0].position_m, dtype=np.float32)
        self._view = pose_matrix({"distance_mm": 900.0})
        rays = rig.rays()
        directions = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)
        self._rays = np.concatenate([np.zeros_like(directions), directions], axis=-1)

    def __call__(self, mesh: Mesh, window: Rect) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        with self._step("clean depth"):
            points = mesh.vertices_mm @ self._view[:3, :3].T + self._view[:3, 3]
            scene = o3d.t.geometry.RaycastingScene(nthreads=1)
            scene.add_triangles(
                o3d.core.Tensor(np.ascontiguousarray(points, dtype=np.float32)),
                o3d.core.Tensor(mesh.faces.astype(np.uint32)),
            )
            rays = np.ascontiguousarray(self._rays[window.slices])
            depth = scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy()
            depth[~np.isfinite(depth)] = 0.0  # the rays' z is 1: t is depth along the axis
        with self._step("shadow"):
            hit = depth > 0
            at = rays[hit][:, 3:] * depth[hit][:, None]
            # From the emitter to the point, so that t = 1 is the point itself.
            towards = at - self._emitter
            starts = np.broadcast_to(self._emitter, at.shape)
            shadow_rays = np.concatenate([starts, towards], axis=1).astype(np.float32)
            first = scene.cast_rays(o3d.core.Tensor(shadow_rays), nthreads=1)["t_hit"].numpy()
            lit = np.zeros_like(depth)
            lit[hit] = (1.0 - first) * np.linalg.norm(towards, axis=1) < SHADOW_BIAS_M
        return depth, lit
