"""Regions and landmarks of faces: one table of region names for all sources, and vertex labels.

Landmarks are 68 vertices in the order of Multi-PIE (and iBUG): jaw 0-16, brows 17-26, nose 27-35,
eyes 36-47, lips 48-67; each group starts at the subject's right, on the left of the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, MeshError
from glsim.core.products import product
from glsim.faces.face_source import FaceSource

#: Region names with a fixed number, from 1: "nose" has the same number in every data set.
#: Part of the data-set format: append new names at the end.
KNOWN_REGIONS: Final = (
    "skin", "brow", "hair", "lips", "sclera", "iris", "pupil", "ear", "neck", "nose",
    "lids", "forehead", "cheek", "chin", "mouth", "teeth",
    "face", "head", "eye socket", "mouth socket", "gums",
    "scalp", "torso", "arm", "hand", "leg", "foot",
    "wall", "floor", "ceiling", "door", "window", "furniture", "screen", "plant", "person",
    "beard", "glasses", "cloth", "shoulder", "hat", "headphones",
)  # fmt: skip
_KEPT_LABELS: Final = 64  # cached arrays; a room needs ten, one for each mesh
_MAX_REGIONS: Final = 255  # 8 bits; 0 means no region


def has_regions(sources: Sequence[FaceSource]) -> bool:
    """Return whether any source knows the regions of its faces."""
    return any(source.topology and source.topology.region_names for source in sources)


def region_numbers(sources: Sequence[FaceSource], further: Sequence[str] = ()) -> dict[str, int]:
    """Return the numbers of all regions of the sources, name -> number, sorted by number.

    ``further``: KNOWN_REGIONS of clothes and rooms. Raises ConfigError for no region, or over 255.
    """
    named = {
        name
        for source in sources
        for name in (source.topology.region_names if source.topology else ())
    }
    if not named:
        kinds = ", ".join(sorted({source.name for source in sources}))
        raise ConfigError(f"{kinds}: has no face regions: leave regions out of output.layers")
    table = (*KNOWN_REGIONS, *sorted(named - set(KNOWN_REGIONS)))
    if len(table) > _MAX_REGIONS:
        raise ConfigError(f"{len(table)} names of face regions: the limit is {_MAX_REGIONS}")
    return {
        name: number for number, name in enumerate(table, start=1) if name in named | {*further}
    }


class RegionLabels:
    """Region numbers of the vertices of all sources."""

    def __init__(self, sources: Sequence[FaceSource], further: Sequence[str] = ()) -> None:
        self.numbers = region_numbers(sources, further)
        self._sources = sources
        self._labels: dict[int, NDArray[np.float32] | None] = {}
        self.uniform = lru_cache(_KEPT_LABELS)(self._uniform)

    def of(self, source: int, vertices: int) -> NDArray[np.float32] | None:
        """Return region numbers (V,) float32 for a source's meshes; None if it has no regions.

        Returns the same array each time. Raises MeshError if the source's regions are for another
        number of vertices.
        """
        if source not in self._labels:
            topology = self._sources[source].topology
            self._labels[source] = None
            if topology is not None and topology.regions is not None:
                numbers = [self.numbers[name] for name in topology.region_names]
                self._labels[source] = np.array(numbers, np.float32)[topology.regions]
        labels = self._labels[source]
        if labels is not None and len(labels) != vertices:
            raise MeshError(
                f"the mesh has {vertices} vertices, the regions of its source are for {len(labels)}"
            )
        return labels

    def _uniform(self, name: str, vertices: int) -> NDArray[np.float32] | None:
        """Return cached labels (V,) float32 of one region; None for "". Raises ConfigError."""
        if not name:
            return None
        if name not in KNOWN_REGIONS:
            raise ConfigError(f"{name!r}: no known face region")
        number = KNOWN_REGIONS.index(name) + 1
        self.numbers.setdefault(name, number)
        return np.full(vertices, number, np.float32)


def landmark_vertices(source: FaceSource) -> NDArray[np.int64]:
    """Return the landmarks' vertices (68,), for all meshes of the source. Raises ConfigError."""
    topology = source.topology
    if topology is None or topology.landmarks is None:
        raise ConfigError(
            f"{source.name}: does not know the landmarks of its faces: leave output.landmarks out, "
            "or use procedural, people or ict-facekit"
        )
    return topology.landmarks


def to_camera(
    vertices_mm: NDArray[np.floating[Any]], view: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Transform head vertices (N, 3) mm by a view (4, 4) to camera-frame metres."""
    return product(vertices_mm.astype(np.float64), view[:3, :3].T) + view[:3, 3]
