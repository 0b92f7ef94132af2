"""The source ``board``: flat boards, as used to calibrate and compare depth cameras."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar, Final

import numpy as np
from pydantic import Field

from glsim.core.errors import ConfigError
from glsim.core.mesh import Mesh
from glsim.faces.face_source import ComputedKeys, Face, FaceKey, FaceSettings, FaceSource


class BoardSettings(FaceSettings):
    """Flat boards in place of faces, as calibration targets of cameras."""

    endless: ClassVar[bool] = True

    width_mm: float = Field(160.0, ge=5, le=10_000, description="width of the board, mm")
    height_mm: float = Field(220.0, ge=5, le=10_000, description="height of the board, mm")

    def open(self, seed: int) -> FaceSource:
        """Open the source; ``seed`` is ignored."""
        return Board(self.width_mm, self.height_mm)


#: Name of the sequence of a board's frames, which differ by noise and pose.
_SEQUENCE: Final = "board"


class _BoardKeys(ComputedKeys):
    """The keys of a board's frames, numbered from 0."""

    def __init__(self, subject: str, count: int) -> None:
        super().__init__(count, subject, count)
        self._subject = subject

    def _key(self, number: int) -> FaceKey:
        return FaceKey(self._subject, _SEQUENCE, number)


class Board(FaceSource):
    """A source of endless identical boards "b0000", "b0001", ..., which differ in pose and noise.

    The board faces the front, with its middle at the origin: ``pose.distance_mm`` is its distance.
    """

    name = "board"

    def __init__(self, width_mm: float, height_mm: float) -> None:
        self.width_mm, self.height_mm = width_mm, height_mm

    def subjects(self, count: int | None) -> list[str]:
        """Return the names of the first ``count`` boards. Raises ConfigError for None (endless)."""
        if count is None:
            raise ConfigError("boards never end: set source.subjects")
        return [f"b{number:04d}" for number in range(count)]

    def frames(self, subject: str, count: int | None) -> Sequence[FaceKey]:
        """Return the keys of a board's first ``count`` frames. Raises ConfigError for None."""
        if count is None:
            raise ConfigError("boards never end: set source.frames_per_subject")
        return _BoardKeys(subject, count)

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        """Yield a Face with the board's mesh for each key."""
        half = np.array([self.width_mm, self.height_mm, 0.0]) / 2
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
        mesh = Mesh(corners.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        yield from (Face(key, mesh) for key in keys)
