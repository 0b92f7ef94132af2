"""The surface of a depth map for views from another place than the camera's."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import SensorRig
from glsim.core.depth_map import surface
from glsim.core.mesh import Mesh
from glsim.denoise.interface import Depth

#: Triangles that the sensor saw at a larger angle are cut, degrees. Chosen by eye: at 88 cheeks and
#: ears are bridged by fins, at 80 the noise of kinect-v2-paper tears holes into foreheads.
STEEPEST_DEG: Final = 83.0
#: The same for triangles at the rim of a surface, from which they stand out like teeth: no noise
#: can tear a hole there. Chosen by eye.
STEEPEST_AT_RIM_DEG: Final = 70.0
#: A tooth is two triangles long: the halves of one pixel's square.
_RIM_PASSES: Final = 2


def cut_surface(depth_mm: Depth, rig: SensorRig) -> Mesh | None:
    """Return the surface of an (H, W) map in mm, cut at jumps; None without any.

    Vertices as ``glsim.core.depth_map.surface`` returns them.
    """
    mesh = surface(depth_mm / np.float32(1000), rig, STEEPEST_DEG)
    if mesh is None:
        return None
    z_mm = -mesh.vertices_mm[:, 2][mesh.faces]
    rise = (z_mm.max(axis=1) - z_mm.min(axis=1)) / z_mm.min(axis=1) * rig.intrinsics.fx
    steep = rise > math.tan(math.radians(STEEPEST_AT_RIM_DEG))
    kept = np.ones(len(mesh.faces), np.bool_)
    for _ in range(_RIM_PASSES):
        kept[kept] = ~(steep[kept] & _at_rim(mesh.faces[kept], len(mesh.vertices_mm)))
    if not kept.any():
        return None
    used, faces = np.unique(mesh.faces[kept], return_inverse=True)
    return Mesh(mesh.vertices_mm[used], faces.reshape(-1, 3).astype(np.int32))


def _at_rim(faces: NDArray[np.int32], vertices: int) -> NDArray[np.bool_]:
    """Return which of the (N, 3) triangles have a side that no other triangle has."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
    codes: NDArray[Any] = sides[..., 0].astype(np.int64) * vertices + sides[..., 1]
    _, place, count = np.unique(codes, return_inverse=True, return_counts=True)
    alone: NDArray[np.bool_] = (count[place.reshape(codes.shape)] == 1).any(axis=1)
    return alone
