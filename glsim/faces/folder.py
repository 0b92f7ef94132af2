"""Faces from any tree of mesh files.

Layout: a folder directly under the root is a subject; a mesh directly under the root is a subject
of its own, with one frame. The sequence is the path below the subject joined with "-" ("main" if
there is none), the frame the last number in the file's name.

Frames: where the last numbers in the file names of a sequence tell its files apart they are the
frame numbers, otherwise the files are numbered from 0 in natural order ("a2" before "a10").

Names become path-safe words: characters other than ASCII letters, digits, "_", "+" and "-" turn
into "_"; where two names become one word, "~2", "~3" and so on are added in natural order. Hidden
files and folders, links back to a folder on the way down, and files of other kinds are left out.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.canonical import Canonicalisation, check_axes, check_unit
from glsim.errors import ConfigError, MeshError
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.listed import check_subject, first_subjects
from glsim.faces.tree import Words, check_root, is_mesh, last_number, listing, meshes
from glsim.meshio import RawMesh, find_frame, notes_of, read_mesh, sized
from glsim.meshlimits import EXTENSIONS

MAIN_SEQUENCE: Final = "main"
FRAMES_PER_SECOND: Final = 60.0  # D3DFACS and FLAME registrations; only FaceKey.time_s tells


class Folder:
    """A FaceSource over the mesh files below ``root``.

    unit, axes: as for ``load_mesh``. What is "auto" is found on the first good mesh of a subject
        and kept for all of the subject, so that a sequence does not jump.
    recentre: put the origin behind the nose of the first good mesh of each sequence, so that the
        head still moves within a sequence.
    frames_per_second: turns frame numbers into FaceKey.time_s.
    Raises ConfigError for a setting that means nothing, a missing root and a root without meshes.
    """

    name = "folder"

    def __init__(
        self,
        root: Path | str,
        *,
        unit: str = "auto",
        axes: str = "auto",
        recentre: bool = True,
        frames_per_second: float = FRAMES_PER_SECOND,
    ) -> None:
        check_unit(unit)
        check_axes(axes)
        if not frames_per_second > 0:
            raise ConfigError(f"frames_per_second={frames_per_second}: must be above 0")
        self.root = check_root(root)
        self._unit, self._axes, self._recentre = unit, axes, recentre
        self._frames_per_second = frames_per_second
        self._frames_found: dict[tuple[str, str], Canonicalisation | MeshError] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be found again."""
        state = self.__dict__ | {"_frames_found": {}}
        state.pop("_keys", None)
        return state

    def subjects(self, count: int | None) -> list[str]:
        """The first ``count`` subjects in natural order. Raises ConfigError: fewer than that."""
        nothing = f"no mesh in it or below it ({', '.join(EXTENSIONS)} are read)"
        return first_subjects(self.root, self._keys, count, nothing)

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """The first ``count`` frames of a subject, sequence by sequence. Raises ConfigError."""
        check_subject(self.root, subject, self._keys)
        return self._keys[subject][:count]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Read one mesh a key. Neighbours of one topology share one ``faces`` array."""
        shared: NDArray[np.int32] | None = None
        for key in keys:
            try:
                raw = self._read(key)
                frame = self._frame_of(key)
                mesh = sized(self.root / key.path, raw.to_mesh(frame))
            except MeshError as error:
                yield BadFace(key, error)
                continue
            if shared is not None and np.array_equal(shared, mesh.faces):
                mesh = replace(mesh, faces=shared)
            shared = mesh.faces
            yield Face(key, mesh, notes=notes_of(raw, frame) | self._notes(key))

    def _read(self, key: FaceKey) -> RawMesh:
        return read_mesh(self.root / key.path)

    def _find(self, path: Path, raw: RawMesh, unit: str, axes: str) -> Canonicalisation:
        return find_frame(path, raw, unit=unit, axes=axes, recentre=self._recentre)

    def _notes(self, key: FaceKey) -> dict[str, object]:
        return {}

    def _frame_of(self, key: FaceKey) -> Canonicalisation:
        """Unit, axes and winding of the subject, origin of the sequence. Raises MeshError."""
        keys = self.frames(key.subject, None)
        subject = self._first_found(key.subject, "", keys, self._unit, self._axes)
        if not self._recentre:
            return subject
        keys = [other for other in keys if other.sequence == key.sequence]
        unit = str(subject.mm_per_unit)
        sequence = self._first_found(key.subject, key.sequence, keys, unit, subject.axes)
        return replace(subject, origin_mm=sequence.origin_mm)

    def _first_found(
        self, subject: str, sequence: str, keys: list[FaceKey], unit: str, axes: str
    ) -> Canonicalisation:
        """The frame of the first mesh that has one; if none has, the first mesh's error again."""
        place = (subject, sequence)
        for key in [] if place in self._frames_found else keys:
            path = self.root / key.path
            try:
                self._frames_found[place] = self._find(path, self._read(key), unit, axes)
                break
            except MeshError as error:
                self._frames_found.setdefault(place, error)
        found = self._frames_found[place]
        if isinstance(found, MeshError):
            raise found
        return found

    @cached_property
    def _keys(self) -> dict[str, list[FaceKey]]:
        """Subject -> its frames; lists the tree once."""
        found: dict[str, list[FaceKey]] = {}
        words = Words()
        for name in listing(self.root):
            path = self.root / name
            if path.is_dir():
                files = list(meshes(path, (os.path.realpath(self.root),)))
            else:
                files = [path] if is_mesh(path) else []
            if files:
                subject = words.unique(name if path.is_dir() else path.stem)
                found[subject] = self._sequences(subject, path, files)
        return found

    def _sequences(self, subject: str, top: Path, files: list[Path]) -> list[FaceKey]:
        by_folder: dict[Path, list[Path]] = {}
        for path in files:
            by_folder.setdefault(path.parent, []).append(path)
        keys = []
        words = Words()
        for folder, members in by_folder.items():
            below = "" if folder == top.parent else "-".join(folder.relative_to(top).parts)
            sequence = words.unique(below or MAIN_SEQUENCE)
            numbers = [last_number(path.stem) for path in members]
            known = [number for number in numbers if number is not None]
            if len(set(known)) != len(members):
                known = list(range(len(members)))
            for number, path in sorted(zip(known, members, strict=True)):
                time_s = (number - min(known)) / self._frames_per_second
                name = path.relative_to(self.root).as_posix()
                keys.append(FaceKey(subject, sequence, number, time_s, name))
        return keys
