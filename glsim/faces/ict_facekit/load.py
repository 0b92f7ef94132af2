"""Load the model from its OBJ files or from the cache."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, MeshError
from glsim.faces.ict_facekit.model import IDENTITY_MODES, MM_PER_UNIT, MorphableModel
from glsim.faces.ict_facekit.regions import FACE_PARTS
from glsim.faces.ict_facekit.shapes import KNOWN_SHAPES
from glsim.faces.ict_facekit.topology import REGION_NAMES, Topology, build_topology
from glsim.faces.ict_facekit.visible import visible_faces
from glsim.faces.model_cache import Arrays, cached_arrays
from glsim.files.cache_folder import cache_folder
from glsim.meshio.alignment import ORIGIN_BEHIND_NOSE_MM
from glsim.meshio.limits import check_size
from glsim.meshio.obj import read_obj, read_vertices

LANDMARKS: Final = 68  # Multi-PIE

_NEUTRAL: Final = "generic_neutral_mesh.obj"
_INDICES: Final = "vertex_indices.json"
_MAX_INDICES_BYTES: Final = 1 << 24  # the model's own has 0.2 MB
_DOWNLOAD: Final = "git clone https://github.com/ICT-VGL/ICT-FaceKit"
_CACHE_VERSION: Final = "5"  # raise it when the content of the cache changes
_TOPOLOGY: Final = ("faces", "kept", "region")


def model_folder(root: Path) -> Path:
    """Return ``root`` or the FaceXModel folder in it.

    Raises ConfigError that names the first missing file.
    """
    folder = root / "FaceXModel" if (root / "FaceXModel").is_dir() else root
    if not folder.is_dir():
        raise ConfigError(
            f"{folder}: there is no such folder; get the face model with '{_DOWNLOAD}'"
        )
    for path in (folder / _NEUTRAL, folder / _INDICES, *_identity_files(folder)):
        if not path.is_file():
            raise ConfigError(
                f"{path}: missing, so this is not a whole FaceXModel folder; "
                f"get the face model with '{_DOWNLOAD}'"
            )
    return folder


def load_model(folder: Path) -> MorphableModel:
    """Map the model from the cache; build and cache it first if needed (4 s, once per machine).

    Raises ConfigError for a missing file, MeshError for a damaged one.
    """
    expressions, landmarks = _read_indices(folder / _INDICES)
    files = [folder / _NEUTRAL, *_identity_files(folder), *_expression_files(folder, expressions)]
    cache = _cache_path([*files, folder / _INDICES])
    arrays = cached_arrays(cache, lambda: _arrays(_build(files, expressions, landmarks)))
    topology = Topology(*(np.asarray(arrays[name]) for name in _TOPOLOGY))
    return MorphableModel(arrays["basis"], tuple(arrays["expressions"].tolist()), topology)


def _arrays(model: MorphableModel) -> Arrays:
    topology = {name: getattr(model.topology, name) for name in _TOPOLOGY}
    return {"basis": model.basis, "expressions": np.array(model.expressions), **topology}


def _cache_path(files: list[Path]) -> Path:
    """Return the cache of these source files; it depends on their names, sizes and times."""
    digest = hashlib.sha256(_CACHE_VERSION.encode())
    for path in files:
        status = path.stat()
        digest.update(f"\0{path.name}\0{status.st_size}\0{status.st_mtime_ns}".encode())
    return cache_folder() / f"ict-facekit-{digest.hexdigest()[:16]}"


def _identity_files(folder: Path) -> list[Path]:
    return [folder / f"identity{mode:03d}.obj" for mode in range(IDENTITY_MODES)]


def _expression_files(folder: Path, expressions: tuple[str, ...]) -> list[Path]:
    files = [folder / f"{name}.obj" for name in expressions]
    for path in files:
        if not path.is_file():
            raise ConfigError(
                f"{path}: missing, though {_INDICES} lists it; "
                f"get the whole face model with '{_DOWNLOAD}'"
            )
    return files


def _read_indices(path: Path) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Read the expression names and the (68,) landmark vertices. Raises MeshError."""
    check_size(path, _MAX_INDICES_BYTES)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        expressions = tuple(str(name) for name in content["expressions"])
        landmarks = np.array(content["idx_to_landmark_verts"], dtype=np.int64)
        if landmarks.shape != (LANDMARKS,):
            raise ValueError(f"{len(landmarks)} landmarks, not {LANDMARKS}")
        if missing := sorted(KNOWN_SHAPES - set(expressions)):
            raise ValueError(f"no expression {missing[0]}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise MeshError(
            f"{path}: damaged or of another model ({type(error).__name__}: {error}); "
            f"get the face model with '{_DOWNLOAD}'"
        ) from None
    return expressions, landmarks


def kept_landmarks(folder: Path, model: MorphableModel) -> NDArray[np.int64]:
    """Return (68,) indices of the landmarks among the model's vertices. Raises MeshError."""
    _, landmarks = _read_indices(folder / _INDICES)
    kept = model.topology.kept
    order = np.argsort(kept)
    place = np.searchsorted(kept, landmarks, sorter=order).clip(max=len(kept) - 1)
    found: NDArray[np.int64] = order[place].astype(np.int64)
    if lost := int((kept[found] != landmarks).sum()):
        raise MeshError(f"{folder / _INDICES}: {lost} landmarks are on no visible triangle")
    return found


def _build(
    files: list[Path], expressions: tuple[str, ...], landmarks: NDArray[np.int64]
) -> MorphableModel:
    """Build the model from its OBJ files, neutral first. Raises MeshError."""
    neutral = read_obj(files[0])
    if landmarks.min() < 0 or landmarks.max() >= len(neutral.vertices):
        raise MeshError(f"{files[0]}: has fewer vertices than {_INDICES} refers to")
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
                f"{len(neutral.vertices)}; get the whole face model with '{_DOWNLOAD}'"
            )
        basis[row] = ((vertices[topology.kept] - mean) * MM_PER_UNIT).ravel()
    skin = [REGION_NAMES.index(name) for name in ("face", *FACE_PARTS) if name != "lips"]
    face = mean[np.isin(topology.region, skin)]
    nose_tip = face[np.argmax(face[:, 2])] * MM_PER_UNIT
    origin = nose_tip - np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM])
    basis[0] = (mean * MM_PER_UNIT - origin).ravel()
    if not np.isfinite(basis).all():
        raise MeshError(f"{files[0].parent}: a vertex is NaN or infinite; {_DOWNLOAD} again")
    return _visible_part(MorphableModel(basis, expressions, topology))


def _visible_part(model: MorphableModel) -> MorphableModel:
    """Return the model without triangles that are never visible, and without unused vertices."""
    topology = model.topology
    faces = topology.faces[visible_faces(model)]
    used, compact = np.unique(faces, return_inverse=True)
    basis = model.basis.reshape(len(model.basis), -1, 3)[:, used].reshape(len(model.basis), -1)
    kept = Topology(
        compact.reshape(-1, 3).astype(np.int32), topology.kept[used], topology.region[used]
    )
    return MorphableModel(np.ascontiguousarray(basis), model.expressions, kept)
