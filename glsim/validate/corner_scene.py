"""The scene of the two real frames of a D435, in plain shapes: a corner of a room.

Distances are read off the real frames: a wall at 1.75 m, a board that recedes on the right from
0.35 to 1.6 m, a bag that hangs in the corner, a dark backpack, a box on the floor, and a frame on
the board at its near end.
"""

from __future__ import annotations

import numpy as np

from glsim.geometry.mesh import Mesh
from glsim.validate.scenes import merge_meshes, quad, rectangle

#: Albedos: painted walls and boards; cloth; black plastic and cloth. Chosen.
_WALL, _CLOTH, _BLACK = 0.8, 0.4, 0.06
#: Focal length times baseline of the device that made the frames, px mm.
_FOCAL_BASELINE_PX_MM = 626_823 / 32


def room_corner(focal_baseline_px_mm: float = _FOCAL_BASELINE_PX_MM) -> Mesh:
    """Build the scene in the camera frame, mm.

    Args:
        focal_baseline_px_mm: of the camera that looks at it; the scene grows with it, so that all
            cameras see the same disparities: 11 px on the wall, up to 98 px on the board.
    """
    scale = np.float32(focal_baseline_px_mm / _FOCAL_BASELINE_PX_MM)
    wall = rectangle((-3000.0, 260.0), (-1500.0, 1500.0), 1750.0, _WALL)
    deeper = rectangle((-100.0, 900.0), (-1500.0, 1500.0), 2300.0, _WALL)
    side = quad(
        [(260.0, 1500.0, 1600.0), (290.0, 1500.0, 200.0), (290.0, -1500.0, 200.0),
         (260.0, -1500.0, 1600.0)], _WALL,
    )  # fmt: skip
    bag = rectangle((120.0, 215.0), (-420.0, -60.0), 1450.0, _CLOTH)
    backpack = rectangle((-20.0, 190.0), (60.0, 460.0), 1250.0, _BLACK)
    box = rectangle((-330.0, 120.0), (300.0, 1200.0), 1380.0, _CLOTH)
    frame = quad(
        [(245.0, 40.0, 480.0), (250.0, 40.0, 400.0), (250.0, -170.0, 400.0),
         (245.0, -170.0, 480.0)], _BLACK,
    )  # fmt: skip
    mesh = merge_meshes(wall, deeper, side, bag, backpack, box, frame)
    return Mesh(mesh.vertices_mm * scale, mesh.faces, mesh.albedo)
