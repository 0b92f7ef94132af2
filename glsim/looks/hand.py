"""A hand at the face: a forearm of the body model, posed and laid against the skin."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from glsim.core.array_types import Mask, Reals, Triangles
from glsim.core.mesh import vertex_normals
from glsim.core.products import product, units
from glsim.core.seeds import keyed_rng
from glsim.faces.people.model import REGIONS, mean_body
from glsim.faces.people.posture import fingers
from glsim.looks.anatomy import Anatomy, beside_line
from glsim.looks.binding import Rooted
from glsim.looks.skin_grid import Anchors

#: How deep the skin gives way, and how near beside a point of the hand skin counts, mm; every
#: third point of both is tried, some 3 mm apart. Chosen.
_DEEP_MM, _NEAR_MM, _EVERY = 4.0, 5.0, 3
#: Gap between arm and sleeve, and bare part of the arm before the wrist, mm. Chosen.
_SLEEVE_MM, _BARE_MM = 7.0, 35.0


@lru_cache(maxsize=8)
def _forearm(curl_deg: float) -> tuple[Reals, Triangles, Mask]:
    """Pose the mean body's left hand: vertices (N, 3) mm, triangles, and the mask of the sleeve.

    Axes: along the arm, out of the palm, across; the origin is the base of the middle finger.
    """
    model = mean_body()
    rest, joints = model.body({})
    at = dict(zip(model.bones, joints, strict=True))
    points = model.skinned(rest, model.transforms(joints, fingers(at, "L", curl_deg)))
    arm = units(at["wrist.L"] - at["lowerarm01.L"])
    palm = np.cross(arm, at["finger5-1.L"] - at["finger2-1.L"])
    palm *= -np.sign(palm[1])  # the arm is spread, and its palm looks down
    limb = np.isin(model.regions, [REGIONS.index("arm"), REGIONS.index("hand")])
    limb &= product(points - at["lowerarm01.L"], arm) > -30
    corners = model.triangles[limb[model.triangles].all(axis=1)]
    used, inverse = np.unique(corners, return_inverse=True)
    faces = inverse.reshape(-1, 3).astype(np.int32)
    sleeve = product(points[used] - at["wrist.L"], arm) < -_BARE_MM
    cloth = points[used] + (_SLEEVE_MM * sleeve)[:, None] * vertex_normals(points[used], faces)
    return product(cloth - at["finger3-1.L"], _axes(arm, palm).T), faces, sleeve


def _axes(arm: Reals, palm: Reals) -> Reals:
    """Compute the axes of a hand, unit rows of (3, 3): along the arm, out of the palm, across."""
    arm = units(arm)
    palm = units(palm - (palm * arm).sum() * arm)
    return np.stack([arm, palm, np.cross(arm, palm)])


def make_hand(
    anatomy: Anatomy, pose: Mapping[str, Any], seed: int
) -> tuple[Rooted, Triangles, Mask]:
    """Lay a hand against a subject's resting head; ``pose``: a row of [hands] in styles.toml.

    Returns its binding to the skin that it touches first, its triangles, and the sleeve's mask.
    """
    rng, skin_mm = keyed_rng(seed, "hand"), anatomy.vertices_mm
    points, faces, sleeve = _forearm(pose["curl"])
    arm, palm = (rng.normal(way, 0.08) for way in (pose["arm"], pose["palm"]))
    mirror = np.array([rng.choice([1.0, -1.0]), 1.0, 1.0])
    away = product(points, _axes(arm, palm)) + rng.normal(pose["at"], 3.0)
    points, press = anatomy.mouth + mirror * anatomy.scale * away, units(mirror * pose["press"])
    above_chin = skin_mm[:, 1] > anatomy.mouth[1] - 55 * anatomy.scale
    skin = skin_mm[anatomy.outside & ~anatomy.is_in("ear") & above_chin][::_EVERY]
    bare = points[~sleeve][::_EVERY]
    gaps = -beside_line(bare, skin, -press, _NEAR_MM) - product(bare, press)
    points = points + (gaps.min() + _DEEP_MM) * press
    touch = bare[gaps.argmin()] + gaps.min() * press
    touched = int(np.linalg.norm(skin_mm - touch, axis=1).argmin())
    root = Anchors(np.full((1, 3), touched), np.array([[1, 0, 0]], np.float32))
    binding = Rooted(root, np.zeros(len(points), np.int64), points - skin_mm[touched])
    return binding, np.ascontiguousarray(faces[:, :: int(mirror[0])]), sleeve
