"""The source ``ict-facekit``: heads of the ICT morphable model that perform FACS sequences.

``ict_facekit.npz`` lists the rendered vertices and triangles of the model's neutral mesh, in an
order for cache locality, with regions and landmarks. Lacrimal fluid, lashes and iris meshes are
left out (the cornea in front of an iris is labelled "iris"), and a third of the triangles, which no
picture shows. Commit c252f95 computes it from the ``usemtl`` groups, the landmarks of
vertex_indices.json and pictures of 160 people.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, DatasetError, MeshError
from glsim.core.files.atomic import read_json
from glsim.core.mesh import Mesh, occluder_of
from glsim.core.seeds import rng_for
from glsim.faces.action_units import SHAPES, shape_weights
from glsim.faces.face_source import Face, FaceKey, FaceSource, Topology
from glsim.faces.generated import DEFAULT_SEQUENCE, GeneratedFaces, GeneratorSettings
from glsim.faces.meshes.face_fit import ORIGIN_BEHIND_NOSE_MM
from glsim.faces.meshes.obj import read_obj, read_vertices
from glsim.faces.model_cache import Arrays, cached_arrays

#: File with the indices of the neutral mesh's rendered vertices and triangles.
DRAWN: Final = Path(__file__).with_suffix(".npz")

#: Region -> reflectivity: diffuse, 860 nm, relative to a white wall, with the sources of
#: ``glsim.faces.procedural.subject`` (skin 0.4-0.68, sclera 0.4-0.6, iris dark, lips about skin).
#: Sockets and gums are wet mucosa, teeth are bright but shaded by the mouth.
ALBEDO: Final = {
    "face": 0.6, "lips": 0.55, "head": 0.6, "eye socket": 0.5, "mouth socket": 0.4, "gums": 0.4,
    "teeth": 0.5, "sclera": 0.5, "iris": 0.1, "forehead": 0.6, "cheek": 0.6, "chin": 0.6,
    "lids": 0.6, "nose": 0.6, "brow": 0.6,
}  # fmt: skip
REGIONS: Final = tuple(ALBEDO)

IDENTITY_MODES: Final = 100
_MAX_WEIGHT: Final = 3.0  # standard deviations of an identity mode; larger ones give unreal faces
_DRAWS: Final = 4  # the probability that all four exceed the limit is 5e-11

_NEUTRAL: Final = "generic_neutral_mesh.obj"
_INDICES: Final = "vertex_indices.json"
_GET: Final = "get the whole face model with 'git clone https://github.com/ICT-VGL/ICT-FaceKit'"
_CACHE_VERSION: Final = "7"  # raise it when the content of the cache changes
_MM_PER_UNIT: Final = 10.0  # the model is in centimetres

#: AU25 opens the lips by 4 mm; the kit's jawOpen opens them by 42 mm.
_OVERRIDES: Final = {"AU25": {"jawOpen": 0.1}}
#: Shapes of the midline whose names have a side.
_WHOLE: Final = ("jawLeft", "jawRight")


def _kit_name(shape: str) -> str:
    """Convert an ARKit shape name to the kit's name."""
    for side in () if shape in _WHOLE else ("Left", "Right"):
        if shape.endswith(side):
            return f"{shape.removesuffix(side)}_{side[0]}"
    return shape


#: All shapes that an action unit uses.
KNOWN_SHAPES: Final = frozenset(map(_kit_name, SHAPES))


