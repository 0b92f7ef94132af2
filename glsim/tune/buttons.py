"""Elements that the pages share: buttons with an icon, and the menu of the difference's colours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

#: Ranges of colours of the difference, mm.
_SCALES_MM = (2, 5, 10, 20, 50, 100)


def icon_button(icon: str, help: str, action: Any) -> ui.button:
    """Add a button; help: its name for screen readers, and keys in brackets."""
    name = help.partition(" (")[0]
    button = ui.button(icon=icon, on_click=action).props(f'flat dense aria-label="{name}"')
    return button.tooltip(help)


def scale_menu(call: Callable[..., None]) -> None:
    """Add the menu of the difference's range. call: a function of assets/tune.js, by its name."""

    def choose(mm: int) -> None:
        button.text = f"± {mm} mm"
        call("scale", mm)

    with ui.button("± 10 mm").props("flat dense") as button, ui.menu():
        button.tooltip("range of colours of the difference")
        for mm in _SCALES_MM:
            ui.menu_item(f"± {mm} mm", lambda mm=mm: choose(mm))
