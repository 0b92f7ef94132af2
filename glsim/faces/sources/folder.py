"""Reader of faces in any tree of mesh files.

Layout: each folder directly below the root is a subject; each mesh directly below the root is a
subject with one frame. The sequence is the path below the subject joined with "-" ("main" if
empty), the frame is the last number in the file's name.

Frames: if the last numbers in the file names of a sequence are unique, they are the frame numbers;
otherwise the files are numbered from 0 in natural order ("a2" before "a10").

Names become path-safe: characters other than ASCII letters, digits, "_", "+" and "-" become "_";
duplicates get the suffixes "~2", "~3" and so on in natural order. Hidden files and folders, links
back to a parent folder, and files of other types are skipped.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import Field

from glsim.core.errors import ConfigError, MeshError, did_you_mean
from glsim.core.files.listing import entries, files_below, natural
from glsim.faces.face_source import Face, FaceKey, FaceSource, MeshFileSettings
from glsim.faces.meshes import load
from glsim.faces.meshes.alignment import Alignment, Turns, check_axes, check_unit
from glsim.faces.meshes.obj import EXTENSIONS
from glsim.faces.scans.file_source import FileFaces, file_contents, one_bad_file
from glsim.faces.scans.file_tree import last_number, unique_name
from glsim.settings.toml_tables import TomlTable

MAIN_SEQUENCE: Final = "main"
FRAMES_PER_SECOND: Final = 60.0  # D3DFACS and FLAME registrations; affects FaceKey.time_s only


class Placement(TomlTable):
    """Unit and pose of one mesh or of all meshes of a folder; what is not set: the source's."""

    unit: str | None = Field(None, description="as source.unit", coerce_numbers_to_str=True)
    axes: str | None = Field(None, description="as source.axes")
    rotation_deg: Turns | None = Field(None, description="as source.rotation_deg")


