"""A face source of a single mesh, from a file or from the caller."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from glsim.core.mesh import Mesh
from glsim.faces.face_source import Face, FaceKey, FaceSource


class OneMesh(FaceSource):
    """A face source with one subject and one mesh, for ``simulate(settings, sources=[...])``."""

    name = "mesh"

    def __init__(
        self, mesh: Mesh, subject: str = "face", notes: dict[str, object] | None = None
    ) -> None:
        self._mesh, self._subject, self._notes = mesh, subject, notes or {}

    def subjects(self, count: int | None) -> list[str]:
        """Return the name of the single subject."""
        return [self._subject]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return keys of ``count`` frames; all have the same mesh and differ in their seeds."""
        return [FaceKey(subject, "main", number) for number in range(count or 1)]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        """Yield a Face with the same mesh for each key."""
        for key in keys:
            yield Face(key, self._mesh, notes=self._notes)
