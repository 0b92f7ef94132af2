"""The interface of a page that its components use."""

from __future__ import annotations

from typing import Any, Protocol

from nicegui import Client

from glsim.sensors.sensor import Sensor
from glsim.tune.bench import DrawnFrame
from glsim.tune.state import History, StageCode, Tuning
from glsim.tune.workshop import Workshop


class Desk(Protocol):
    """One open tab.

    Attributes:
        picture: the newest one.
        selected: the open section of the left column.
    """

    workshop: Workshop
    client: Client
    history: History
    picture: DrawnFrame | None
    selected: str

    @property
    def sensor(self) -> Sensor | None:
        """The sensor of the shown picture."""
        ...

    def change(self, tuning: Tuning, what: str = "") -> None:
        """Make a tuning the current one, and draw it soon.

        Args:
            what: name of the change, for undo.
        """
        ...

    async def refresh(self) -> None:
        """Draw the current tuning."""
        ...

    def call(self, name: str, *given: Any) -> None:
        """Call a function of assets/tune.js."""
        ...

    async def change_theme(self) -> bool:
        """Change between dark and light; return whether the page is dark now."""
        ...

    def set_value(self, name: str, value: Any) -> None:
        """Change one value by its name of ``--set``; None takes it back."""
        ...

    async def set_code(self, stage: str, code: StageCode | None) -> None:
        """Change the GLSL of a stage; None takes it back."""
        ...
