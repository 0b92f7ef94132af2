"""The ICT-FaceKit morphable model as one matrix."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.ict_facekit.topology import Topology
from glsim.geometry.occluder import occluder_of

IDENTITY_MODES: Final = 100
MM_PER_UNIT: Final = 10.0  # the model is in centimetres
#: Rows of every matrix product: OpenBLAS rounds by the number of rows (seen on AMD's Zen 5). 32
#: faces take 13 ms, by one product 10 ms; a single face 6 ms, by a product of one row 1.4 ms.
_PRODUCT_ROWS: Final = 16


@dataclass(frozen=True, eq=False)
class MorphableModel:
    """A linear face model: vertices = weights @ basis, in canonical millimetres.

    Args:
        basis: (1 + 100 + E, V * 3) float32: mean face, identity modes, expression shapes; a memory
            map of the cache file, shared by all processes of the machine.
        expressions: names of the E shapes, in the order of the rows.
    """

    basis: NDArray[np.float32]
    expressions: tuple[str, ...]
    topology: Topology

    @cached_property
    def occluder(self) -> NDArray[np.int32]:
        """(F', 3) int32: the triangles that cast shadows, from the mean face."""
        return occluder_of(self.basis[0].reshape(-1, 3), self.topology.faces)

    def content_hash(self) -> str:
        """Return a hash of all numbers of the model (30 ms)."""
        digest = hashlib.blake2b(" ".join(self.expressions).encode(), digest_size=16)
        for part in (self.basis, self.topology.faces, self.topology.region, self.occluder):
            digest.update(np.ascontiguousarray(part).data)
        return digest.hexdigest()

    def evaluate(self, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the vertices of B faces, (B, V, 3) mm; a face has the same bytes in any batch.

        Args:
            weights: (B, 1 + 100 + E).
        """
        blocks = -(-len(weights) // _PRODUCT_ROWS)
        padded = np.zeros((blocks, _PRODUCT_ROWS, weights.shape[1]), np.float32)
        padded.reshape(-1, weights.shape[1])[: len(weights)] = weights
        vertices = np.empty((blocks, _PRODUCT_ROWS, self.basis.shape[1]), np.float32)
        for block, result in zip(padded, vertices, strict=True):
            np.matmul(block, self.basis, out=result)
        return vertices.reshape(blocks * _PRODUCT_ROWS, -1, 3)[: len(weights)]
