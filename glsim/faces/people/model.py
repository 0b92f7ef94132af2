"""The body model as arrays: a template, sparse targets, subdivision, a skeleton."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glsim.geometry.occluder import occluder_of
from glsim.geometry.products import product

_Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SparseShapes:
    """Named shapes, each an offset of some points.

    Args:
        starts: (N + 1,) int64: shape n holds the entries starts[n] to starts[n + 1].
        points: (E,) int32.
        offsets_mm: (E, 3) float32.
    """

    names: tuple[str, ...]
    starts: NDArray[np.int64]
    points: NDArray[np.int32]
    offsets_mm: _Floats

    @cached_property
    def _number(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.names)}

    def __contains__(self, name: object) -> bool:
        return name in self._number

    def add(self, values_mm: _Floats, weights: Mapping[str, float]) -> None:
        """Add the weighted shapes to (P, 3) points, in place and in the order of ``weights``.

        Raises KeyError for an unknown shape.
        """
        for name, weight in weights.items():
            points, offsets_mm = self.shape(name)
            values_mm[points] += np.float32(weight) * offsets_mm

    def shape(self, name: str) -> tuple[NDArray[np.int32], _Floats]:
        """Return the points (E,) that a shape moves, and their offsets (E, 3); else KeyError."""
        number = self._number[name]
        part = slice(self.starts[number], self.starts[number + 1])
        return self.points[part], self.offsets_mm[part]


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Bones, parents before children. A pose turns each bone about its joint.

    Args:
        names: (B,).
        parents: (B,) int32, -1 for the root.
    """

    names: tuple[str, ...]
    parents: NDArray[np.int32]

    def transforms(
        self, joints_mm: NDArray[np.float64], turns: Mapping[str, NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """Return (B, 3, 4) matrices that move points of the body at rest with each bone.

        Args:
            joints_mm: (B, 3) at rest.
            turns: bone -> (3, 3) rotation relative to its parent, in the axes of the body at rest;
                bones without one keep their angle to the parent.
        """
        moved = np.empty((len(self.names), 3, 4))
        for bone, (name, parent) in enumerate(zip(self.names, self.parents, strict=True)):
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


@dataclass(frozen=True, eq=False)
class BodyModel:
    """The model, in canonical axes, millimetres; the template stands with its arms out.

    Args:
        template_mm: (P + B, 3) float32: P coarse vertices, then the joints of the B bones.
        targets: shapes of the template.
        actions: facial actions, shapes of the V fine vertices.
        starts, sources, shares: (V,), (N,) and (N,): fine vertex v is the sum of ``shares`` times
            the coarse vertices ``sources`` from starts[v] to starts[v + 1].
        faces: (F, 3) int32.
        regions: (V,) uint8 indices into REGIONS (see ``regions``).
        skin: (V, B) float32 weights of the bones. The first ``rigid`` fine vertices move with the
            bone "head" alone.
        landmarks: name -> fine vertex.
    """

    template_mm: _Floats
    targets: SparseShapes
    actions: SparseShapes
    starts: NDArray[np.int64]
    sources: NDArray[np.int32]
    shares: _Floats
    faces: NDArray[np.int32]
    regions: NDArray[np.uint8]
    skin: _Floats
    rigid: int
    skeleton: Skeleton
    landmarks: Mapping[str, int]

    @cached_property
    def occluder(self) -> NDArray[np.int32]:
        """(F', 3) int32: the triangles that cast shadows, from the mean body."""
        return occluder_of(self.body({})[0], self.faces)

    @cached_property
    def _soft_skin(self) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
        """The weights above 0 of the vertices that are not rigid: starts, bones, (N, 1) weights.

        A vertex has up to ten of them: a product with all bones takes four times as long.
        """
        soft = self.skin[self.rigid :]
        vertices, bones = np.nonzero(soft)
        starts = np.searchsorted(vertices, np.arange(len(soft)))
        return starts, bones, soft[vertices, bones][:, None]

    def body(self, weights: Mapping[str, float]) -> tuple[_Floats, NDArray[np.float64]]:
        """Return the (V, 3) float32 fine vertices and (B, 3) float64 joints of a body at rest.

        Args:
            weights: target -> weight.

        Raises:
            KeyError: an unknown target.
        """
        coarse = self.template_mm.copy()
        self.targets.add(coarse, weights)
        weighted = self.shares[:, None] * coarse[self.sources]
        fine = np.add.reduceat(weighted, self.starts, axis=0)
        joints = coarse[len(coarse) - len(self.skeleton.names) :].astype(np.float64)
        return fine, joints

    def skinned(self, rest_mm: _Floats, transforms: NDArray[np.float64]) -> _Floats:
        """Return (V, 3) float32 vertices moved by (B, 3, 4) transforms of the bones."""
        moved = np.empty_like(rest_mm)
        head = transforms[self.skeleton.names.index("head")].astype(np.float32)
        moved[: self.rigid] = product(rest_mm[: self.rigid], head[:, :3].T) + head[:, 3]
        rest = rest_mm[self.rigid :]
        table = transforms.astype(np.float32).reshape(len(transforms), 12)
        starts, bones, weights = self._soft_skin
        blended = np.add.reduceat(weights * table[bones], starts, axis=0).reshape(-1, 3, 4)
        moved[self.rigid :] = np.einsum("vij,vj->vi", blended[:, :, :3], rest) + blended[:, :, 3]
        return moved
