"""Top bar of the page: sensor, frame, undo, comparison, and the menu Save."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import ui

from glsim.cli.tune_page.sensor_file import checked_path, code_file, other_values, save_sensor
from glsim.cli.tune_page.tab import TuneTab
from glsim.cli.tune_page.tuning import Tuning, python_code, set_options
from glsim.core.errors import ConfigError, GlsimError
from glsim.sensors.sensor import sensor_names
from glsim.settings.toml_tables import toml_value

#: Ranges of the colour scale for differences, mm.
_SCALES_MM = (2, 5, 10, 20, 50, 100)


class TopBar:
    """Elements of the top bar with their actions."""

    def __init__(self, page: TuneTab) -> None:
        self._page = page
        self._presenting = False
        ui.html("<b>glsim tune</b>", sanitize=False)
        names, own = sensor_names(), page.history.now.sensor
        listed = names if own in names else [own, *names]
        self._sensor = ui.select(listed, value=own, on_change=self._to_sensor)
        self._sensor.props('dense outlined options-dense aria-label="sensor"')
        self._sensor.style("width: 168px")
        self._play = _icon("play_arrow", "play or stop", page.toggle_play)
        self._frame = self._number("frame", "expression, pose and noise", self._to_frame)
        self._seed = self._number("seed", "other people, other noise", self._to_seed)
        ui.element("span").classes("grow")
        self._undo = _icon("undo", "undo (Ctrl+Z)", self._go_back)
        self._redo = _icon("redo", "redo (Ctrl+Shift+Z)", self._go_forward)
        ui.keyboard(self._key, ignore=["input", "textarea", "select"])
        with ui.button("A | B").props('flat dense aria-label="compare"'), ui.menu():
            ui.menu_item("Keep these settings as B", page.keep_other)
            ui.menu_item("Show A alone", page.drop_other)
        with ui.button("± 10 mm").props("flat dense") as scale, ui.menu():
            scale.tooltip("range of colours of the difference")
            for mm in _SCALES_MM:
                ui.menu_item(f"± {mm} mm", lambda mm=mm: self._to_scale(scale, mm))
        _icon("fit_screen", "show the whole image", lambda: page.call("fit"))
        save = ui.button("Save").props('flat dense icon-right=expand_more aria-label="save"')
        with save, ui.menu():
            ui.menu_item("Save sensor…", self._ask_file)
            ui.separator()
            ui.menu_item("Copy command line", self._copy_command)
            ui.menu_item("Copy Python", lambda: _copy(python_code(page.history.now)))

    def _number(self, name: str, help: str, change: Any) -> ui.number:
        ui.label(name).classes("word")
        box = ui.number(min=0, format="%d", on_change=change).classes("number")
        box.props(f'dense outlined debounce=400 aria-label="{name}"').tooltip(help)
        return box.style("width: 62px")

    def refresh(self) -> None:
        """Show the current tuning."""
        history = self._page.history
        self._presenting = True
        self._sensor.set_value(history.now.sensor)
        self._frame.set_value(history.now.frame)
        self._seed.set_value(history.now.values.get("seed", self._page.session.base.seed))
        self._presenting = False
        self._undo.set_enabled(history.can_undo)
        self._redo.set_enabled(history.can_redo)
        self._play.props(f"icon={'stop' if self._page.playing else 'play_arrow'}")

    async def _go_back(self) -> None:
        self._page.history.undo()
        await self._page.refresh()

    async def _go_forward(self) -> None:
        self._page.history.redo()
        await self._page.refresh()

    async def _key(self, event: Any) -> None:
        if event.action.keydown and str(event.key).lower() == "z" and event.modifiers.ctrl:
            await (self._go_forward() if event.modifiers.shift else self._go_back())

    def _to_frame(self, event: Any) -> None:
        if event.value is not None and not self._presenting:
            self._page.change(replace(self._page.history.now, frame=int(event.value)), "frame")

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

    def _to_scale(self, button: ui.button, mm: int) -> None:
        button.text = f"± {mm} mm"
        self._page.call("scale", mm)

    def _copy_command(self) -> None:
        tuning = self._page.history.now
        _copy(f"{self._page.session.command} {set_options(tuning)}")
        if tuning.code:
            ui.notify("changed code is not in it: save the sensor", type="warning")

    def _ask_file(self) -> None:
        """Ask for the name of a sensor file; to replace files, the user must click twice."""
        now = self._page.history.now
        agreed: list[Path] = []

        def click() -> None:
            try:
                path = checked_path(str(name.value))
                files = [path, *(code_file(path, stage) for stage in now.code)]
                present = [file for file in files if file.exists()]
                if present and present != agreed:
                    agreed[:] = present
                    listed = ", ".join(file.name for file in present)
                    warning.text = f"{listed}: already there. Click again to replace."
                    button.text = "Replace"
                    return
                message = self._save(path)
            except (GlsimError, OSError) as error:
                ui.notify(str(error), type="negative")
                return
            dialog.close()
            ui.notify(message, multi_line=True, timeout=12000, close_button="ok")

        def changed() -> None:
            agreed.clear()
            warning.text, button.text = "", "Save"

        with ui.dialog() as dialog, ui.card().style("min-width: min(720px, 90vw)"):
            ui.label("Save sensor: the file with your values, comments kept")
            file = Path.cwd() / f"{Path(now.sensor).stem}-tuned.toml"
            name = ui.input("file", value=str(file), on_change=changed)
            name.props("dense outlined autofocus").classes("w-full")
            warning = ui.label().classes("problem").props('role="alert"')
            with ui.row():
                button = ui.button("Save", on_click=click).props("flat")
                ui.button("Cancel", on_click=dialog.close).props("flat")
        dialog.on("hide", dialog.delete)
        dialog.open()

    def _save(self, path: Path) -> str:
        """Save the sensor; return a message with the files and the command of the same frame."""
        page = self._page
        if page.picture is None:
            raise ConfigError("there is no picture yet: wait for the first one")
        written = save_sensor(page.history.now, page.picture.sensor, path)
        words = ["--sensor", str(path)]
        for key, value in other_values(page.history.now).items():
            words += ["--set", f"{key}={toml_value(value)}"]
        files = ", ".join(str(file) for file in written)
        return f"wrote {files}. The same frame: {page.session.command} {shlex.join(words)}"


def _icon(icon: str, help: str, action: Any) -> ui.button:
    """Add an icon button; ``help``: its name for screen readers, with keys in brackets."""
    button = ui.button(icon=icon, on_click=action)
    button.props(f'flat dense aria-label="{help.partition(" (")[0]}"').tooltip(help)
    return button


def _copy(text: str) -> None:
    ui.clipboard.write(text)
    ui.notify("copied")
