"""The settings [scene]: nothing, a plain wall, or a room around the person.

[scene]
wall_mm = 1500                                   # a plain wall

[scene]
room = "office"                                  # or a room
behind_mm = { uniform = [900, 2400] }
camera_mm = { uniform = [850, 1350] }            # the camera tilts to the face
people = { choice = [0, 1, 2] }
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from glsim.settings.distribution import Distribution, NumberSetting, Scope, constant
from glsim.settings.tables import TomlTable


def _uniform(low: float, high: float) -> Distribution:
    return Distribution(uniform=(low, high))


#: Limits of the numbers of a room. Chosen: homes and offices.
SCENE_LIMITS = {
    "behind_mm": (400, 8000),
    "width_mm": (1500, 10_000),
    "height_mm": (2000, 5000),
    "turn_deg": (-180, 180),
    "eye_mm": (300, 2300),
    "camera_mm": (100, 2400),
    "clutter": (0, 1),
    "people": (0, 6),
    "albedo": (0.1, 1.5),
}


class SceneSettings(TomlTable):
    """The scene around the face: nothing, a plain wall, or a room."""

    wall_mm: NumberSetting | None = Field(
        None, description="distance of a wall behind; default: no wall"
    )
    wall_albedo: float = Field(0.85, ge=0, le=1, description="relative to a white wall")
    room: Literal["none", "empty", "office", "living-room"] = Field(
        "none", description="floor, walls, doors, windows and, unless empty, furniture"
    )
    per: Scope = Field("subject", description="one room per frame, sequence or subject")
    behind_mm: NumberSetting = Field(
        _uniform(1000.0, 3000.0), description="from the face to the back wall of the room"
    )
    width_mm: NumberSetting = Field(_uniform(3000.0, 5500.0), description="width of the room")
    height_mm: NumberSetting = Field(_uniform(2400.0, 2700.0), description="height of the room")
    turn_deg: NumberSetting = Field(
        _uniform(-30.0, 30.0), description="turn of the room about the vertical axis"
    )
    eye_mm: NumberSetting = Field(
        constant(1200.0), description="height of a head without a body above the floor"
    )
    camera_mm: NumberSetting | None = Field(
        None, description="height of the camera, which tilts to the face; default: the face's"
    )
    clutter: NumberSetting = Field(constant(0.6), description="amount of furniture, 0 to 1")
    people: NumberSetting = Field(
        constant(0.0), description="other people behind, for sources of whole bodies"
    )
    albedo: NumberSetting = Field(constant(1.0), description="factor of all albedos of the room")

    @model_validator(mode="after")
    def _check(self) -> SceneSettings:
        if self.room != "none" and self.wall_mm is not None:
            raise ValueError("wall_mm: a room has walls of its own: give a wall or a room")
        for name, (least, most) in SCENE_LIMITS.items():
            setting = getattr(self, name)
            low, high = (least, most) if setting is None else setting.bounds()
            if low < least or high > most:
                wrong = low if low < least else high
                raise ValueError(f"{name} may be {wrong:g}, but must lie in [{least:g}, {most:g}]")
        return self
