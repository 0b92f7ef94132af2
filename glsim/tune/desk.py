"""What the parts of a page need of the page."""

from __future__ import annotations

from typing import Any, Protocol

from nicegui import Client

from glsim.sensors.sensor import Sensor
from glsim.tune.bench import Picture
from glsim.tune.state import History, StageCode, Tuning
from glsim.tune.workshop import Workshop


class Desk(Protocol):
    """One open tab. picture: the newest; selected: the open section of the left."""

    workshop: Workshop
    client: Client
    history: History
    picture: Picture | None
    selected: str

    @property
    def sensor(self) -> Sensor | None:
        """The sensor of the shown picture."""
        ...

    def change(self, tuning: Tuning, what: str = "") -> None:
        """Make a tuning the current one, and draw it soon. what: name of the change, for undo."""
        ...

    async def refresh(self) -> None:
        """Draw the current tuning."""
        ...

    def call(self, name: str, *given: Any) -> None:
        """Call a function of assets/tune.js."""
        ...

    async def change_theme(self) -> None:
        """Change between dark and light."""
        ...

    def set_value(self, name: str, value: Any) -> None:
        """Change one value by its name of ``--set``; None takes it back."""
        ...

    async def set_code(self, stage: str, code: StageCode | None) -> None:
        """Change the GLSL of a stage; None takes it back."""
        ...
