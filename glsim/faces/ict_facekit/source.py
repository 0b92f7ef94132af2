"""The ICT-FaceKit source: endless subjects "i0000", "i0001", ... that perform FACS sequences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.ict_facekit.load import kept_landmarks, load_model, model_folder
from glsim.faces.ict_facekit.model import IDENTITY_MODES, MorphableModel
from glsim.faces.ict_facekit.shapes import kit_weights
from glsim.faces.ict_facekit.topology import REGION_NAMES
from glsim.faces.sequences import performance_expression, performance_frames
from glsim.geometry.mesh import Mesh
from glsim.settings.seeds import rng_for

MAX_WEIGHT: Final = 3.0  # standard deviations of an identity mode; larger weights give unreal faces
DRAWS: Final = 4  # the probability that all four exceed MAX_WEIGHT is 5e-11
BATCH_FRAMES: Final = 32  # frames that share the sum of a person: 9 MB of vertices


class IctFaceKit:
    """A FaceSource of the ICT-FaceKit morphable model (MIT licence, downloaded by the user).

    Canonical frame: the model's centimetres times 10, with one offset for all people that puts the
    tip of the mean face's nose at (0, 0, 45) mm; the mean face with neck then spans
    x -124..124, y -194..144, z -178..45.

    ``load`` raises MeshError if one of its files is damaged.

    Args:
        root: the cloned repository or its FaceXModel folder; read once, then cached (see
            ``cache``).
        seed: determines every identity and performance.
        frames_per_sequence: length of a sequence.
        frames_per_second: see ``performance_frames``.
        new_identity_every_frame: use another person in every frame, for benchmarks.

    Raises:
        ConfigError: the model is missing or incomplete.
    """

    name = "ict-facekit"

    def __init__(
        self,
        root: Path | str,
        seed: int = 0,
        frames_per_sequence: int = 30,
        frames_per_second: float | None = None,
        *,
        new_identity_every_frame: bool = False,
    ) -> None:
        if frames_per_sequence < 1:
            raise ConfigError(f"frames_per_sequence is {frames_per_sequence}: give 1 or more")
        self.root = model_folder(Path(root))
        self.seed = seed
        self.frames_per_sequence = frames_per_sequence
        self.frames_per_second = frames_per_second
        self.new_identity_every_frame = new_identity_every_frame

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings only; each worker maps the cached model itself."""
        return {name: value for name, value in self.__dict__.items() if not name.startswith("_")}

    @property
    def regions(self) -> NDArray[np.uint8]:
        """(V,) uint8 indices into ``region_names``, the same for all subjects."""
        return self._model.topology.region

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions that ``regions`` refers to."""
        return REGION_NAMES

    @property
    def landmarks(self) -> NDArray[np.int64]:
        """(68,) vertices of the landmarks of vertex_indices.json, in the order of Multi-PIE."""
        return self._landmarks

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` subjects. Raises ConfigError for None: they are endless."""
        if count is None:
            raise ConfigError("ict-facekit faces never end: give a number of subjects")
        return [f"i{number:04d}" for number in range(count)]

    def frames(self, subject: str, count: int | None) -> Sequence[FaceKey]:
        """Return the first ``count`` frames of a subject, sequence by sequence."""
        return performance_frames(
            self.seed, subject, count, self.frames_per_sequence, self.frames_per_second
        )

    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's (V, 3) float32 vertices without expression, mm, and (F, 3) faces."""
        model = self._model
        weights = np.zeros((1, len(model.basis)), dtype=np.float32)
        weights[0, 0] = 1.0
        weights[0, 1 : 1 + IDENTITY_MODES] = self._identity(FaceKey(subject, "neutral", 0))
        return model.evaluate(weights)[0], model.topology.faces

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Return the hash of the model as it is read from its files, or from the cache."""
        return {"face model": self._model.content_hash()}

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Yield one face per key, in order, evaluated in batches."""
        for first in range(0, len(keys), BATCH_FRAMES):
            yield from self._load_batch(keys[first : first + BATCH_FRAMES])

    def _load_batch(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        model = self._model
        weights = np.zeros((len(keys), len(model.basis)), dtype=np.float32)
        expressions = [performance_expression(self.seed, key) for key in keys]
        for row, key, expression in zip(weights, keys, expressions, strict=True):
            row[0] = 1.0
            row[1 : 1 + IDENTITY_MODES] = self._identity(key)
            row[1 + IDENTITY_MODES :] = kit_weights(expression, model.expressions)
        heads = model.evaluate(weights)
        for key, head, expression in zip(keys, heads, expressions, strict=True):
            mesh = Mesh(head, model.topology.faces, self._albedo, model.occluder)
            yield Face(key, mesh, expression)

    def _identity(self, key: FaceKey) -> NDArray[np.float64]:
        """Draw (100,) standard normal weights, truncated at 3: the first of 4 draws within it."""
        if not (key.subject.startswith("i") and key.subject[1:].isdigit()):
            raise ConfigError(f"no ict-facekit subject {key.subject!r}: they are i0000, i0001, ...")
        words: tuple[str | int, ...] = ("ict-facekit", key.subject)
        if self.new_identity_every_frame:
            words += (key.sequence, key.frame)
        draws = rng_for(self.seed, *words).standard_normal((DRAWS, IDENTITY_MODES))
        first = np.argmax(np.abs(draws) <= MAX_WEIGHT, axis=0)
        chosen = draws[first, np.arange(IDENTITY_MODES)]
        return np.asarray(np.clip(chosen, -MAX_WEIGHT, MAX_WEIGHT))

    @cached_property
    def _model(self) -> MorphableModel:
        return load_model(self.root)

    @cached_property
    def _landmarks(self) -> NDArray[np.int64]:
        return kept_landmarks(self.root, self._model)

    @cached_property
    def _albedo(self) -> NDArray[np.float32]:
        return self._model.topology.albedo()
