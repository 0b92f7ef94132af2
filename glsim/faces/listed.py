"""What sources that list files share: errors of wrong names, and damage that is remembered."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from glsim.errors import ConfigError, MeshError, did_you_mean
from glsim.faces.base import BadFace, Face, FaceKey

_T = TypeVar("_T")


def first_subjects(
    root: Path, names: Collection[str], count: int | None, nothing: str
) -> list[str]:
    """The first ``count`` names. Raises ConfigError: fewer than that, or none (``nothing``)."""
    if not names:
        raise ConfigError(f"{root}: {nothing}")
    if count is not None and count > len(names):
        raise ConfigError(f"{root}: has {len(names)} subjects, {count} were asked for")
    return list(names)[:count]


def check_subject(root: Path, subject: str, names: Collection[str]) -> None:
    """Raises ConfigError for a subject that is not there."""
    if subject not in names:
        raise ConfigError(f"{root}: no subject {subject!r} ({did_you_mean(subject, names)})")


def load_each(keys: Sequence[FaceKey], make: Callable[[FaceKey], Face]) -> Iterator[Face | BadFace]:
    """One result a key; a MeshError becomes a BadFace."""
    for key in keys:
        try:
            yield make(key)
        except MeshError as error:
            yield BadFace(key, error)


def remembered(found: dict[str, _T | MeshError], name: str, find: Callable[[str], _T]) -> _T:
    """What ``find`` says of a name, asked once; raises its MeshError again."""
    if name not in found:
        try:
            found[name] = find(name)
        except MeshError as error:
            found[name] = error
    result = found[name]
    if isinstance(result, MeshError):
        raise result
    return result
