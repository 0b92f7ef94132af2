"""The source ``d3dfacs``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pydantic import Field

from glsim.faces.base import FaceSource, MeshFileSettings

_CODES: Final = re.compile(r"\d+[LR]?(\+\d+[LR]?)*", re.ASCII)


class D3dfacsSettings(MeshFileSettings):
    """D3DFACS in its original layout: FLAME registrations or raw scans."""

    every: int | None = Field(None, ge=1, description="take every n-th frame")
    peak_only: bool | None = Field(None, description="only the peak of each sequence")

    def open(self, seed: int) -> FaceSource:
        """Open the set. Raises ConfigError without meshes."""
        from glsim.faces.scans.d3dfacs import D3dfacs

        return D3dfacs(
            self.folder,
            unit=self.unit,
            axes=self.axes,
            every=self.every or 1,
            peak_only=bool(self.peak_only),
        )

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Recognise folders named by action units that hold meshes."""
        named = (folder for folder in folders if _CODES.fullmatch(folder.name))
        return 0.5 if any(any(folder.glob("*.[op][bl][jy]")) for folder in named) else 0.0
