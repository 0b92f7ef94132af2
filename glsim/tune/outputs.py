"""What leaves the page: a sensor file, a command line, Python, a link, the frame's files."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from nicegui import ui

from glsim.dataset import write_frame
from glsim.errors import GlsimError
from glsim.frame import LAYERS
from glsim.tune.desk import Desk
from glsim.tune.sensor_file import other_values, save_sensor
from glsim.tune.state import Tuning, python_code, set_options, toml_value


class Outputs:
    """The menu of what leaves the page."""

    def __init__(self, page: Desk) -> None:
        self._page = page
        save = ui.button("Save").props('flat dense icon-right=expand_more aria-label="save"')
        with save, ui.menu():
            ui.menu_item("Save sensor…", self._ask_sensor)
            ui.menu_item("Save this frame…", self._ask_frame)
            ui.separator()
            ui.menu_item("Copy command line", self._copy_command)
            ui.menu_item("Copy Python", lambda: self._copy(python_code(page.history.now)))
            ui.menu_item("Copy link", self._copy_link)

    def refresh(self, tuning: Tuning) -> None:
        """Put the settings into the page's address, so that reloading keeps them."""
        self._page.client.run_javascript(f"history.replaceState(null, '', '/?s={tuning.link()}')")

    def _copy(self, text: str) -> None:
        ui.clipboard.write(text)
        ui.notify("copied")

    def _copy_command(self) -> None:
        tuning = self._page.history.now
        self._copy(f"{self._page.workshop.command} {set_options(tuning)}")
        if tuning.code:
            ui.notify("changed code is not in it: save the sensor", type="warning")

    async def _copy_link(self) -> None:
        link = self._page.history.now.link()
        address = await ui.run_javascript(f"location.origin + '/?s={link}'")
        self._copy(str(address))

    def _ask(self, title: str, value: str, label: str, done: Any) -> None:
        with ui.dialog() as dialog, ui.card().style("min-width: 420px"):
            ui.label(title)
            name = ui.input(label, value=value).props("dense outlined autofocus").classes("w-full")
            with ui.row():
                ui.button("Save", on_click=lambda: done(dialog, str(name.value))).props("flat")
                ui.button("Cancel", on_click=dialog.close).props("flat")
        dialog.on("hide", dialog.delete)
        dialog.open()

    def _ask_sensor(self) -> None:
        stem = Path(self._page.history.now.sensor).stem
        file = Path.cwd() / f"{stem}-tuned.toml"
        self._ask("Save sensor: the file with your values, comments kept", str(file), "file",
                  self._save_sensor)  # fmt: skip

    def _save_sensor(self, dialog: Any, name: str) -> None:
        page = self._page
        if page.sensor is None:
            return
        try:
            written = save_sensor(page.history.now, page.sensor, Path(name).expanduser())
        except (GlsimError, OSError) as error:
            ui.notify(str(error), type="negative")
            return
        dialog.close()
        words = [f"--sensor {shlex.quote(str(written[0]))}"]
        for key, value in other_values(page.history.now).items():
            words.append(shlex.join(["--set", f"{key}={toml_value(value)}"]))
        ui.notify(
            f"wrote {', '.join(path.name for path in written)}. "
            f"The same frame: {page.workshop.command} {' '.join(words)}",
            multi_line=True, timeout=12000, close_button="ok",
        )  # fmt: skip

    def _ask_frame(self) -> None:
        self._ask("Save this frame: clean, noisy, infrared and reason", str(Path.cwd() / "frame"),
                  "folder and beginning of the names", self._save_frame)  # fmt: skip

    def _save_frame(self, dialog: Any, name: str) -> None:
        picture = self._page.picture
        if picture is None:
            return
        path = Path(name).expanduser()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            written = write_frame(picture.frame, path.parent, path.name, LAYERS)
        except (GlsimError, OSError) as error:
            ui.notify(str(error), type="negative")
            return
        dialog.close()
        ui.notify(f"wrote {', '.join(p.name for p in written)} in {path.parent}")
