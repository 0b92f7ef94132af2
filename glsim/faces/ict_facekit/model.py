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
        """Return the vertices of faces; a face has the same bytes in any batch, on any processor.

        The rows are added one after the other: a matrix product rounds by the place of a face in
        the batch (OpenBLAS on AMD's Zen 4 and 5), by threads and by the processor.

        Args:
            weights: (B, 1 + 100 + E) float32.

        Returns:
            (B, V, 3) float32 vertices, mm.
        """
        faces = np.empty((len(weights), self.basis.shape[1]), np.float32)
        split = len(self.basis) - len(self.expressions)
        neutrals: dict[bytes, NDArray[np.float32]] = {}  # the frames of a person share one
        for row, face in zip(weights, faces, strict=True):
            person = row[:split].tobytes()
            if person not in neutrals:
                face[:] = 0
                self._add(face, row, range(split))
                neutrals[person] = face.copy()
            face[:] = neutrals[person]
            self._add(face, row, range(split, len(row)))
        return faces.reshape(len(weights), -1, 3)

    def _add(self, face: NDArray[np.float32], weights: NDArray[np.float32], rows: range) -> None:
        """Add the weighted rows of the basis to a face, (V * 3,) mm, in place."""
        term = np.empty_like(face)
        for row in rows:
            if weights[row]:
                face += np.multiply(self.basis[row], weights[row], out=term)
