"""A subject: body, albedo, and frames of its sequences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.albedo import draw_albedo
from glsim.faces.people.identity import BodyIdentity, sample_identity
from glsim.faces.people.lids import add_expression
from glsim.faces.people.model import BodyModel
from glsim.faces.people.movement import movement
from glsim.faces.people.posture import BodyShape, Posture, draw_posture
from glsim.faces.people.regions import REGIONS
from glsim.geometry.products import product
from glsim.meshio.alignment import ORIGIN_BEHIND_NOSE_MM

_Floats = NDArray[np.float32]

FRAMINGS: Final = ("face", "bust", "body")


@dataclass(frozen=True, eq=False)
class Stance:
    """A posture in the frame of the mesh.

    Args:
        rotation, origin_mm: (3, 3) and (3,): the canonical frame in that of the posed body.
    """

    posture: Posture
    rotation: NDArray[np.float64]
    origin_mm: NDArray[np.float64]


class BodySubject:
    """One person. Functions of (seed, name, sequence, time) only."""

    def __init__(self, model: BodyModel, seed: int, name: str) -> None:
        self._model, self._seed, self.name = model, seed, name
        self.identity: BodyIdentity = sample_identity(seed, name)
        self.rest_mm, self._joints = model.body(self.identity.weights)
        self.albedo = draw_albedo(seed, name, model.regions)
        self._shape = _body_shape(model, self.rest_mm, self._joints)
        self.stance = lru_cache(maxsize=8)(self._stance)

    def frame(
        self, sequence: str, framing: str, time_s: float, expression: Mapping[str, float]
    ) -> _Floats:
        """Return (V, 3) float32 vertices in the canonical frame, mm.

        Args:
            framing: of FRAMINGS, what lies at the origin.
            expression: action unit -> intensity.
        """
        model, stance = self._model, self.stance(sequence, framing)
        rest = self.rest_mm.copy()
        add_expression(model, rest, expression)
        turns = dict(stance.posture.turns)
        further = movement(self._seed, self.name, sequence, framing, time_s)
        for bone, turn in further.items():
            turns[bone] = product(turns[bone], turn) if bone in turns else turn
        moved = model.skeleton.transforms(self._joints, turns)
        back = stance.rotation.T
        if framing == "face":
            back = moved[model.skeleton.names.index("head"), :, :3].T
            origin = product(
                moved[model.skeleton.names.index("head")], np.append(self._face(), 1.0)
            )
        else:
            origin = stance.origin_mm
        moved = product(moved.swapaxes(1, 2), back.T).swapaxes(1, 2)
        moved[:, :, 3] -= product(back, origin)
        return model.skinned(rest, moved)

    def _face(self) -> NDArray[np.float64]:
        """The centre of the face at rest, (3,) mm."""
        tip = self.rest_mm[self._model.landmarks["nose_tip"]].astype(np.float64)
        return np.asarray(tip - np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM]))

    def _stance(self, sequence: str, framing: str) -> Stance:
        posture = draw_posture(self._seed, self.name, sequence, self._shape)
        skeleton = self._model.skeleton
        moved = skeleton.transforms(self._joints, posture.turns)
        place = np.einsum("bij,bj->bi", moved[:, :, :3], self._joints) + moved[:, :, 3]
        neck = place[skeleton.names.index("neck01")]
        if framing != "body":
            return Stance(posture, np.eye(3), neck)
        posed = self._model.skinned(self.rest_mm, moved)
        middle = (posed.min(axis=0) + posed.max(axis=0)) / 2
        root = place[skeleton.names.index("root")]
        return Stance(posture, np.eye(3), np.array([root[0], middle[1], root[2]]))


def _body_shape(model: BodyModel, rest_mm: _Floats, joints: NDArray[np.float64]) -> BodyShape:
    names = model.skeleton.names
    at = dict(zip(names, joints, strict=True))
    trunk = rest_mm[model.regions == REGIONS.index("torso")]
    low, high = at["upperleg01.L"][1], at["upperarm01.L"][1] - 80.0
    band = trunk[(trunk[:, 1] > low) & (trunk[:, 1] < high)]
    chin = rest_mm[model.landmarks["chin"]].astype(np.float64)
    middle = band[np.abs(band[:, 0]) < 80.0]
    return BodyShape(at, float(np.abs(band[:, 0]).max()), float(middle[:, 2].max()), chin)
