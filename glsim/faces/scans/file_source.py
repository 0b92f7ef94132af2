"""The base class of sources that read files: root folder, subjects, loading, cached errors."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, GlsimError, MeshError, counted, did_you_mean
from glsim.core.files.contents import content_hash
from glsim.core.files.listing import entries
from glsim.faces.face_source import BadFace, Face, FaceKey, FaceSource
from glsim.faces.meshes.alignment import check_axes, check_unit
from glsim.faces.scans.file_tree import check_root

_T = TypeVar("_T")

#: Largest number of characters of an exception in a message.
_REASON_LENGTH = 120

#: Extensions of files on which a mesh file depends: materials of OBJ, buffers of glTF.
_COMPANIONS = (".mtl", ".bin")


class FileFaces(FaceSource):
    """A source of mesh files below a root folder. Raises ConfigError: bad setting or no root."""

    #: Error message for a root without subjects.
    nothing: ClassVar[str]
    repeats = True

    def __init__(self, root: Path | str, unit: str = "auto", axes: str = "auto") -> None:
        check_unit(unit)
        check_axes(axes)
        self.root = check_root(root, self.name)
        self._unit, self._axes = unit, axes
        self._results: dict[Any, Any] = {}  # cache of read_once: a result or an error
        self._topologies: list[NDArray[np.int32]] = []

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__ | {"_results": {}, "_topologies": []}
        state.pop("people", None)
        return state

    @property
    @abstractmethod
    def people(self) -> Mapping[str, Any]:
        """Files of each subject, in natural order; the tree is listed once."""

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` subjects (None: all). Raises ConfigError if too few."""
        if not self.people:
            raise ConfigError(f"{self.root}: {self.nothing}")
        if count is not None and count > len(self.people):
            raise ConfigError(
                f"{self.root}: has {counted(len(self.people), 'subject')}, {count} asked for"
            )
        return list(self.people)[:count]

    def files_of(self, subject: str) -> Any:
        """Return the files of a subject. Raises ConfigError if the source has no such subject."""
        if subject not in self.people:
            known = did_you_mean(subject, self.people)
            raise ConfigError(f"{self.root}: no subject {subject!r} ({known})")
        return self.people[subject]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Yield a Face per key, or a BadFace if reading its file fails in any way."""
        for key in keys:
            try:
                with one_bad_file(self.root / key.path):
                    face = self._face(key)
            except MeshError as error:
                yield BadFace(key, error)
            else:
                yield face

    @abstractmethod
    def _face(self, key: FaceKey) -> Face:
        """Read the face of a frame. May raise any error."""

    def shared(self, faces: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the earlier array with equal triangles if there is one, otherwise ``faces``."""
        for known in self._topologies:
            if np.array_equal(known, faces):
                return known
        self._topologies.append(faces)
        return faces

    def read_once(self, name: Any, make: Callable[[Any], _T]) -> _T:
        """Return ``make(name)``, computed once; a MeshError is cached and raised again."""
        if name not in self._results:
            try:
                with one_bad_file(name):
                    self._results[name] = make(name)
            except MeshError as error:
                self._results[name] = error
        result: _T | MeshError = self._results[name]
        if isinstance(result, MeshError):
            raise result
        return result


def file_contents(root: Path, paths: Iterable[Path]) -> dict[str, str]:
    """Hash mesh files, and all material and buffer files in their folders: path -> hash."""
    meshes = list(dict.fromkeys(paths))
    folders = dict.fromkeys(path.parent for path in meshes)
    beside = [folder / name for folder in folders for name in entries(folder, _COMPANIONS)[0]]
    return {path.relative_to(root).as_posix(): content_hash(path) for path in [*meshes, *beside]}


@contextmanager
def one_bad_file(file: Path | str) -> Iterator[None]:
    """Convert any exception in the block to a MeshError that names ``file``.

    Errors of glsim pass. A damaged file can make a library raise anything: it may need more memory
    than there is, nest deeper than Python's stack, or name an impossible file.
    """
    try:
        yield
    except GlsimError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:_REASON_LENGTH]
        what = f"{type(error).__name__}: {reason}" if reason else type(error).__name__
        raise MeshError(f"{file}: cannot be used ({what}); mend it, or take it away") from error
