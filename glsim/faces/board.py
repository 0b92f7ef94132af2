"""A flat board in place of a face: what depth cameras are calibrated and compared on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from glsim.errors import ConfigError
from glsim.faces.base import ComputedKeys, Face, FaceKey
from glsim.faces.one_mesh import OneMesh
from glsim.geometry.mesh import Mesh

#: A sequence of a board's frames; they differ by their noise and pose.
_SEQUENCE: Final = "board"


class _BoardKeys(ComputedKeys):
    """The frames of a board, numbered from 0."""

    def __init__(self, subject: str, count: int) -> None:
        self._subject, self._count = subject, count

    @property
    def words(self) -> tuple[object, ...]:
        """The arguments."""
        return self._subject, self._count

    def __len__(self) -> int:
        return self._count

    def _key(self, number: int) -> FaceKey:
        return FaceKey(self._subject, _SEQUENCE, number)


class Board:
    """A FaceSource of endless equal boards "b0000", "b0001", ...; pose and noise tell them apart.

    The board faces the front, with its middle at the origin: ``pose.distance_mm`` is its distance.

    Args:
        width_mm, height_mm: its sides.

    Raises:
        ConfigError: a side that is not above 0.
    """

    name = "board"

    def __init__(self, width_mm: float, height_mm: float) -> None:
        if not (width_mm > 0 and height_mm > 0):
            raise ConfigError(f"a board of {width_mm:g} x {height_mm:g} mm: give sides above 0")
        self.width_mm, self.height_mm = width_mm, height_mm

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` boards. Raises ConfigError for None: they are endless."""
        if count is None:
            raise ConfigError("boards never end: give a number of subjects")
        return [f"b{number:04d}" for number in range(count)]

    def frames(self, subject: str, count: int | None) -> Sequence[FaceKey]:
        """Return the first ``count`` frames of a board. Raises ConfigError for None."""
        if count is None:
            raise ConfigError("boards never end: give a number of frames per subject")
        return _BoardKeys(subject, count)

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        """Yield the board for each key."""
        half = np.array([self.width_mm, self.height_mm, 0.0]) / 2
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
        faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
        yield from OneMesh(Mesh(corners.astype(np.float32), faces)).load(keys)
