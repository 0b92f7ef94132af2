"""Build the scenery of one frame from the settings [scene]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glsim.geometry.mesh import Mesh
from glsim.geometry.pose import pose_matrix
from glsim.settings.distribution import DrawKeys
from glsim.settings.schema import SceneSettings

#: Half the side of the square wall, mm; it fills any view up to 12 m.
_WALL_MM = 20_000.0

_WALL_FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


@dataclass(frozen=True, eq=False)
class Prop:
    """A mesh of the scenery.

    mesh: millimetres. view: (4, 4) float32, the mesh's millimetres to camera metres.
    region: name in the layer of regions; "" for none.
    """

    mesh: Mesh
    view: NDArray[np.float32]
    region: str = ""


@dataclass(frozen=True, eq=False)
class Scenery:
    """The scenery of one frame. drawn: "scene.name" -> drawn value, for the manifest."""

    props: tuple[Prop, ...] = ()
    drawn: Mapping[str, float] = field(default_factory=dict)


def build_scenery(settings: SceneSettings, seeds: DrawKeys) -> Scenery:
    """Return the scenery of a frame; a pure function of the arguments."""
    if settings.wall_mm is None:
        return Scenery()
    wall_mm = settings.wall_mm.draw(seeds, "scene.wall_mm")
    wall = Prop(_wall(settings.wall_albedo), pose_matrix({"distance_mm": wall_mm}))
    return Scenery((wall,), {"scene.wall_mm": wall_mm})


def _wall(albedo: float) -> Mesh:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
    return Mesh(corners * _WALL_MM, _WALL_FACES, np.full(4, albedo, dtype=np.float32))
