"""The source ``ict-facekit``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from glsim.faces.base import FaceSource, GeneratorSettings


class IctFaceKitSettings(GeneratorSettings):
    """The ICT-FaceKit morphable model: 100 identity modes, 53 expressions."""

    def open(self, seed: int) -> FaceSource:
        """Open the model. Raises ConfigError without its folder."""
        from glsim.faces.ict_facekit import IctFaceKit

        return IctFaceKit(self.folder, seed, *self.timing)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Recognise the folder FaceXModel."""
        return float((root / "generic_neutral_mesh.obj").is_file())
