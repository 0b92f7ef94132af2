"""The ICT-FaceKit morphable model as one matrix, and its blend shapes of action units."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.occluder import occluder_of
from glsim.faces.action_units import SHAPES, shape_weights
from glsim.faces.base import Topology

IDENTITY_MODES: Final = 100

#: Lips part: 4 mm of the 42 of the kit's jawOpen.
_OVERRIDES: Final = {"AU25": {"jawOpen": 0.1}}
#: Shapes of the midline whose names have a side.
_WHOLE: Final = ("jawLeft", "jawRight")


def _kit_name(shape: str) -> str:
    """Return the kit's name of an ARKit shape."""
    for side in () if shape in _WHOLE else ("Left", "Right"):
        if shape.endswith(side):
            return f"{shape.removesuffix(side)}_{side[0]}"
    return shape


#: All shapes that an action unit uses.
KNOWN_SHAPES: Final = frozenset(map(_kit_name, SHAPES))


@dataclass(frozen=True, eq=False)
class MorphableModel:
    """A linear face model: vertices = weights @ basis, in canonical millimetres.

    Args:
        basis: (1 + 100 + E, V * 3) float32: mean face, identity modes, expression shapes; a memory
            map of the cache file, shared by all processes of the machine.
        expressions: names of the E shapes, in the order of the rows.
        topology: triangles, regions and landmarks.
    """

    basis: NDArray[np.float32]
    expressions: tuple[str, ...]
    topology: Topology

    @cached_property
    def occluder(self) -> NDArray[np.int32]:
        """(F', 3) int32: the triangles that cast shadows, from the mean face."""
        return occluder_of(self.basis[0].reshape(-1, 3), self.topology.triangles)

    def content_hash(self) -> str:
        """Return a hash of all numbers of the model (30 ms)."""
        topology = self.topology
        assert topology.regions is not None
        digest = hashlib.blake2b(" ".join(self.expressions).encode(), digest_size=16)
        for part in (self.basis, topology.triangles, topology.regions, self.occluder):
            digest.update(np.ascontiguousarray(part).data)
        return digest.hexdigest()

    def neutral(self, identity: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the (V, 3) float32 vertices, mm, of a person with (100,) identity weights."""
        return self._sum(self.basis[0], identity, 1)

    def with_shapes(
        self, neutral: NDArray[np.float32], weights: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """Return the (V, 3) float32 vertices, mm, of a person with (E,) expression weights."""
        return self._sum(neutral.ravel(), weights, 1 + IDENTITY_MODES)

    def _sum(
        self, start: NDArray[np.float32], weights: NDArray[np.floating], first: int
    ) -> NDArray[np.float32]:
        """Add weighted rows of the basis one after the other: the same bytes on any processor."""
        face = start.copy()
        for row, weight in enumerate(weights.astype(np.float32), start=first):
            if weight:
                face += self.basis[row] * weight
        return face.reshape(-1, 3)

    def shape_weights(self, expression: Mapping[str, float]) -> NDArray[np.float64]:
        """Return (E,) weights in [0, 1] of the shapes for action unit -> intensity."""
        weights = np.zeros(len(self.expressions))
        for name, weight in shape_weights(expression, _OVERRIDES).items():
            weights[self.expressions.index(_kit_name(name))] = weight
        return weights
