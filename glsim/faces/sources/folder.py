"""The source ``folder``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from glsim.faces.base import FaceSource, MeshFileSettings


class FolderSettings(MeshFileSettings):
    """Any tree of OBJ, PLY, STL, GLB or OFF files, one folder per subject."""

    def open(self, seed: int) -> FaceSource:
        """Open the tree. Raises ConfigError without meshes."""
        from glsim.faces.scans.folder import Folder

        return Folder(self.folder, unit=self.unit, axes=self.axes)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Return little: this source reads what no other recognises."""
        return 0.1
