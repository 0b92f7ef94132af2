"""The procedural source: endless subjects "p0000", "p0001", ... that perform FACS sequences."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.neck import Neck, head_share
from glsim.faces.procedural.model import REGIONS, head_model
from glsim.faces.procedural.parameters import sample_identity
from glsim.faces.procedural.subject import HeadSubject, make_subject
from glsim.faces.sequences import performance_expression, performance_frames
from glsim.geometry.mesh import Mesh

CACHED_SUBJECTS = 4

_NECK = Neck(head_share)


class ProceduralFaces:
    """A FaceSource of parametric heads, without data files.

    Args:
        seed: determines every identity and performance.
        frames_per_sequence: length of a sequence.
        frames_per_second: see ``performance_frames``.
    """

    name = "procedural"

    def __init__(
        self,
        seed: int = 0,
        frames_per_sequence: int = 30,
        frames_per_second: float | None = None,
    ) -> None:
        if frames_per_sequence < 1:
            raise ConfigError(f"frames_per_sequence is {frames_per_sequence}: give 1 or more")
        self.seed = seed
        self.frames_per_sequence = frames_per_sequence
        self.frames_per_second = frames_per_second
        self._cache: OrderedDict[str, HeadSubject] = OrderedDict()

    def __getstate__(self) -> dict[str, object]:
        """Return the settings only; each worker builds its own subjects."""
        return {**self.__dict__, "_cache": OrderedDict()}

    @property
    def regions(self) -> NDArray[np.uint8]:
        """(V,) uint8 indices into REGIONS, the same for all subjects."""
        return head_model().regions

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions that ``regions`` refers to."""
        return REGIONS

    @property
    def landmarks(self) -> NDArray[np.int64]:
        """(68,) vertices of the landmarks in the order of Multi-PIE, the same for all subjects."""
        return head_model().landmarks

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` subjects. Raises ConfigError for None: they are endless."""
        if count is None:
            raise ConfigError("procedural faces never end: give a number of subjects")
        return [f"p{number:04d}" for number in range(count)]

    def frames(self, subject: str, count: int | None) -> Sequence[FaceKey]:
        """Return the first ``count`` frames of a subject, sequence by sequence."""
        return performance_frames(
            self.seed, subject, count, self.frames_per_sequence, self.frames_per_second
        )

    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's (V, 3) float32 vertices without expression, mm, and (F, 3) faces."""
        points = self._subject(subject).neutral.astype(np.float32)
        return points, head_model().triangles

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Yield one face per key, in order."""
        model = head_model()
        for key in keys:
            person = self._subject(key.subject)
            expression = performance_expression(self.seed, key)
            mesh = Mesh(person.frame(expression), model.triangles, person.albedo, model.occluder)
            yield Face(key, mesh, expression, neck=_NECK)

    def _subject(self, name: str) -> HeadSubject:
        """Return a subject from the cache, or make it."""
        if name not in self._cache:
            if not (name.startswith("p") and name[1:].isdigit()):
                raise ConfigError(f"no procedural subject {name!r}: they are p0000, p0001, ...")
            self._cache[name] = make_subject(sample_identity(self.seed, name), self.seed, name)
            while len(self._cache) > CACHED_SUBJECTS:
                self._cache.popitem(last=False)
        self._cache.move_to_end(name)
        return self._cache[name]
