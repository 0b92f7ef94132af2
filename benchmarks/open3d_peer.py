"""Open3D as a peer: clean depth and shadow by ray casting, on one core."""

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from glsim.core.camera import SensorRig

#: Least distance, m, by which an occluder must be in front of a point to shadow it: the shader's
#: order of magnitude.
_SHADOW_BIAS_M = 0.003


class Renderer:
    """Casts rays into a new scene (and BVH) for each mesh; the camera's rays are made once."""

    def __init__(self, rig: SensorRig) -> None:
        self._emitter = np.asarray(rig.emitters[0].position_m, dtype=np.float32)
        rays = rig.rays()
        directions = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)
        self._rays = np.concatenate([np.zeros_like(directions), directions], axis=-1)

    def __call__(
        self, points_m: NDArray[np.float32], faces: NDArray[np.int32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return clean depth, m, and the lit share, both (H, W) float32.

        Args:
            points_m, faces: vertices (n, 3) in the camera's frame, and triangles (m, 3).
        """
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(
            o3d.core.Tensor.from_numpy(np.ascontiguousarray(points_m, dtype=np.float32)),
            o3d.core.Tensor.from_numpy(faces.astype(np.uint32)),
        )
        depth = _distances(scene, self._rays)
        depth[~np.isfinite(depth)] = 0.0  # the rays' z is 1: t is depth along the axis
        hit = depth > 0
        at = self._rays[hit][:, 3:] * depth[hit][:, None]
        # From the emitter to the point, so that t = 1 is the point itself.
        towards = at - self._emitter
        starts = np.broadcast_to(self._emitter, at.shape)
        first = _distances(scene, np.concatenate([starts, towards], axis=1).astype(np.float32))
        lit = np.zeros_like(depth)
        lit[hit] = (1.0 - first) * np.linalg.norm(towards, axis=1) < _SHADOW_BIAS_M
        return depth, lit


def _distances(
    scene: o3d.t.geometry.RaycastingScene, rays: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the distance to the first hit in lengths of each ray's direction; inf for none."""
    hits = scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
    distances: NDArray[np.float32] = hits["t_hit"].numpy()
    return distances
