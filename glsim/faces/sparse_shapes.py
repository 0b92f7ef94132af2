"""Sparse blend shapes, each of which moves few vertices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class SparseShapes:
    """A table of named blend shapes, each with the offsets of some points.

    Args:
        names: (N,).
        starts: (N + 1,) int64: shape n has the entries from starts[n] to before starts[n + 1].
        points: (E,) int32.
        offsets_mm: (E, 3) float32.
    """

    names: tuple[str, ...]
    starts: NDArray[np.int64]
    points: NDArray[np.int32]
    offsets_mm: NDArray[np.float32]

    @classmethod
    def join(
        cls, shapes: Iterable[tuple[str, NDArray[np.integer], NDArray[np.floating]]]
    ) -> SparseShapes:
        """Build the table from (name, points (E,), offsets in mm (E, 3)) of each shape."""
        names, points, offsets = zip(*shapes, strict=True)
        return cls(
            tuple(names),
            np.cumsum([0, *map(len, points)]),
            np.concatenate(points).astype(np.int32),
            np.concatenate(offsets).astype(np.float32),
        )

    def arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """Return the table as arrays "PREFIX_names", "PREFIX_starts", ..., to store in a file."""
        arrays = {"names": np.array(self.names), "starts": self.starts, "points": self.points}
        arrays["mm"] = self.offsets_mm
        return {f"{prefix}_{name}": array for name, array in arrays.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], prefix: str) -> SparseShapes:
        """Build the table from arrays made by ``arrays`` with the same prefix."""
        names, *table = (arrays[f"{prefix}_{name}"] for name in ("names", "starts", "points", "mm"))
        return cls(tuple(names.tolist()), *table)

    @cached_property
    def _number(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.names)}

    def __contains__(self, name: object) -> bool:
        return name in self._number

    def shape(self, name: str) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return the points (E,) and offsets (E, 3) mm of a shape. Raises KeyError."""
        number = self._number[name]
        entries = slice(self.starts[number], self.starts[number + 1])
        return self.points[entries], self.offsets_mm[entries]

    def add(self, values_mm: NDArray[np.floating], weights: Mapping[str, float]) -> None:
        """Add weighted shapes to points (P, 3) mm, in place, in order. Raises KeyError."""
        for name, weight in weights.items():
            points, offsets_mm = self.shape(name)
            values_mm[points] += np.float32(weight) * offsets_mm
