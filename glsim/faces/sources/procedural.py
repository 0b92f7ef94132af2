"""The source ``procedural``."""

from __future__ import annotations

from glsim.faces.base import FaceSource, GeneratorSettings


class ProceduralSettings(GeneratorSettings):
    """Generated heads without data files: 60 identity parameters, 24 FACS action units."""

    def open(self, seed: int) -> FaceSource:
        """Open the generator."""
        from glsim.faces.procedural.source import ProceduralFaces

        return ProceduralFaces(seed, *self.timing)
