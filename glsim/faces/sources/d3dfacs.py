"""Reader of D3DFACS: FLAME registrations and raw scans of people who perform action units.

    <Subject>/<AU+AU>/<AU+AU>_<frame>.ply         FLAME registrations (Li et al. 2017), metres
    <Subject>/.../<AU+AU>.../*<frame>*.obj        raw 3dMD frames (Cosker et al. 2011), millimetres

Both have 60 frames per second, with +y up and +z out of the face. A folder ``d3dfacs_alignments``
below the root is used as the root. A raw frame is two half-face patches, in one OBJ or in two whose
names distinguish left and right; each frame has its own topology. Gaps in frame numbers are kept.

Peak: registrations share one topology, so the peak of a sequence is the frame with the largest
deformation from the first frame, without the rigid motion of the head. The peak of raw frames,
whose topologies differ, is the middle frame (performances run from neutral to neutral), as noted.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from glsim.core.errors import ConfigError, MeshError
from glsim.faces.face_source import FaceKey, FaceSource, MeshFileSettings
from glsim.faces.meshes.alignment import Alignment, Turns
from glsim.faces.meshes.load import FileMesh, find_alignment_in_format, read_mesh
from glsim.faces.scans.file_source import one_bad_file
from glsim.faces.sources.folder import Folder

AXES: Final = "+x+y+z"
REGISTRATIONS: Final = "d3dfacs_alignments"

_CODE: Final = re.compile(r"\d+[LR]?(?:\+\d+[LR]?)*", re.ASCII)
_SIDE: Final = re.compile(r"(?<![a-z])(left|right)(?![a-z])|(?<=[_.-])([lr])(?=[_.-]|$)", re.I)


class D3dfacsSettings(MeshFileSettings):
    """D3DFACS in its original layout: FLAME registrations or raw scans."""

    every: int | None = Field(None, ge=1, description="take every n-th frame")
    peak_only: bool | None = Field(None, description="only the peak of each sequence")

    def open(self, seed: int) -> FaceSource:
        """Open the set. Raises ConfigError without meshes."""
        return D3dfacs(self.folder, self.unit, self.axes, self.every or 1, bool(self.peak_only))

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Return 0.5 if a folder named by action units holds meshes, else 0."""
        named = (folder for folder in folders if _CODE.fullmatch(folder.name))
        return 0.5 if any(any(folder.glob("*.[op][bl][jy]")) for folder in named) else 0.0


class D3dfacs(Folder):
    """The face source of D3DFACS in its original layout. Raises ConfigError as Folder does.

    By default registrations are in metres, raw scans in what their size says; axes are +x+y+z.
    """

    name = "d3dfacs"

    def __init__(
        self, root: Path | str, unit: str = "auto", axes: str = "auto", every: int = 1,
        peak_only: bool = False,
    ) -> None:  # fmt: skip
        root = Path(root)
        below = root / REGISTRATIONS
        super().__init__(below if below.is_dir() else root, unit=unit, axes=axes)
        self._every, self._peak_only = every, peak_only
        self._patches: dict[str, list[str]] = {}

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_patches": {}}

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return a subject's first ``count`` keys, selected by ``every`` and ``peak_only``."""
        return self.read_once(("frames", subject), lambda _: self._choose(subject))[:count]

    def _choose(self, subject: str) -> list[FaceKey]:
        keys = super().frames(subject, None)
        sequences = [list(group) for _, group in groupby(keys, key=lambda key: key.sequence)]
        if self._peak_only:
            return [self._peak(sequence) for sequence in sequences]
        return [key for sequence in sequences for key in sequence[:: self._every]]

    def _sequences(self, subject: str, top: Path, files: list[Path]) -> list[FaceKey]:
        """Return the keys of a subject's frames; two patches of a raw scan are one frame."""
        if top in files:
            raise ConfigError(f"{top}: D3DFACS has folders of subjects: --source folder takes it")
        frames: dict[tuple[Path, str], list[Path]] = {}
        for path in files:
            both = _SIDE.sub("", path.stem) if path.suffix.lower() == ".obj" else path.name
            frames.setdefault((path.parent, both), []).append(path)
        for first, *others in frames.values():
            name = first.relative_to(self.root).as_posix()
            self._patches[name] = [other.relative_to(self.root).as_posix() for other in others]
        return super()._sequences(subject, top, [paths[0] for paths in frames.values()])

    def _paths(self, key: FaceKey) -> list[Path]:
        self.subjects(None)  # lists the tree, which fills _patches
        return [self.root / name for name in (key.path, *self._patches.get(key.path, []))]

    def _align(
        self, path: Path, file_mesh: FileMesh, unit: str, axes: str, turns: Turns | None
    ) -> Alignment:
        unit = "m" if unit == "auto" and path.suffix.lower() == ".ply" else unit
        return find_alignment_in_format(path, file_mesh, unit=unit, axes=axes, format_axes=AXES)

    def _notes(self, key: FaceKey) -> dict[str, object]:
        notes: dict[str, object] = {"action_units": action_units(key.sequence)}
        if len(self._patches.get(key.path, [])):
            notes["patches"] = [key.path, *self._patches[key.path]]
        if self._peak_only:
            notes["peak"] = "measured" if _is_registration(key) else "middle of the sequence"
        return notes

    def _peak(self, keys: list[FaceKey]) -> FaceKey:
        """Return the key of a sequence's peak frame (see the module docstring)."""
        if not all(map(_is_registration, keys)):
            return keys[len(keys) // 2]
        return max(zip(self._deformations(keys), keys, strict=True), key=lambda pair: pair[0])[1]

    def _deformations(self, keys: Iterable[FaceKey]) -> list[float]:
        """Measure the deformation of each frame from the first valid frame; -1 if invalid."""
        first: FileMesh | None = None
        deformations = []
        for key in keys:
            try:
                with one_bad_file(self.root / key.path):
                    mesh = read_mesh(self.root / key.path)
            except MeshError:
                deformations.append(-1.0)
                continue
            first = first or mesh
            same = mesh.vertices.shape == first.vertices.shape
            deformations.append(deformation(first.vertices, mesh.vertices) if same else -1.0)
        return deformations


def action_units(sequence: str) -> list[str]:
    """Parse the FACS codes in a sequence's name: "1+2L" gives ["1", "2L"]; [] without codes."""
    names = [part for part in sequence.split("-") if _CODE.search(part)]
    code = _CODE.search(names[-1]) if names else None
    return code[0].split("+") if code else []


def deformation(first: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Measure the mean distance of point sets (N, 3) after rigid alignment (Kabsch 1976)."""
    a, b = first - first.mean(axis=0), other - other.mean(axis=0)
    left, _, right = np.linalg.svd(b.T @ a)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    return float(np.linalg.norm(b @ (left @ mirror @ right) - a, axis=1).mean())


def _is_registration(key: FaceKey) -> bool:
    return key.path.lower().endswith(".ply")
