"""Load the model from its OBJ files or from the cache."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, MeshError
from glsim.core.files.cache_folder import cache_folder
from glsim.core.seeds import rng_for
from glsim.faces.base import Topology
from glsim.faces.ict_facekit.model import IDENTITY_MODES, KNOWN_SHAPES, MorphableModel
from glsim.faces.ict_facekit.triangles import FACE_PARTS, REGION_NAMES, label_triangles
from glsim.faces.landmarks import LANDMARKS
from glsim.faces.meshes.alignment import ORIGIN_BEHIND_NOSE_MM
from glsim.faces.meshes.limits import check_size
from glsim.faces.meshes.obj import read_obj, read_vertices
from glsim.faces.model_cache import Arrays, cached_arrays
from glsim.faces.visible_part import find_visible_faces

_NEUTRAL: Final = "generic_neutral_mesh.obj"
_INDICES: Final = "vertex_indices.json"
_MAX_INDICES_BYTES: Final = 1 << 24  # the model's own has 0.2 MB
_DOWNLOAD: Final = "git clone https://github.com/ICT-VGL/ICT-FaceKit"
_CACHE_VERSION: Final = "6"  # raise it when the content of the cache changes
_MM_PER_UNIT: Final = 10.0  # the model is in centimetres

# The heads in whose pictures triangles are looked for: people, views of each, and the probability
# that an expression shape is part of a mixture. Without a third of the triangles (the back of
# eyeballs, roots of teeth, sockets) 10 of 600 images of other people and expressions (0.7 m, yaw to
# 75 degrees, pitch to 45) differ, by two pixels at most.
_SEEN_PEOPLE, _SEEN_BATCH, _SEEN_DIRECTIONS, _SEEN_SHAPE = 160, 8, 3, 0.15


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
    arrays = cached_arrays(cache, lambda: _build(files, expressions, landmarks))
    parts = (arrays[name] for name in ("triangles", "regions", "landmarks"))
    triangles, regions, vertices = map(np.asarray, parts)
    topology = Topology(triangles, regions, REGION_NAMES, vertices)
    return MorphableModel(arrays["basis"], tuple(arrays["expressions"].tolist()), topology)


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


def _build(files: list[Path], expressions: tuple[str, ...], landmarks: NDArray[np.int64]) -> Arrays:
    """Build the model's arrays from its OBJ files, neutral first. Raises MeshError."""
    neutral = read_obj(files[0])
    if landmarks.min() < 0 or landmarks.max() >= len(neutral.vertices):
        raise MeshError(f"{files[0]}: has fewer vertices than {_INDICES} refers to")
    try:
        triangles, kept, regions = label_triangles(neutral, landmarks)
    except MeshError as error:
        raise MeshError(f"{files[0]}: {error}") from None
    mean = neutral.vertices[kept]
    basis = np.empty((len(files), mean.size), dtype=np.float32)
    for row, path in enumerate(files[1:], start=1):
        vertices = read_vertices(path)
        if vertices.shape != neutral.vertices.shape:
            raise MeshError(
                f"{path}: {len(vertices)} vertices, but {files[0].name} has "
                f"{len(neutral.vertices)}; get the whole face model with '{_DOWNLOAD}'"
            )
        basis[row] = ((vertices[kept] - mean) * _MM_PER_UNIT).ravel()
    skin = [REGION_NAMES.index(name) for name in ("face", *FACE_PARTS) if name != "lips"]
    face = mean[np.isin(regions, skin)]
    nose_tip = face[np.argmax(face[:, 2])] * _MM_PER_UNIT
    origin = nose_tip - np.array([0.0, 0.0, ORIGIN_BEHIND_NOSE_MM])
    basis[0] = (mean * _MM_PER_UNIT - origin).ravel()
    if not np.isfinite(basis).all():
        raise MeshError(f"{files[0].parent}: a vertex is NaN or infinite; {_DOWNLOAD} again")
    seen = visible_triangles(MorphableModel(basis, expressions, Topology(triangles)))
    used, compact = np.unique(triangles[seen], return_inverse=True)
    place = np.full(len(neutral.vertices), -1)
    place[kept[used]] = np.arange(len(used))
    if lost := int((place[landmarks] < 0).sum()):
        raise MeshError(
            f"{files[0].parent / _INDICES}: {lost} landmarks are on no visible triangle"
        )
    return {
        "basis": basis.reshape(len(basis), -1, 3)[:, used].reshape(len(basis), -1),
        "expressions": np.array(expressions),
        "triangles": compact.reshape(-1, 3).astype(np.int32),
        "regions": regions[used],
        "landmarks": place[landmarks],
    }


def visible_triangles(model: MorphableModel) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle can be visible. Raises DeviceError without OpenGL."""
    rng = rng_for(0, "ict-facekit", "ever seen")
    triangles, heads = model.topology.triangles, _heads(model, rng)
    return find_visible_faces(triangles, heads, rng, _SEEN_DIRECTIONS, pitch_sign=-1.0)


def _heads(model: MorphableModel, rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    """Yield random people: the first ones show one shape each at full strength, others mixtures."""
    shapes = len(model.expressions)
    modes = len(model.basis) - 1 - shapes
    for first in range(0, _SEEN_PEOPLE, _SEEN_BATCH):
        identities = np.clip(rng.standard_normal((_SEEN_BATCH, modes)), -3, 3)
        mixed = rng.random((_SEEN_BATCH, shapes)) * (
            rng.random((_SEEN_BATCH, shapes)) < _SEEN_SHAPE
        )
        alone = range(first, min(first + _SEEN_BATCH, shapes))
        mixed[: len(alone)] = np.eye(shapes)[[*alone]]
        mixed[1::2, model.expressions.index("jawOpen")] = rng.random(_SEEN_BATCH // 2)
        for identity, weights in zip(identities, mixed, strict=True):
            yield model.with_shapes(model.neutral(identity), weights)
