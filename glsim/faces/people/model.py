"""The body model as arrays: a template, sparse shapes, a refined surface, and a skeleton."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats
from glsim.core.products import product
from glsim.faces.model_cache import Arrays
from glsim.faces.sparse_shapes import SparseShapes

REGIONS: Final = (
    "skin", "brow", "scalp", "lips", "sclera", "iris", "pupil", "ear", "neck", "nose", "lids",
    "mouth", "teeth", "torso", "arm", "hand", "leg", "foot",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class BodyModel:
    """The body model in canonical axes and millimetres; the template's arms are spread.

    Args:
        template_mm: (P + B, 3) float32: P coarse vertices, then the joints of the B bones.
        actions: facial actions, shapes of the V fine vertices.
        starts, sources, shares: (V,), (N,) and (N,): fine vertex v is the sum of ``shares`` times
            the coarse vertices ``sources`` from starts[v] to starts[v + 1].
        triangles: (F, 3) int32.
        occluder: (F', 3) int32 triangles that cast shadows, chosen on the mean body, see ``Mesh``.
        regions: (V,) uint8 indices into REGIONS.
        rigid: the first ``rigid`` fine vertices move with the bone "head" only.
        soft_starts, soft_bones, soft_weights: (V - rigid,), (M,) and (M, 1) float32: bones and
            weights above 0 of all other vertices.
        bones: (B,) names, parents before children.
        parents: (B,) int32, -1 for the root.
        landmarks: (68,) int64 fine vertices in the order of ``glsim.faces.regions``.
        chin: the fine vertex of the foremost point of the chin.
    """

    template_mm: Floats
    targets: SparseShapes
    actions: SparseShapes
    starts: NDArray[np.int64]
    sources: NDArray[np.int32]
    shares: Floats
    triangles: NDArray[np.int32]
    occluder: NDArray[np.int32]
    regions: NDArray[np.uint8]
    rigid: int
    soft_starts: NDArray[np.int64]
    soft_bones: NDArray[np.uint8]
    soft_weights: Floats
    bones: tuple[str, ...]
    parents: NDArray[np.int32]
    landmarks: NDArray[np.int64]
    chin: int

    @classmethod
    def of_arrays(cls, baked: Arrays, shapes: Arrays) -> BodyModel:
        """Build the model from the arrays of ``body.npz`` and of the shape cache."""
        fields: dict[str, Any] = {n: baked[n] for n in cls.__annotations__ if n in baked}
        fields["occluder"] = fields["occluder"].astype(np.int32)  # half the bytes in the file
        for array in fields.values():
            array.setflags(write=False)
        fields |= {name: SparseShapes.of_arrays(shapes, name) for name in ("targets", "actions")}
        fields |= {"rigid": int(fields["rigid"]), "chin": int(fields["chin"])}
        fields["bones"] = tuple(fields["bones"].tolist())
        fields["shares"] = fields["shares"].astype(np.float32)
        return cls(**fields)

    @property
    def nose_tip(self) -> int:
        """Index of the fine vertex at the tip of the nose."""
        return int(self.landmarks[30])

    def body(self, weights: Mapping[str, float]) -> tuple[Floats, NDArray[np.float64]]:
        """Compute the fine vertices (V, 3) float32 and joints (B, 3) float64 of a body at rest, mm.

        ``weights``: target -> weight. Raises KeyError for an unknown target.
        """
        coarse = self.template_mm.copy()
        self.targets.add(coarse, weights)
        weighted = self.shares[:, None] * coarse[self.sources]
        fine = np.add.reduceat(weighted, self.starts, axis=0)
        joints = coarse[len(coarse) - len(self.bones) :].astype(np.float64)
        return fine, joints

    def transforms(
        self, joints_mm: NDArray[np.float64], turns: Mapping[str, NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """Compute the bone matrices (B, 3, 4) that move a resting body into a posture.

        ``turns``: bone -> (3, 3) rotation relative to its parent, in the axes of the body at rest,
        as are ``joints_mm`` (B, 3); other bones keep their angle to the parent.
        """
        moved = np.empty((len(self.bones), 3, 4))
        for bone, (name, parent) in enumerate(zip(self.bones, self.parents, strict=True)):
            above = np.eye(3, 4) if parent < 0 else moved[parent]
            turn = turns.get(name)
            if turn is None:
                moved[bone] = above
                continue
            rotation = product(above[:, :3], turn)
            place = product(above[:, :3], joints_mm[bone]) + above[:, 3]
            moved[bone, :, :3] = rotation
            moved[bone, :, 3] = place - product(rotation, joints_mm[bone])
        return moved

    def skinned(self, rest_mm: Floats, transforms: NDArray[np.float64]) -> Floats:
        """Move resting vertices by bone matrices (B, 3, 4): return (V, 3) float32 mm."""
        moved = np.empty_like(rest_mm)
        head = transforms[self.bones.index("head")].astype(np.float32)
        moved[: self.rigid] = product(rest_mm[: self.rigid], head[:, :3].T) + head[:, 3]
        # Sums over the bones of each vertex, by columns, which NumPy does fastest.
        counts = np.diff(self.soft_starts, append=len(self.soft_bones))
        x, y, z = np.repeat(rest_mm[self.rigid :].T, counts, axis=1)
        for row, table in enumerate(transforms.astype(np.float32).transpose(1, 2, 0)):
            a, b, c, shift = table[:, self.soft_bones]
            weighted = (a * x + b * y + c * z + shift) * self.soft_weights[:, 0]
            moved[self.rigid :, row] = np.add.reduceat(weighted, self.soft_starts)
        return moved


@lru_cache(maxsize=1)
def mean_body() -> BodyModel:
    """Return the mean body, without shapes and actions; it ships with glsim."""
    none = SparseShapes(
        (), np.zeros(1, np.int64), np.zeros(0, np.int32), np.zeros((0, 3), np.float32)
    )
    return BodyModel.of_arrays(baked_arrays(), none.arrays("targets") | none.arrays("actions"))


def baked_arrays() -> Arrays:
    """Read the arrays of ``body.npz``, which ships with glsim."""
    with (files(__package__) / "body.npz").open("rb") as file, np.load(file) as stored:
        return {name: stored[name] for name in stored.files}
