"""What a face source is: it lists frames cheaply, and makes their geometry on demand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from glsim.errors import MeshError
from glsim.mesh import Mesh


@dataclass(frozen=True)
class FaceKey:
    """Names one frame of one source. With the source's seed it determines the geometry.

    subject, sequence: path-safe words, unique in the source.
    frame: number within the sequence, from 0 (or the number in the file's name).
    time_s: seconds since the start of the sequence.
    path: the mesh file, relative to the source's root; "" where the source makes its geometry.
    """

    subject: str
    sequence: str
    frame: int
    time_s: float = 0.0
    path: str = ""


@dataclass(frozen=True, eq=False)
class Face:
    """The geometry of one frame and what is known about it.

    expression: action unit or blend shape -> intensity in [0, 1]; zeros left out.
    notes: anything else for the manifest (JSON values only), such as the unit that was found.
    """

    key: FaceKey
    mesh: Mesh
    expression: Mapping[str, float] = field(default_factory=dict)
    notes: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class BadFace:
    """A frame whose mesh cannot be used, and why."""

    key: FaceKey
    error: MeshError


class FaceSource(Protocol):
    """A supply of faces. Implementations are picklable, and cheap until ``load`` is called."""

    name: str

    def subjects(self, count: int | None) -> list[str]:
        """The first ``count`` subjects (None: all, where the source has an end)."""
        ...

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """The first ``count`` frames of a subject, in order (None: all), without geometry."""
        ...

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """One result a key, in order. A function of (source settings, key) alone."""
        ...
