"""The source ``facewarehouse``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from glsim.faces.base import FaceSource, MeshFileSettings


class FaceWarehouseSettings(MeshFileSettings):
    """FaceWarehouse in its original layout: blend shapes and training poses of 150 people."""

    steps: int | None = Field(None, ge=1, description="frames per blend shape")
    poses: bool | None = Field(None, description="also the training poses")

    def open(self, seed: int) -> FaceSource:
        """Open the set. Raises ConfigError without its folder."""
        from glsim.faces.scans.facewarehouse import FaceWarehouse

        return FaceWarehouse(
            self.folder,
            unit=self.unit,
            axes=self.axes,
            steps=self.steps or 1,
            poses=self.poses is not False,
        )

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Recognise folders Tester_N."""
        return float(any(re.fullmatch(r"Tester_\d+", folder.name) for folder in folders))
