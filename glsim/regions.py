"""Parts of faces in data sets: one table of names for all sources, and labels for the renderer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, MeshError
from glsim.faces.base import FaceSource

#: Names with a number of their own, from 1, so that "nose" is the same number in every data set.
#: Part of the format: new names go to the end.
KNOWN: Final = (
    "skin", "brow", "hair", "lips", "sclera", "iris", "pupil", "ear", "neck", "nose",
    "lids", "forehead", "cheek", "chin", "mouth", "teeth",
    "face", "head", "eye socket", "mouth socket", "gums",
)  # fmt: skip
_MOST: Final = 255  # numbers that fit 8 bits beside 0, which is none


def region_numbers(sources: Sequence[FaceSource]) -> dict[str, int]:
    """The names of all regions that the sources know -> their numbers, by number.

    A source knows regions if it has ``region_names`` and ``regions``, (V,) indices into them for
    the vertices of each of its meshes. Raises ConfigError if none does, or for too many.
    """
    named = {name for source in sources for name in _names(source)}
    if not named:
        kinds = ", ".join(sorted({source.name for source in sources}))
        raise ConfigError(f"{kinds}: has no face regions: leave 'regions' out of the layers")
    table = (*KNOWN, *sorted(named - set(KNOWN)))
    if len(table) > _MOST:
        raise ConfigError(f"{len(table)} names of face regions: {_MOST} can be numbered")
    return {name: number for number, name in enumerate(table, start=1) if name in named}


def _names(source: FaceSource) -> tuple[str, ...]:
    return tuple(getattr(source, "region_names", ()))


class RegionLabels:
    """The vertex labels of some sources, in the numbers of their common table."""

    def __init__(self, sources: Sequence[FaceSource]) -> None:
        self.numbers = region_numbers(sources)
        self._sources = sources
        self._labels: dict[int, NDArray[np.float32] | None] = {}

    def of(self, source: int, vertices: int) -> NDArray[np.float32] | None:
        """(V,) numbers for the meshes of a source; None if it knows no regions.

        The same array each time. Raises MeshError for a mesh of another number of vertices.
        """
        if source not in self._labels:
            self._labels[source] = self._load(self._sources[source])
        labels = self._labels[source]
        if labels is not None and len(labels) != vertices:
            raise MeshError(
                f"the mesh has {vertices} vertices, the regions of its source are for {len(labels)}"
            )
        return labels

    def _load(self, source: FaceSource) -> NDArray[np.float32] | None:
        names = _names(source)
        if not names:
            return None
        numbers = np.array([self.numbers[name] for name in names], np.float32)
        labels: NDArray[np.float32] = numbers[source.regions]  # type: ignore[attr-defined]
        return labels
