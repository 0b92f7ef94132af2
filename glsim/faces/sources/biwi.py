"""The source ``biwi``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from glsim.faces.base import FaceSource, MeshFileSettings


class BiwiSettings(MeshFileSettings):
    """The Biwi Kinect Head Pose set in its original layout: templates at recorded poses."""

    every: int | None = Field(None, ge=1, description="take every n-th frame")

    def open(self, seed: int) -> FaceSource:
        """Open the set. Raises ConfigError without its folder."""
        from glsim.faces.scans.biwi import Biwi

        return Biwi(self.folder, unit=self.unit, axes=self.axes, every=self.every or 1)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Recognise folders NN that hold head poses."""
        named = (folder for folder in folders if re.fullmatch(r"\d\d", folder.name))
        return float(any(any(folder.glob("frame_*_pose.txt")) for folder in named))