class FolderSettings(MeshFileSettings):
    """Any tree of OBJ, PLY, STL, GLB or OFF files, one folder per subject."""

    rotation_deg: Turns | None = Field(
        None,
        description="turns about x (left), y (up) and z (forward) after axes, degrees, in this "
        "order; default: found if axes is auto",
    )
    overrides: dict[str, Placement] = Field(
        {}, description="unit, axes, rotation_deg of single meshes or folders, by path below root"
    )

    def open(self, seed: int) -> FaceSource:
        """Open the tree. Raises ConfigError without meshes."""
        return Folder(self.folder, self.unit, self.axes, self.rotation_deg, self.overrides)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Return 0.1, so that this source is chosen only if no other source fits."""
        return 0.1


class Folder(FileFaces):
    """The face source of all mesh files below ``root``. Raises ConfigError without a mesh.

    The origin is behind the nose of the first valid mesh of each sequence, so that the head still
    moves within a sequence.

    Args:
        unit, axes, rotation_deg: see ``load_mesh``. For "auto", they are found on the first valid
            mesh of a subject and used for all its meshes, so that a sequence does not jump.
        overrides: path of a mesh or folder below ``root`` -> unit and pose; the longest counts.
    """

    name = "folder"
    nothing = f"no mesh in it or below it ({', '.join(EXTENSIONS)} are read)"

    def __init__(
        self, root: Path | str, unit: str = "auto", axes: str = "auto",
        rotation_deg: Turns | None = None, overrides: Mapping[str, Placement] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(root, unit, axes)
        self._turns = rotation_deg
        self._bad: dict[str, MeshError] = {}
        self._overrides = {path.strip("/"): placed for path, placed in (overrides or {}).items()}
        for placed in self._overrides.values():
            check_unit(placed.unit or unit)
            check_axes(placed.axes or axes)

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` subjects (None: all). Raises ConfigError."""
        paths = [key.path for keys in self.people.values() for key in keys]
        for path in self._overrides:
            if not any(_is_below(mesh, path) for mesh in paths):
                known = did_you_mean(path, paths)
                raise ConfigError(f"source.overrides: no mesh {path!r} in {self.root} ({known})")
        return super().subjects(count)

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return the keys of a subject's first ``count`` frames. Raises ConfigError."""
        keys: list[FaceKey] = self.files_of(subject)
        return keys[:count]

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Hash all mesh files of these subjects: file -> hash."""
        keys = (key for subject in subjects for key in self.frames(subject, None))
        return file_contents(self.root, (path for key in keys for path in self._paths(key)))

    def _face(self, key: FaceKey) -> Face:
        """Return a frame's face; consecutive meshes of one topology share one ``faces`` array."""
        if (known := self._bad.get(key.path)) is not None:
            raise known  # a plan repeats a mesh; what is hopeless is tried once
        try:
            with one_bad_file(self.root / key.path):
                file_mesh, alignment = self._read(key), self._alignment_of(key)
                mesh = file_mesh.to_mesh(alignment)
                mesh = load.check_head_size(self.root / key.path, mesh, alignment)
        except MeshError as error:
            self._bad[key.path] = error
            raise
        if self._topologies and np.array_equal(self._topologies[0], mesh.faces):
            mesh = replace(mesh, faces=self._topologies[0])
        self._topologies = [mesh.faces]
        return Face(key, mesh, notes=load.manifest_notes(file_mesh, alignment) | self._notes(key))

    def _paths(self, key: FaceKey) -> list[Path]:
        return [self.root / key.path]

    def _read(self, key: FaceKey) -> load.FileMesh:
        return load.merge_patches([load.read_mesh(path) for path in self._paths(key)])

    def _align(
        self, path: Path, file_mesh: load.FileMesh, unit: str, axes: str, turns: Turns | None
    ) -> Alignment:
        return load.find_alignment(path, file_mesh, unit, axes, turns)

    def _notes(self, key: FaceKey) -> dict[str, object]:
        return {}

    def _alignment_of(self, key: FaceKey) -> Alignment:
        """Combine the subject's alignment with the origin of the sequence. Raises MeshError."""
        override = self._override(key)
        placed = self._overrides.get(override, Placement())
        turns = self._turns if placed.axes is None else None
        given = (
            placed.unit or self._unit,
            placed.axes or self._axes,
            turns if placed.rotation_deg is None else placed.rotation_deg,
        )
        keys = [k for k in self.frames(key.subject, None) if self._override(k) == override]
        subject = self._first_alignment((key.subject, override), keys, *given)
        keys = [other for other in keys if other.sequence == key.sequence]
        found = str(subject.mm_per_unit), subject.axes, subject.rotation_deg
        sequence = self._first_alignment((key.subject, override, key.sequence), keys, *found)
        return replace(subject, origin_mm=sequence.origin_mm)

    def _override(self, key: FaceKey) -> str:
        """Return the longest path of an override that holds this mesh, "" without."""
        return max((p for p in self._overrides if _is_below(key.path, p)), key=len, default="")

    def _first_alignment(
        self, name: tuple[str, ...], keys: list[FaceKey], unit: str, axes: str, turns: Turns | None
    ) -> Alignment:
        """Return the alignment of the first valid mesh; without one, raise the first error."""

        def first(_: object) -> Alignment:
            errors: list[MeshError] = []
            for key in keys:
                path = self.root / key.path
                try:
                    with one_bad_file(path):
                        return self._align(path, self._read(key), unit, axes, turns)
                except MeshError as error:
                    errors.append(error)
            raise errors[0] if errors else MeshError(f"{self.root}: {name[0]} has no mesh")

        return self.read_once(name, first)

    @cached_property
    def people(self) -> dict[str, list[FaceKey]]:
        """Keys of each subject's frames; the tree is listed once."""
        keys: dict[str, list[FaceKey]] = {}
        names, root = Counter[str](), os.path.realpath(self.root)
        single, folders = entries(self.root, EXTENSIONS)
        trees = {name: files_below(self.root / name, EXTENSIONS, {root}) for name in folders}
        for name in sorted([*single, *folders], key=natural):
            path = self.root / name
            if files := list(trees.get(name, [path])):
                subject = unique_name(name if name in trees else path.stem, names)
                keys[subject] = self._sequences(subject, path, files)
        return keys

    def _sequences(self, subject: str, top: Path, files: list[Path]) -> list[FaceKey]:
        """Return the keys of a subject's frames; ``top`` is its folder or its only file."""
        by_folder: dict[Path, list[Path]] = {}
        for path in files:
            by_folder.setdefault(path.parent, []).append(path)
        keys = []
        names: Counter[str] = Counter()
        for folder, members in by_folder.items():
            below = "" if folder == top.parent else "-".join(folder.relative_to(top).parts)
            sequence = unique_name(below or MAIN_SEQUENCE, names)
            numbers = [last_number(path.stem) for path in members]
            known = [number for number in numbers if number is not None]
            if len(set(known)) != len(members):
                known = list(range(len(members)))
            for number, path in sorted(zip(known, members, strict=True)):
                time_s = (number - min(known)) / FRAMES_PER_SECOND
                name = path.relative_to(self.root).as_posix()
                keys.append(FaceKey(subject, sequence, number, time_s, name))
        return keys


def _is_below(path: str, folder: str) -> bool:
    return path == folder or path.startswith(f"{folder}/")
