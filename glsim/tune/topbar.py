"""The top of the page: sensor, time, undo, comparison, and what leaves the page."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from nicegui import background_tasks, ui

from glsim.sensors.sensor import sensor_names
from glsim.tune.buttons import icon_button, scale_menu
from glsim.tune.desk import Desk
from glsim.tune.outputs import Outputs
from glsim.tune.side_by_side import SideBySide
from glsim.tune.state import Tuning


class TopBar:
    """The elements of the top, and what they do.

    Attributes:
        playing: whether frame follows frame.
        noise_of: the frame whose noise is kept, or None.
    """

    def __init__(self, page: Desk, comparison: SideBySide) -> None:
        self._page, self._comparison = page, comparison
        self.playing = False
        self.noise_of: int | None = None
        self._presenting = False
        ui.html("<b>glsim tune</b>", sanitize=False)
        names, own = sensor_names(), page.history.now.sensor
        listed = names if own in names else [own, *names]
        self._sensor = ui.select(listed, value=own, on_change=self._to_sensor)
        self._sensor.props('dense outlined options-dense aria-label="sensor"')
        self._sensor.style("width: 168px")
        self._time()
        ui.element("span").classes("grow")
        self._undo = icon_button("undo", "undo (Ctrl+Z)", self.undo)
        self._redo = icon_button("redo", "redo (Ctrl+Shift+Z)", self.redo)
        ui.keyboard(self._key, ignore=["input", "textarea", "select"])
        with ui.button("A | B").props('flat dense aria-label="compare"'), ui.menu():
            ui.menu_item("Keep these settings as B", comparison.keep)
            ui.menu_item("Change places of A and B", comparison.swap)
            ui.menu_item("Show A alone", comparison.drop)
        scale_menu(page.call)
        icon_button("fit_screen", "show the whole surface", lambda: page.call("fit"))
        self.outputs = Outputs(page)
        icon_button("contrast", "dark or light", page.change_theme)

    def _time(self) -> None:
        now = self._page.history.now
        self._play = icon_button("play_arrow", "play or stop", self.toggle_play)
        ui.label("frame").classes("word")
        self._frame = ui.number(value=now.frame, min=0, format="%d", on_change=self._to_frame)
        self._frame.props('dense outlined aria-label="frame"').classes("number")
        self._frame.style("width: 62px").tooltip("number: expression, pose and noise")
        same = ui.checkbox("same noise", on_change=self._lock).props("dense size=sm")
        same.tooltip("keep the noise of this frame while others are shown")
        ui.label("seed").classes("word")
        self._seed = ui.number(value=self._seed_now(), min=0, format="%d", on_change=self._to_seed)
        self._seed.props('dense outlined debounce=400 aria-label="seed"').classes("number")
        self._seed.style("width: 62px").tooltip("other people, other noise")

    def refresh(self) -> None:
        """Show the current tuning."""
        history = self._page.history
        self._presenting = True
        self._sensor.set_value(history.now.sensor)
        self._frame.set_value(history.now.frame)
        self._seed.set_value(self._seed_now())
        self._presenting = False
        self._undo.set_enabled(history.can_undo)
        self._redo.set_enabled(history.can_redo)
        self.outputs.refresh(history.now)

    async def undo(self) -> None:
        """Go one step back."""
        self._page.history.undo()
        await self._page.refresh()

    async def redo(self) -> None:
        """Go one step forward."""
        self._page.history.redo()
        await self._page.refresh()

    def toggle_play(self) -> None:
        """Start or stop showing frame after frame."""
        if self.playing:
            self.stop()
            return
        self.playing = True
        self._play.props("icon=stop")
        self.next_frame()

    def stop(self) -> None:
        """Show the current frame only."""
        self.playing = False
        self._play.props("icon=play_arrow")

    def next_frame(self) -> None:
        """Show the next frame; called when the browser has the one before it."""
        self._page.change(self.next_tuning(), "frame")

    def next_tuning(self) -> Tuning:
        """Return the current tuning at its next frame."""
        page = self._page
        count = page.picture.frames if page.picture else 1
        return replace(page.history.now, frame=(page.history.now.frame + 1) % count)

    def _to_frame(self, event: Any) -> None:
        if event.value is not None and not self._presenting:
            self._page.change(replace(self._page.history.now, frame=int(event.value)), "frame")

    def _lock(self, event: Any) -> None:
        self.noise_of = self._page.history.now.frame if event.value else None
        background_tasks.create(self._page.refresh(), name="same noise")

    def _seed_now(self) -> int:
        return int(self._page.history.now.values.get("seed", self._page.workshop.base.seed))

    def _to_seed(self, event: Any) -> None:
        if event.value is not None and not self._presenting:
            self._page.set_value("seed", int(event.value))

    def _to_sensor(self, event: Any) -> None:
        now = self._page.history.now
        if event.value != now.sensor and not self._presenting:
            own = ("pose.", "scene.", "seed")
            kept = {k: v for k, v in now.values.items() if k.startswith(own)}
            self._page.selected = ""
            self._page.change(Tuning(event.value, kept, {}, now.frame))

    async def _key(self, event: Any) -> None:
        if event.action.keydown and str(event.key).lower() == "z" and event.modifiers.ctrl:
            await (self.redo() if event.modifiers.shift else self.undo())
