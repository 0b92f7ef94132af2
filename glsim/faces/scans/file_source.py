"""Functions shared by file-based sources: subject checks, loading, and caching of errors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from glsim.errors import ConfigError, GlsimError, MeshError, did_you_mean
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.scans.file_tree import list_names
from glsim.files.contents import content_hash

_T = TypeVar("_T")

#: Characters of an exception that are kept in a message.
_REASON_LENGTH = 120

#: Extensions of the files that meshes refer to: materials of OBJ, buffers of glTF.
_COMPANIONS = (".mtl", ".bin")


def first_subjects(
    root: Path, names: Collection[str], count: int | None, nothing: str
) -> list[str]:
    """Return the first ``count`` names (None: all). Raises ConfigError if there are fewer.

    Args:
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


@contextmanager
def one_bad_file(file: Path | str) -> Iterator[None]:
    """Turn any exception of the block into a MeshError that names ``file``.

    Errors of glsim pass. A file can do anything to the libraries that read it: ask for more memory
    than there is, nest deeper than Python's stack, name a file that cannot exist.
    """
    try:
        yield
    except GlsimError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:_REASON_LENGTH]
        what = f"{type(error).__name__}: {reason}" if reason else type(error).__name__
        raise MeshError(f"{file}: cannot be used ({what}); mend it, or take it away") from error


def load_faces(
    keys: Sequence[FaceKey], make: Callable[[FaceKey], Face]
) -> Iterator[Face | BadFace]:
    """Yield one result per key; whatever a file does becomes a BadFace."""
    for key in keys:
        try:
            with one_bad_file(key.path):
                face = make(key)
        except MeshError as error:
            yield BadFace(key, error)
        else:
            yield face


def cached_or_error(cache: dict[str, _T | MeshError], name: str, make: Callable[[str], _T]) -> _T:
    """Return ``make(name)``, called once per name; its MeshError is cached and raised again."""
    if name not in cache:
        try:
            with one_bad_file(name):
                cache[name] = make(name)
        except MeshError as error:
            cache[name] = error
    result = cache[name]
    if isinstance(result, MeshError):
        raise result
    return result
