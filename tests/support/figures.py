"""A source of simple whole people, made of boxes, who stand or sit."""

from collections.abc import Iterator, Sequence

import numpy as np

from glsim.core.mesh import Mesh
from glsim.faces.face_source import Face, FaceKey, FaceSource, Topology
from glsim.looks.shapes import box

#: Height of the face above the floor, mm.
FACE_MM = 1600.0


def figure() -> Mesh:
    """Make a person of boxes, 1.7 m tall and 0.2 m deep, with the origin in the face."""
    body = box((450, 1440, 200), (0, -FACE_MM, -100))
    head = box((150, 240, 180), (0, -140, -90))
    vertices = np.concatenate([body.vertices_mm, head.vertices_mm]).astype(np.float32)
    return Mesh(vertices, np.concatenate([body.faces, head.faces + len(body.vertices_mm)]))


class Figures(FaceSource):
    """A source of any number of subjects, with two sequences of two frames each."""

    name = "figures"

    def __init__(self) -> None:
        self.loaded: list[FaceKey] = []

    @property
    def topology(self) -> Topology:
        mesh = figure()
        return Topology(mesh.faces, np.zeros(len(mesh.vertices_mm), np.uint8), ("face",))

    def subjects(self, count: int | None) -> list[str]:
        return [f"f{n:03d}" for n in range(count or 3)]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        keys = [FaceKey(subject, s, n, n / 30) for s in ("s00", "s01") for n in range(2)]
        return keys[:count]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        for key in keys:
            self.loaded.append(key)
            yield Face(key, figure(), notes={"sitting": key.sequence == "s00"})
