"""One person: body, reflectivity, expressions, and the frames of each sequence.

Sources of the reflectivity are in ``glsim.faces.procedural.subject``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats
from glsim.core.products import product
from glsim.core.seeds import rng_for
from glsim.faces.action_units import shape_weights
from glsim.faces.meshes.face_fit import ORIGIN_BEHIND_NOSE_MM
from glsim.faces.people.identity import BodyIdentity, sample_identity
from glsim.faces.people.model import REGIONS, BodyModel
from glsim.faces.people.posture import BodyShape, Posture, movement, sample_posture
from glsim.faces.procedural import subject as heads

_PALE: Final = 0.03  # skin varies by this share over the body (blood, sun); chosen, not measured

#: Action that closes an eye -> landmarks of the upper lid in the order of x, and of the lower lid.
_LIDS: Final = {"eyeBlinkRight": ((37, 38), (41, 40)), "eyeBlinkLeft": ((43, 44), (47, 46))}
#: Overlap of closed lids, mm, so that no gap shows. Chosen as for the procedural heads.
_OVERLAP_MM: Final = 0.25


class BodySubject:
    """One person, determined by seed and name; frames also depend on sequence and time."""

    def __init__(self, model: BodyModel, seed: int, name: str) -> None:
        self._model, self._seed, self.name = model, seed, name
        self.identity: BodyIdentity = sample_identity(seed, name)
        self.rest_mm, self._joints = model.body(self.identity.weights)
        self.albedo = sample_albedo(seed, name, model.regions)
        self._shape = _body_shape(model, self.rest_mm, self._joints)
        self.stance = lru_cache(maxsize=8)(self._stance)

    def frame(
        self, sequence: str, framing: str, time_s: float, expression: Mapping[str, float]
    ) -> Floats:
        """Compute the vertices (V, 3) float32 of a frame in canonical axes, mm.

        ``framing``: see ``People``. ``expression``: action unit -> intensity.
        """
        model = self._model
        posture, origin = self.stance(sequence, framing)
        rest = self.rest_mm.copy()
        add_expression(model, rest, expression)
        turns = dict(posture.turns)
        further = movement(self._seed, self.name, sequence, framing, time_s)
        for bone, turn in further.items():
            turns[bone] = product(turns[bone], turn) if bone in turns else turn
        moved = model.transforms(self._joints, turns)
        back = np.eye(3)
        if framing == "face":
            head = moved[model.bones.index("head")]
            tip = self.rest_mm[model.nose_tip].astype(np.float64)
            face = tip - np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM])
            back, origin = head[:, :3].T, product(head, np.append(face, 1.0))
        moved = product(moved.swapaxes(1, 2), back.T).swapaxes(1, 2)
        moved[:, :, 3] -= product(back, origin)
        return model.skinned(rest, moved)

    def _stance(self, sequence: str, framing: str) -> tuple[Posture, NDArray[np.float64]]:
        """Return the posture, and the point of the posed body that becomes the origin, (3,) mm."""
        posture = sample_posture(self._seed, self.name, sequence, self._shape)
        bones = self._model.bones
        moved = self._model.transforms(self._joints, posture.turns)
        joints = np.einsum("bij,bj->bi", moved[:, :, :3], self._joints) + moved[:, :, 3]
        if framing != "body":
            return posture, joints[bones.index("neck01")]
        posed = self._model.skinned(self.rest_mm, moved)
        middle = (posed.min(axis=0) + posed.max(axis=0)) / 2
        root = joints[bones.index("root")]
        return posture, np.array([root[0], middle[1], root[2]])


def sample_albedo(seed: int, subject: str, regions: NDArray[np.uint8]) -> Floats:
    """Draw a subject's reflectivity (V,) in [0, 1]; a pure function of its arguments."""
    rng = rng_for(seed, "people", "albedo", subject)
    skin, hair = (heads.clipped_normal(rng, *a) for a in (heads.SKIN_ALBEDO, heads.HAIR_ALBEDO))
    values = {name: skin * (1.0 + float(rng.normal(0.0, _PALE))) for name in REGIONS}
    values |= {"skin": skin, "nose": skin, "lids": skin, "neck": skin}
    values |= {"lips": heads.LIPS_TO_SKIN * skin, "scalp": heads.STUBBLE_TO_SKIN * skin}
    values |= {"brow": hair, **heads.FIXED_ALBEDO}
    table = np.array([values[name] for name in REGIONS], dtype=np.float32)
    return np.clip(table, 0.02, 0.95)[regions]


def add_expression(model: BodyModel, rest_mm: Floats, expression: Mapping[str, float]) -> None:
    """Add an expression (action unit -> intensity) to resting vertices (V, 3) mm, in place.

    At full strength, the lids of an eye meet and do not cross. The action of the data is scaled,
    since it closes the wide eyes of the base mesh: it would move the mean person's upper lid 4 mm
    below the lower lid. Lids close last, after all other actions on the eye.
    """
    weights = shape_weights(expression)
    model.actions.add(rest_mm, {n: w for n, w in weights.items() if n not in _LIDS})
    for action, (above, below) in _LIDS.items():
        if action not in weights:
            continue
        upper, lower = model.landmarks[[above, below]]
        points, offsets = model.actions.shape(action)
        way_mm = _heights(points, offsets, lower) - _heights(points, offsets, upper)
        open_mm = rest_mm[upper, 1] - rest_mm[lower, 1]
        share = np.clip((open_mm + _OVERLAP_MM) / way_mm, 0.0, 1.0)
        across = np.interp(rest_mm[points, 0], rest_mm[upper, 0], share)
        rest_mm[points] += ((weights[action] * across)[:, None] * offsets).astype(np.float32)


def _heights(
    points: NDArray[np.int32], offsets: Floats, vertices: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the height, mm, by which a shape raises each of some vertices."""
    return np.array([offsets[points == vertex, 1].sum() for vertex in vertices], np.float64)


def _body_shape(model: BodyModel, rest_mm: Floats, joints: NDArray[np.float64]) -> BodyShape:
    at = dict(zip(model.bones, joints, strict=True))
    trunk = rest_mm[model.regions == REGIONS.index("torso")]
    low, high = at["upperleg01.L"][1], at["upperarm01.L"][1] - 80.0
    band = trunk[(trunk[:, 1] > low) & (trunk[:, 1] < high)]
    middle = band[np.abs(band[:, 0]) < 80.0]
    chin = rest_mm[model.chin].astype(np.float64)
    return BodyShape(at, float(np.abs(band[:, 0]).max()), float(middle[:, 2].max()), chin)
