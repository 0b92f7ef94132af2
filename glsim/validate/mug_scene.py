"""The scene of the real frame of an Azure Kinect, in plain shapes: a mug before walls.

Distances are read off the real frame: a mug at 0.26 m, its handle at 0.3 m, a wall that recedes on
the left, 0.38 m beside the camera, and one behind at 1.55 m.
"""

from __future__ import annotations

import numpy as np

from glsim.geometry.mesh import Mesh
from glsim.validate.scenes import merge_meshes, quad

#: Albedos that give the real frame's counts: 6,000 to 12,000 on the mug, 500 to 700 on the walls.
_MUG_ALBEDO, _HANDLE_ALBEDO, _WALL_ALBEDO, _SIDE_ALBEDO = 0.5, 0.55, 0.8, 1.0


def mug_before_walls() -> Mesh:
    """Build the scene in the camera frame, mm."""
    mug = _cylinder((-71.0, 303.0), 41.0, (-18.0, 88.0), _MUG_ALBEDO)
    handle = _cylinder((2.0, 306.0), 6.0, (5.0, 75.0), _HANDLE_ALBEDO)
    left = quad(
        [(-378, 900, 500), (-378, 900, 1550), (-378, -900, 1550), (-378, -900, 500)], _SIDE_ALBEDO
    )
    back = quad(
        [(-378, 900, 1550), (1500, 900, 1550), (1500, -900, 1550), (-378, -900, 1550)], _WALL_ALBEDO
    )
    return merge_meshes(mug, handle, left, back)


def _cylinder(
    axis_mm: tuple[float, float], radius_mm: float, rows_mm: tuple[float, float], albedo: float
) -> Mesh:
    """Build the mantle of an upright cylinder.

    Args:
        axis_mm: (x, z) of its axis.
        radius_mm: of the mantle.
        rows_mm: (top, bottom), y.
        albedo: of it.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 97)
    x = axis_mm[0] + radius_mm * np.sin(turn)
    z = axis_mm[1] - radius_mm * np.cos(turn)
    count = len(turn)
    upper = np.column_stack([x, np.full(count, rows_mm[0]), z])
    lower = np.column_stack([x, np.full(count, rows_mm[1]), z])
    first = np.arange(count - 1)
    ring = np.column_stack([count + first, count + first + 1, first + 1, first])
    faces = np.concatenate([ring[:, [0, 1, 2]], ring[:, [0, 2, 3]]])
    return Mesh(
        np.concatenate([upper, lower]).astype(np.float32),
        faces.astype(np.int32),
        np.full(2 * count, albedo, np.float32),
    )
