"""The source ``ict-facekit``: heads of the morphable model that perform FACS sequences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.core.seeds import rng_for
from glsim.faces.base import Face, FaceKey, FaceSource, Topology
from glsim.faces.generated import DEFAULT_SEQUENCE, GeneratedFaces, GeneratorSettings
from glsim.faces.ict_facekit.load import load_model, model_folder
from glsim.faces.ict_facekit.model import IDENTITY_MODES, MorphableModel
from glsim.faces.ict_facekit.triangles import ALBEDO, REGION_NAMES

_MAX_WEIGHT: Final = 3.0  # standard deviations of an identity mode; larger ones give unreal faces
_DRAWS: Final = 4  # the probability that all four exceed the limit is 5e-11


class IctFaceKitSettings(GeneratorSettings):
    """The ICT-FaceKit morphable model: 100 identity modes, 53 expressions."""

    def open(self, seed: int) -> FaceSource:
        """Open the model. Raises ConfigError without its folder."""
        return IctFaceKit(self.folder, seed, *self.timing)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Recognise the folder FaceXModel."""
        return float((root / "generic_neutral_mesh.obj").is_file())


class IctFaceKit(GeneratedFaces[NDArray[np.float32]]):
    """Heads "i0000", ... of the ICT-FaceKit model (MIT licence, downloaded by the user).

    Canonical frame: the model's centimetres times 10, with one offset for all people that puts the
    tip of the mean face's nose at (0, 0, 45) mm; the mean face with neck then spans
    x -124..124, y -194..144, z -178..45.

    ``load`` raises MeshError if one of its files is damaged.

    Args:
        root: the cloned repository or its FaceXModel folder; read once, then cached.
        seed, frames_per_sequence, frames_per_second: see ``GeneratedFaces``.

    Raises:
        ConfigError: the model is missing or incomplete.
    """

    name = "ict-facekit"
    letter = "i"

    def __init__(
        self,
        root: Path | str,
        seed: int = 0,
        frames_per_sequence: int = DEFAULT_SEQUENCE,
        frames_per_second: float | None = None,
    ) -> None:
        super().__init__(seed, frames_per_sequence, frames_per_second)
        self.root = model_folder(Path(root))

    @property
    def topology(self) -> Topology:
        """Triangles, regions, and the landmarks of vertex_indices.json."""
        return self._model.topology

    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's (V, 3) float32 vertices without expression, and the triangles."""
        return self.person(subject), self._model.topology.triangles

    def make_person(self, name: str) -> NDArray[np.float32]:
        """Make a subject's (V, 3) vertices without expression, mm."""
        return self._model.neutral(self.identity(name))

    def identity(self, subject: str) -> NDArray[np.float64]:
        """Draw (100,) standard normal weights, truncated at 3: the first of 4 draws within it."""
        rng = rng_for(self.seed, "ict-facekit", subject)
        draws = rng.standard_normal((_DRAWS, IDENTITY_MODES))
        first = np.argmax(np.abs(draws) <= _MAX_WEIGHT, axis=0)
        chosen = draws[first, np.arange(IDENTITY_MODES)]
        return np.asarray(np.clip(chosen, -_MAX_WEIGHT, _MAX_WEIGHT))

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Return the hash of the model as it is read from its files, or from the cache."""
        return {"face model": self._model.content_hash()}

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        """Yield one face per key, in order."""
        model = self._model
        for key in keys:
            expression = self.expression(key)
            weights = model.shape_weights(expression)
            head = model.with_shapes(self.person(key.subject), weights)
            mesh = Mesh(head, model.topology.triangles, self._albedo, model.occluder)
            yield Face(key, mesh, expression)

    @cached_property
    def _model(self) -> MorphableModel:
        return load_model(self.root)

    @cached_property
    def _albedo(self) -> NDArray[np.float32]:
        values = np.array([ALBEDO[name] for name in REGION_NAMES], dtype=np.float32)
        return values[self._model.topology.regions]
