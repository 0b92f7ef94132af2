"""D3DFACS: FLAME registrations and raw recordings of people who perform FACS action units.

    <Subject>/<AU+AU>/<AU+AU>_<frame>.ply         FLAME registrations (Li et al. 2017), metres
    <Subject>/.../<AU+AU>.../*<frame>*.obj        raw 3dMD frames (Cosker et al. 2011), millimetres

Both are recorded 60 times a second, with +y up and +z out of the face; a folder of the name
``d3dfacs_alignments`` below the root is entered. A raw frame is two half-face patches, in one OBJ
or in two whose names tell left from right; its topology is its own. Gaps in the numbers stay.

The peak: registrations share their topology, so the peak of a sequence is the frame whose
vertices, after the head's motion is taken out, lie farthest from those of its first frame. Raw
frames cannot be compared like that: theirs is the middle frame (the performances run from neutral
to neutral), and the notes say so.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.canonical import Canonicalisation
from glsim.errors import ConfigError, MeshError
from glsim.faces.base import FaceKey
from glsim.faces.folder import Folder
from glsim.meshio import RawMesh, find_known_frame, merged, read_mesh

AXES: Final = "+x+y+z"
REGISTRATIONS: Final = "d3dfacs_alignments"

_CODE: Final = re.compile(r"\d+[LR]?(?:\+\d+[LR]?)*", re.ASCII)
_SIDE: Final = re.compile(r"(?<![a-z])(left|right)(?![a-z])|(?<=[_.-])([lr])(?=[_.-]|$)", re.I)


class D3dfacs(Folder):
    """A FaceSource over D3DFACS as it lies on the disk.

    every: take one frame in so many of each sequence, from its first.
    peak_only: take only the frame of each sequence where the face is farthest from its first.
    unit, axes: override the format's (registrations: metres; raw: found by size; axes +x+y+z).
    Raises ConfigError as Folder does.
    """

    name = "d3dfacs"

    def __init__(
        self,
        root: Path | str,
        *,
        unit: str = "auto",
        axes: str = "auto",
        every: int = 1,
        peak_only: bool = False,
    ) -> None:
        if every < 1:
            raise ConfigError(f"every={every}: take one frame in 1 or more")
        root = Path(root)
        below = root / REGISTRATIONS
        super().__init__(below if below.is_dir() else root, unit=unit, axes=axes)
        self._every, self._peak_only = every, peak_only
        self._patches: dict[str, list[str]] = {}
        self._taken: dict[str, list[FaceKey]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be found again."""
        return super().__getstate__() | {"_patches": {}, "_taken": {}}

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """The first ``count`` frames of a subject that ``every`` and ``peak_only`` leave."""
        if subject not in self._taken:
            keys = super().frames(subject, None)
            sequences = [list(group) for _, group in groupby(keys, key=lambda key: key.sequence)]
            self._taken[subject] = [
                key
                for sequence in sequences
                for key in ([self._peak(sequence)] if self._peak_only else sequence[:: self._every])
            ]
        return self._taken[subject][:count]

    def _sequences(self, subject: str, top: Path, files: list[Path]) -> list[FaceKey]:
        whole: dict[tuple[Path, str], list[Path]] = {}
        for path in files:
            side_free = _SIDE.sub("", path.stem) if path.suffix.lower() == ".obj" else path.name
            whole.setdefault((path.parent, side_free), []).append(path)
        for first, *others in whole.values():
            name = first.relative_to(self.root).as_posix()
            self._patches[name] = [other.relative_to(self.root).as_posix() for other in others]
        return super()._sequences(subject, top, [paths[0] for paths in whole.values()])

    def _read(self, key: FaceKey) -> RawMesh:
        self.subjects(None)  # lists the tree: which patches belong together
        names = [key.path, *self._patches.get(key.path, [])]
        return merged([read_mesh(self.root / name) for name in names])

    def _find(self, path: Path, raw: RawMesh, unit: str, axes: str) -> Canonicalisation:
        given = "m" if unit == "auto" and path.suffix.lower() == ".ply" else unit
        return find_known_frame(
            path,
            raw,
            unit=given,
            axes=axes,
            format_axes=AXES,
            recentre=self._recentre,
        )

    def _notes(self, key: FaceKey) -> dict[str, object]:
        units = action_units(key.sequence)
        notes: dict[str, object] = {"action_units": units}
        if len(self._patches.get(key.path, [])):
            notes["patches"] = [key.path, *self._patches[key.path]]
        if self._peak_only:
            notes["peak"] = "measured" if _is_registration(key) else "middle of the sequence"
        return notes

    def _peak(self, keys: list[FaceKey]) -> FaceKey:
        if not all(map(_is_registration, keys)):
            return keys[len(keys) // 2]
        return max(zip(self._motions(keys), keys, strict=True), key=lambda pair: pair[0])[1]

    def _motions(self, keys: Iterable[FaceKey]) -> list[float]:
        """Mean distance of each frame's vertices from the first good frame's; -1 for a bad one."""
        first: RawMesh | None = None
        motions = []
        for key in keys:
            try:
                raw = read_mesh(self.root / key.path)
            except MeshError:
                motions.append(-1.0)
                continue
            first = first or raw
            same = raw.vertices.shape == first.vertices.shape
            motions.append(deformation(first.vertices, raw.vertices) if same else -1.0)
        return motions


def action_units(sequence: str) -> list[str]:
    """FACS codes of a sequence's name: "1+2L" is ["1", "2L"]; empty if there are none."""
    names = [part for part in sequence.split("-") if _CODE.search(part)]
    found = _CODE.search(names[-1]) if names else None
    return found[0].split("+") if found else []


def deformation(first: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Mean distance (N, 3) to (N, 3) after the best rigid motion (Kabsch 1976), in their unit."""
    a, b = first - first.mean(axis=0), other - other.mean(axis=0)
    left, _, right = np.linalg.svd(b.T @ a)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    return float(np.linalg.norm(b @ (left @ mirror @ right) - a, axis=1).mean())


def _is_registration(key: FaceKey) -> bool:
    return key.path.lower().endswith(".ply")
