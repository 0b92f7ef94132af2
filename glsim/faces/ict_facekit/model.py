"""The ICT-FaceKit model as one matrix, read from its OBJ files once and cached."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import tempfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.canonical import ORIGIN_BEHIND_NOSE_MM
from glsim.errors import ConfigError, MeshError
from glsim.faces.ict_facekit.facs import known_shapes
from glsim.faces.ict_facekit.regions import FACE_PARTS
from glsim.faces.ict_facekit.topology import REGION_NAMES, Topology, build_topology
from glsim.faces.ict_facekit.unseen import seen_faces
from glsim.objfile import read_obj, read_vertices

IDENTITY_MODES: Final = 100
MM_PER_UNIT: Final = 10.0  # the model is in centimetres
LANDMARKS: Final = 68  # Multi-PIE

_NEUTRAL: Final = "generic_neutral_mesh.obj"
_INDICES: Final = "vertex_indices.json"
_GET_IT: Final = "git clone https://github.com/ICT-VGL/ICT-FaceKit"
_CACHE_VERSION: Final = "3"  # raise it when what is cached changes
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Model:
    """Vertices = weights @ basis, in canonical millimetres.

    basis: (1 + 100 + E, V * 3) float32: the mean face, identity modes, expression shapes; a memory
        map of the cache file, shared by all processes of the machine.
    expressions: names of the E shapes, in the order of the rows.
    """

    basis: NDArray[np.float32]
    expressions: tuple[str, ...]
    topology: Topology

    def evaluate(self, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """(B, 1 + 100 + E) weights to (B, V, 3) vertices, one matrix product."""
        return (weights @ self.basis).reshape(len(weights), -1, 3)


def model_folder(root: Path) -> Path:
    """``root`` or the FaceXModel folder in it. Raises ConfigError naming the first missing file."""
    folder = root / "FaceXModel" if (root / "FaceXModel").is_dir() else root
    if not folder.is_dir():
        raise ConfigError(f"{folder}: there is no such folder; get the face model with '{_GET_IT}'")
    for path in (folder / _NEUTRAL, folder / _INDICES, *_identity_files(folder)):
        if not path.is_file():
            raise ConfigError(
                f"{path}: missing, so this is not a whole FaceXModel folder; "
                f"get the face model with '{_GET_IT}'"
            )
    return folder


def load_model(folder: Path) -> Model:
    """From the cache, or read, cached and mapped (about 4 s, once a machine).

    Raises ConfigError for a missing file, MeshError for a damaged one.
    """
    expressions, landmarks = _read_indices(folder / _INDICES)
    files = [folder / _NEUTRAL, *_identity_files(folder), *_expression_files(folder, expressions)]
    cache = cache_folder() / f"ict-facekit-{_fingerprint([*files, folder / _INDICES])}"
    model = _read_cache(cache, expressions)
    if model is not None:
        return model
    _LOG.info("%s: reading %d OBJ files (once; kept in %s)", folder, len(files), cache)
    built = _build(files, expressions, landmarks)
    return _write_cache(cache, built)


def cache_folder() -> Path:
    """$GLSIM_CACHE, or glsim in $XDG_CACHE_HOME, or ~/.cache/glsim."""
    if own := os.environ.get("GLSIM_CACHE"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glsim"


def _identity_files(folder: Path) -> list[Path]:
    return [folder / f"identity{mode:03d}.obj" for mode in range(IDENTITY_MODES)]


def _expression_files(folder: Path, expressions: tuple[str, ...]) -> list[Path]:
    files = [folder / f"{name}.obj" for name in expressions]
    for path in files:
        if not path.is_file():
            raise ConfigError(
                f"{path}: missing, though {_INDICES} lists it; "
                f"get the whole face model with '{_GET_IT}'"
            )
    return files


def _read_indices(path: Path) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Expression names and the 68 landmark vertices."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        expressions = tuple(str(name) for name in content["expressions"])
        landmarks = np.array(content["idx_to_landmark_verts"], dtype=np.int64)
        if landmarks.shape != (LANDMARKS,):
            raise ValueError(f"{len(landmarks)} landmarks, not {LANDMARKS}")
        if lacking := sorted(known_shapes() - set(expressions)):
            raise ValueError(f"no expression {lacking[0]}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise MeshError(
            f"{path}: damaged or of another model ({type(error).__name__}: {error}); "
            f"get the face model with '{_GET_IT}'"
        ) from None
    return expressions, landmarks


def _fingerprint(files: list[Path]) -> str:
    """Changes when any file changes its name, size or time."""
    digest = hashlib.sha256(_CACHE_VERSION.encode())
    for path in files:
        status = path.stat()
        digest.update(f"\0{path.name}\0{status.st_size}\0{status.st_mtime_ns}".encode())
    return digest.hexdigest()[:16]


def _build(files: list[Path], expressions: tuple[str, ...], landmarks: NDArray[np.int64]) -> Model:
    neutral = read_obj(files[0])
    if landmarks.min() < 0 or landmarks.max() >= len(neutral.vertices):
        raise MeshError(f"{files[0]}: has fewer vertices than {_INDICES} speaks of")
    try:
        topology = build_topology(neutral, landmarks)
    except MeshError as error:
        raise MeshError(f"{files[0]}: {error}") from None
    mean = neutral.vertices[topology.kept]
    basis = np.empty((len(files), mean.size), dtype=np.float32)
    for row, path in enumerate(files[1:], start=1):
        vertices = read_vertices(path)
        if vertices.shape != neutral.vertices.shape:
            raise MeshError(
                f"{path}: {len(vertices)} vertices, but {files[0].name} has "
                f"{len(neutral.vertices)}; get the whole face model with '{_GET_IT}'"
            )
        basis[row] = ((vertices[topology.kept] - mean) * MM_PER_UNIT).ravel()
    skin = [REGION_NAMES.index(name) for name in ("face", *FACE_PARTS) if name != "lips"]
    face = mean[np.isin(topology.region, skin)]
    nose_tip = face[np.argmax(face[:, 2])] * MM_PER_UNIT
    origin = nose_tip - np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM])
    basis[0] = (mean * MM_PER_UNIT - origin).ravel()
    if not np.isfinite(basis).all():
        raise MeshError(f"{files[0].parent}: a vertex is NaN or infinite; {_GET_IT} again")
    return _without_unseen(Model(basis, expressions, topology))


def _without_unseen(model: Model) -> Model:
    """The same model without the triangles, and then the vertices, that never come into view."""
    topology = model.topology
    faces = topology.faces[seen_faces(model)]
    used, compact = np.unique(faces, return_inverse=True)
    basis = model.basis.reshape(len(model.basis), -1, 3)[:, used].reshape(len(model.basis), -1)
    kept = Topology(
        compact.reshape(-1, 3).astype(np.int32), topology.kept[used], topology.region[used]
    )
    return Model(np.ascontiguousarray(basis), model.expressions, kept)


def _write_cache(cache: Path, model: Model) -> Model:
    """Written beside its place and renamed, so that nobody ever sees half of it."""
    temporary = ""
    try:
        cache.parent.mkdir(parents=True, exist_ok=True)
        temporary = tempfile.mkdtemp(prefix=f".{cache.name}-", dir=cache.parent)
        np.save(Path(temporary) / "basis.npy", model.basis)
        np.savez(
            Path(temporary) / "topology.npz",
            faces=model.topology.faces,
            kept=model.topology.kept,
            region=model.topology.region,
            checksum=zlib.crc32(model.basis.data),
        )
        if cache.exists():
            shutil.rmtree(cache, ignore_errors=True)  # it could not be read
        try:
            Path(temporary).rename(cache)
        except OSError:  # another process was quicker
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        _LOG.warning("%s: the face model cannot be cached there (%s)", cache, error.strerror)
    return _read_cache(cache, model.expressions) or model


def _read_cache(cache: Path, expressions: tuple[str, ...]) -> Model | None:
    """None if there is no cache, or a damaged one."""
    if not cache.is_dir():
        return None
    try:
        with (cache / "topology.npz").open("rb") as file, np.load(file) as parts:
            topology = Topology(parts["faces"], parts["kept"], parts["region"])
            checksum = int(parts["checksum"])
        basis = np.load(cache / "basis.npy", mmap_mode="r")
        shape = (1 + IDENTITY_MODES + len(expressions), 3 * len(topology.kept))
        if basis.shape != shape or zlib.crc32(basis.data) != checksum:
            raise ValueError("the content does not fit its checksum")
    except Exception as error:  # damaged bytes make numpy and zipfile raise nearly anything
        _LOG.warning("%s: damaged (%s), it is built again", cache, error)
        return None
    return Model(basis, expressions, topology)
