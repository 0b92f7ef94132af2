"""The source kind ``kinect2``: recorded frames in data sets made by ``glsim import kinect2``."""

from __future__ import annotations

from pydantic import Field

from glsim.core.errors import ConfigError
from glsim.faces.face_source import FaceSettings, FaceSource


class Kinect2Settings(FaceSettings):
    """Real recordings of a Kinect V2, for glsim import only."""

    every: int | None = Field(None, ge=1, description="take every n-th frame")

    def open(self, seed: int) -> FaceSource:
        """Raise ConfigError: recorded frames hold no face geometry."""
        raise ConfigError("source 'kinect2' holds recorded frames, no faces: glsim import kinect2")