class IctFaceKitSettings(GeneratorSettings):
    """The ICT-FaceKit morphable model: 100 identity modes, 53 expressions."""

    def open(self, seed: int) -> FaceSource:
        """Open the model. Raises ConfigError without its folder."""
        return IctFaceKit(self.folder, seed, *self.timing)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Return 1 if the folder is a FaceXModel, else 0."""
        return float((root / _NEUTRAL).is_file())


@dataclass(frozen=True, eq=False)
class MorphableModel:
    """A linear face model: vertices = weights @ basis, in canonical axes and mm.

    ``basis`` (1 + 100 + E, V * 3) float32: mean face, identity modes, E named expression shapes; a
    memory map of the cache file, shared by all processes of the machine.
    """

    basis: NDArray[np.float32]
    expressions: tuple[str, ...]
    topology: Topology

    @cached_property
    def occluder(self) -> NDArray[np.int32]:
        """Triangles (F', 3) int32 that cast shadows, chosen on the mean face."""
        return occluder_of(self.basis[0].reshape(-1, 3), self.topology.triangles)

    @cached_property
    def albedo(self) -> NDArray[np.float32]:
        """Reflectivity (V,) float32 of the vertices, by region."""
        return np.array([*ALBEDO.values()], dtype=np.float32)[self.topology.regions]

    def content_hash(self) -> str:
        """Return a hash of all arrays of the model (30 ms)."""
        topology = self.topology
        assert topology.regions is not None
        digest = hashlib.blake2b(" ".join(self.expressions).encode(), digest_size=16)
        for part in (self.basis, topology.triangles, topology.regions, self.occluder):
            digest.update(np.ascontiguousarray(part).data)
        return digest.hexdigest()

    def neutral(self, identity: NDArray[np.floating]) -> NDArray[np.float32]:
        """Compute a neutral head (V, 3) float32 mm from identity weights (100,)."""
        return self._sum(self.basis[0], identity, 1)

    def with_shapes(
        self, neutral: NDArray[np.float32], weights: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """Add expression shapes with weights (E,) to a neutral head: (V, 3) float32 mm."""
        return self._sum(neutral.ravel(), weights, 1 + IDENTITY_MODES)

    def _sum(
        self, start: NDArray[np.float32], weights: NDArray[np.floating], first: int
    ) -> NDArray[np.float32]:
        """Add weighted basis rows one by one, so that all processors give the same bytes."""
        face = start.copy()
        for row, weight in enumerate(weights.astype(np.float32), start=first):
            if weight:
                face += self.basis[row] * weight
        return face.reshape(-1, 3)

    def shape_weights(self, expression: Mapping[str, float]) -> NDArray[np.float64]:
        """Compute shape weights (E,) in [0, 1] for action unit -> intensity."""
        weights = np.zeros(len(self.expressions))
        for name, weight in shape_weights(expression, _OVERRIDES).items():
            weights[self.expressions.index(_kit_name(name))] = weight
        return weights


class IctFaceKit(GeneratedFaces[NDArray[np.float32]]):
    """A source of heads "i0000", ... from the ICT-FaceKit model (MIT licence, user's download).

    Canonical frame: the model's centimetres times 10, with one offset for all people that puts the
    tip of the mean face's nose at (0, 0, 45) mm; the mean face with neck then spans
    x -124..124, y -194..144, z -178..45.

    Raises ConfigError for a missing or incomplete model; ``load`` MeshError for a damaged file.

    ``root``: the cloned repository or its FaceXModel folder; read once, then cached.
    """

    name = "ict-facekit"
    letter = "i"

    def __init__(
        self, root: Path | str, seed: int = 0, frames_per_sequence: int = DEFAULT_SEQUENCE,
        frames_per_second: float | None = None,
    ) -> None:  # fmt: skip
        super().__init__(seed, frames_per_sequence, frames_per_second)
        below = Path(root) / "FaceXModel"
        self.root = below if below.is_dir() else Path(root)
        _check_files([self.root / _NEUTRAL, self.root / _INDICES, *_identity_files(self.root)])

    @property
    def topology(self) -> Topology:
        """Triangles, regions and landmarks, shared by all heads."""
        return self._model.topology

    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's neutral vertices (V, 3) float32 mm, and the triangles."""
        return self.person(subject), self._model.topology.triangles

    def make_person(self, name: str) -> NDArray[np.float32]:
        """Compute a subject's neutral vertices (V, 3) mm."""
        return self._model.neutral(self.identity(name))

    def identity(self, subject: str) -> NDArray[np.float64]:
        """Draw identity weights (100,), standard normal and truncated at +-3."""
        rng = rng_for(self.seed, "ict-facekit", subject)
        draws = rng.standard_normal((_DRAWS, IDENTITY_MODES))
        first = np.argmax(np.abs(draws) <= _MAX_WEIGHT, axis=0)
        chosen = draws[first, np.arange(IDENTITY_MODES)]
        return np.asarray(np.clip(chosen, -_MAX_WEIGHT, _MAX_WEIGHT))

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Return a hash of the loaded model."""
        return {"face model": self._model.content_hash()}

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        """Yield one face per key, in order."""
        model = self._model
        for key in keys:
            expression = self.expression(key)
            weights = model.shape_weights(expression)
            head = model.with_shapes(self.person(key.subject), weights)
            mesh = Mesh(head, model.topology.triangles, model.albedo, model.occluder)
            yield Face(key, mesh, expression)

    @cached_property
    def _model(self) -> MorphableModel:
        return load_model(self.root)


def load_model(folder: Path) -> MorphableModel:
    """Map the model's arrays from the cache; the first use per machine builds the cache (4 s).

    Raises ConfigError for a missing file, MeshError for a damaged one.
    """
    expressions = _read_expressions(folder / _INDICES)
    shapes = [folder / f"{name}.obj" for name in expressions]
    _check_files(shapes)
    files = [folder / _NEUTRAL, *_identity_files(folder), *shapes]
    digest = hashlib.sha256(_CACHE_VERSION.encode())
    for path in files:
        status = path.stat()
        digest.update(f"\0{path.name}\0{status.st_size}\0{status.st_mtime_ns}".encode())
    arrays = cached_arrays(f"ict-facekit-{digest.hexdigest()[:16]}", lambda: _build(files))
    triangles, regions, landmarks = (
        np.asarray(arrays[name]) for name in ("triangles", "regions", "landmarks")
    )
    topology = Topology(triangles, regions, REGIONS, landmarks)
    return MorphableModel(arrays["basis"], expressions, topology)


def _check_files(paths: list[Path]) -> None:
    """Raise ConfigError that names the first missing file, if any."""
    for path in paths:
        if not path.is_file():
            raise ConfigError(f"{path}: missing, so this is not a whole FaceXModel folder; {_GET}")


def _identity_files(folder: Path) -> list[Path]:
    return [folder / f"identity{mode:03d}.obj" for mode in range(IDENTITY_MODES)]


def _read_expressions(path: Path) -> tuple[str, ...]:
    """Read the names of the model's expressions. Raises MeshError."""
    try:
        names = read_json(path)["expressions"]
        expressions = tuple(str(name) for name in names)
        if missing := sorted(KNOWN_SHAPES - set(expressions)):
            raise ValueError(f"no expression {missing[0]}")
    except (DatasetError, ValueError, KeyError, TypeError) as error:
        raise MeshError(
            f"{path}: damaged or of another model ({type(error).__name__}: {error}); {_GET}"
        ) from None
    return expressions


def _build(files: list[Path]) -> Arrays:
    """Build the model's arrays from its OBJ files, the neutral file first. Raises MeshError."""
    with np.load(DRAWN) as stored:
        drawn = {name: stored[name] for name in stored.files}
    neutral = read_obj(files[0])
    triangles, _ = neutral.fans()  # the same triangulation as in DRAWN
    if [len(neutral.vertices), len(triangles)] != drawn["size"].tolist():
        raise MeshError(f"{files[0]}: damaged or of another model; {_GET}")
    rendered = drawn["vertices"]
    mean = neutral.vertices[rendered]
    basis = np.empty((len(files), mean.size), dtype=np.float32)
    for row, path in enumerate(files[1:], start=1):
        vertices = read_vertices(path)
        if vertices.shape != neutral.vertices.shape:
            raise MeshError(
                f"{path}: {len(vertices)} vertices, but {files[0].name} has "
                f"{len(neutral.vertices)}; {_GET}"
            )
        basis[row] = ((vertices[rendered] - mean) * _MM_PER_UNIT).ravel()
    nose_tip = mean[np.argmax(mean[:, 2])] * _MM_PER_UNIT
    origin = nose_tip - np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM])
    basis[0] = (mean * _MM_PER_UNIT - origin).ravel()
    if not (finite := np.isfinite(basis).all(axis=1)).all():
        raise MeshError(f"{files[int(finite.argmin())]}: a vertex is NaN or infinite; {_GET}")
    number = np.full(len(neutral.vertices), -1, dtype=np.int32)
    number[rendered] = np.arange(len(rendered))
    return {
        "basis": basis,
        "triangles": number[triangles[drawn["triangles"]]],
        "regions": drawn["regions"],
        "landmarks": drawn["landmarks"].astype(np.int64),
    }
