"""The source ``board``."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from glsim.faces.base import FaceSettings, FaceSource


class BoardSettings(FaceSettings):
    """A flat board in place of a face, as cameras are tested on; any number of equal ones."""

    endless: ClassVar[bool] = True

    width_mm: float = Field(160.0, gt=0, le=10_000, description="width of the board, mm")
    height_mm: float = Field(220.0, gt=0, le=10_000, description="height of the board, mm")

    def open(self, seed: int) -> FaceSource:
        """Open the source; ``seed`` changes nothing."""
        from glsim.faces.board import Board

        return Board(self.width_mm, self.height_mm)
