"""The source ``procedural``: parametric heads that perform FACS sequences, without data files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.faces.face_source import Face, FaceKey, FaceSource, Topology
from glsim.faces.generated import GeneratedFaces, GeneratorSettings
from glsim.faces.neck import Neck, head_share
from glsim.faces.procedural.model import REGIONS, head_model
from glsim.faces.procedural.parameters import sample_identity
from glsim.faces.procedural.subject import HeadSubject, make_subject


class ProceduralSettings(GeneratorSettings):
    """Generated heads without data files: 60 identity parameters, 24 FACS action units."""

    def open(self, seed: int) -> FaceSource:
        """Open the generator."""
        return ProceduralFaces(seed, *self.timing)


class ProceduralFaces(GeneratedFaces[HeadSubject]):
    """A source of parametric heads "p0000", "p0001", ... (see ``glsim.faces.procedural``)."""

    name = "procedural"
    letter = "p"

    @property
    def topology(self) -> Topology:
        """Triangles, regions and landmarks, shared by all heads."""
        model = head_model()
        return Topology(model.triangles, model.regions, REGIONS, model.landmarks)

    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's neutral vertices (V, 3) float32 mm, and the triangles."""
        return self.person(subject).neutral.astype(np.float32), head_model().triangles

    def make_person(self, name: str) -> HeadSubject:
        """Make the head of a subject name."""
        return make_subject(sample_identity(self.seed, name), self.seed, name)

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        """Yield one face per key, in order."""
        model = head_model()
        for key in keys:
            person, expression = self.person(key.subject), self.expression(key)
            mesh = Mesh(person.frame(expression), model.triangles, person.albedo, model.occluder)
            yield Face(key, mesh, expression, neck=Neck(head_share))
