"""The protocol of face sources: they list frames cheaply, and load meshes in a later step."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from glsim.core.errors import ConfigError, MeshError, counted
from glsim.core.mesh import Mesh
from glsim.faces.neck import Neck
from glsim.settings.source_settings import SourceSettings


@dataclass(frozen=True)
class FaceKey:
    """The identifier of a frame in a source; with the source's seed it determines the geometry.

    Args:
        subject, sequence: path-safe words, unique in the source.
        frame: number within the sequence, from 0 (or the number in the file's name).
        time_s: seconds since the start of the sequence.
        path: the mesh file, relative to the source's root; "" for generated geometry.
    """

    subject: str
    sequence: str
    frame: int
    time_s: float = 0.0
    path: str = ""


class ComputedKeys(Sequence[FaceKey]):
    """A sequence of a subject's FaceKeys that computes each key from its number, on access.

    No two keys have the same sequence and frame.

    ``words``: all values on which the keys depend.
    """

    def __init__(self, count: int, *words: object) -> None:
        self._count, self.words = count, words

    def __len__(self) -> int:
        return self._count

    @abstractmethod
    def _key(self, number: int) -> FaceKey:
        """Compute the key of frame ``number``, from 0."""

    @overload
    def __getitem__(self, number: int) -> FaceKey: ...
    @overload
    def __getitem__(self, number: slice) -> list[FaceKey]: ...
    def __getitem__(self, number: int | slice) -> FaceKey | list[FaceKey]:
        """Compute a key, or a list of them."""
        if isinstance(number, slice):
            return [self._key(position) for position in range(*number.indices(len(self)))]
        position = number + len(self) if number < 0 else number
        if not 0 <= position < len(self):
            raise IndexError(f"it has {counted(len(self), 'frame')}, not one at {number}")
        return self._key(position)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True, eq=False)
class WornPart:
    """A mesh of hair, glasses or cloth in the axes of the face; ``region`` labels all of it."""

    mesh: Mesh
    region: str


@dataclass(frozen=True, eq=False)
class Face:
    """The meshes and metadata of one frame.

    ``expression``: action unit or blend shape -> intensity in [0, 1], without zeros; ``notes``:
    for the manifest (JSON values only); ``neck`` bends as the head turns; None: all of it turns.
    """

    key: FaceKey
    mesh: Mesh
    expression: Mapping[str, float] = field(default_factory=dict)
    notes: Mapping[str, object] = field(default_factory=dict)
    parts: tuple[WornPart, ...] = ()
    neck: Neck | None = None


@dataclass(frozen=True)
class BadFace:
    """A frame whose mesh cannot be used, with its error."""

    key: FaceKey
    error: MeshError


@dataclass(frozen=True, eq=False)
class Topology:
    """The triangles, regions and landmarks that all meshes of a source share.

    Triangles (F, 3) int32; ``regions`` (V,) uint8 indices into ``region_names``, and (68,) int64
    vertices of landmarks in the order of ``glsim.faces.regions``, or None.
    """

    triangles: NDArray[np.int32]
    regions: NDArray[np.uint8] | None = None
    region_names: tuple[str, ...] = ()
    landmarks: NDArray[np.int64] | None = None


class FaceSource(Protocol):
    """Base class of face sources; a source must be picklable, and cheap before ``load``."""

    name: str
    #: Whether a plan repeats the meshes of a subject with too few frames.
    repeats: bool = False

    @property
    def topology(self) -> Topology | None:
        """Triangles, regions and landmarks that all meshes share; None if they differ."""
        return None

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` subjects; None: all (ConfigError from endless sources)."""
        ...

    def frames(self, subject: str, count: int | None) -> Sequence[FaceKey]:
        """Return the FaceKeys of a subject's first ``count`` frames, in order; None: all.

        An endless source returns ``ComputedKeys``, so that large plans need no memory.
        """
        ...

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Yield a Face or BadFace per key, in order; source settings and key alone decide it."""
        ...

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Return the hashes of all files that these subjects' frames depend on: name -> hash.

        A data set is not resumed after a change (see ``glsim.core.files.contents``).
        """
        return {}


class FaceSettings(SourceSettings):
    """Base class of the [[source]] tables; derive a class from it to add a kind of source.

    Fields of the derived class are settings of the kind; its docstring is the help.
    """

    @abstractmethod
    def open(self, seed: int) -> FaceSource:
        """Open the source; only generated faces use ``seed``. Raises ConfigError."""

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Return the confidence, 0 to 1, that a folder holds faces of this kind.

        ``folders``: some of the folders below it, up to four levels deep.
        """
        return 0.0

    @property
    def folder(self) -> Path:
        """Root folder of the source. Raises ConfigError if the table has none."""
        if self.root is None:
            raise ConfigError(f"source {self.kind!r} needs --root: the folder with its files")
        return self.root


class MeshFileSettings(FaceSettings):
    """The [[source]] table of a source that reads mesh files."""

    unit: str = Field(
        "auto", description="such as cm or inch, or in mm", coerce_numbers_to_str=True
    )
    axes: str = Field("auto", description="axes of the meshes, e.g. +x+y+z; auto: detected")
