"""Functions shared by file-based sources: subject checks, loading, and caching of errors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from glsim.errors import ConfigError, MeshError, did_you_mean
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.scans.file_tree import list_names
from glsim.files.contents import content_hash

_T = TypeVar("_T")

#: Extensions of the files that meshes refer to: materials of OBJ, buffers of glTF.
_COMPANIONS = (".mtl", ".bin")


def first_subjects(
    root: Path, names: Collection[str], count: int | None, nothing: str
) -> list[str]:
    """Return the first ``count`` names (None: all). Raises ConfigError if there are fewer.

    nothing: error text for an empty root.
    """
    if not names:
        raise ConfigError(f"{root}: {nothing}")
    if count is not None and count > len(names):
        raise ConfigError(f"{root}: has {len(names)} subjects, {count} were asked for")
    return list(names)[:count]


def file_contents(root: Path, paths: Iterable[Path]) -> dict[str, str]:
    """Return path below ``root`` -> hash, for mesh files and the materials and buffers beside them.

    Any material or buffer of a folder counts, whether a mesh names it or not.
    """
    meshes = list(dict.fromkeys(paths))
    folders = dict.fromkeys(path.parent for path in meshes)
    beside = [
        folder / name
        for folder in folders
        for name in list_names(folder)
        if Path(name).suffix.lower() in _COMPANIONS
    ]
    return {path.relative_to(root).as_posix(): content_hash(path) for path in [*meshes, *beside]}


def check_subject(root: Path, subject: str, names: Collection[str]) -> None:
    """Raise ConfigError if there is no such subject."""
    if subject not in names:
        raise ConfigError(f"{root}: no subject {subject!r} ({did_you_mean(subject, names)})")


def load_faces(
    keys: Sequence[FaceKey], make: Callable[[FaceKey], Face]
) -> Iterator[Face | BadFace]:
    """Yield one result per key; a MeshError becomes a BadFace."""
    for key in keys:
        try:
            yield make(key)
        except MeshError as error:
            yield BadFace(key, error)


def cached_or_error(cache: dict[str, _T | MeshError], name: str, make: Callable[[str], _T]) -> _T:
    """Return ``make(name)``, called once per name; its MeshError is cached and raised again."""
    if name not in cache:
        try:
            cache[name] = make(name)
        except MeshError as error:
            cache[name] = error
    result = cache[name]
    if isinstance(result, MeshError):
        raise result
    return result
