"""Save or copy the page's settings: sensor file, frame, command line, Python, link."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from glsim.dataset import write_frame
from glsim.errors import ConfigError, GlsimError
from glsim.tune.desk import Desk
from glsim.tune.packet import image_names
from glsim.tune.sensor_file import checked_path, code_file, other_values, save_sensor
from glsim.tune.state import Tuning, python_code, set_options, toml_value

_NO_PICTURE = "there is no picture yet: wait for the first one"


class Outputs:
    """The menu Save: writes sensor files and frames, copies commands and links."""

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

    def _ask(
        self,
        title: str,
        value: str,
        label: str,
        files: Callable[[Path], list[Path]],
        save: Callable[[Path], str],
    ) -> None:
        """Ask for a name, and save; a second click is needed to replace files.

        Args:
            files: of a path, those that ``save`` writes.
            save: writes; returns a message about what it wrote.
        """
        agreed: list[Path] = []

        def click() -> None:
            try:
                path = checked_path(str(name.value))
                present = [file for file in files(path) if file.exists()]
                if present and present != agreed:
                    agreed[:] = present
                    names = ", ".join(file.name for file in present)
                    warning.text = f"{names}: already there. Click again to replace."
                    button.text = "Replace"
                    return
                message = save(path)
            except (GlsimError, OSError) as error:
                ui.notify(str(error), type="negative")
                return
            dialog.close()
            ui.notify(message, multi_line=True, timeout=12000, close_button="ok")

        def changed() -> None:
            agreed.clear()
            warning.text, button.text = "", "Save"

        with ui.dialog() as dialog, ui.card().style("min-width: min(420px, 90vw)"):
            ui.label(title)
            name = ui.input(label, value=value, on_change=changed)
            name.props("dense outlined autofocus").classes("w-full")
            warning = ui.label().classes("problem").props('role="alert"')
            with ui.row():
                button = ui.button("Save", on_click=click).props("flat")
                ui.button("Cancel", on_click=dialog.close).props("flat")
        dialog.on("hide", dialog.delete)
        dialog.open()

    def _ask_sensor(self) -> None:
        page = self._page
        file = Path.cwd() / f"{Path(page.history.now.sensor).stem}-tuned.toml"

        def files(path: Path) -> list[Path]:
            return [path, *(code_file(path, stage) for stage in page.history.now.code)]

        self._ask("Save sensor: the file with your values, comments kept", str(file), "file",
                  files, self._save_sensor)  # fmt: skip

    def _save_sensor(self, path: Path) -> str:
        page = self._page
        if page.sensor is None:
            raise ConfigError(_NO_PICTURE)
        written = save_sensor(page.history.now, page.sensor, path)
        words = [f"--sensor {shlex.quote(str(written[0]))}"]
        for key, value in other_values(page.history.now).items():
            words.append(shlex.join(["--set", f"{key}={toml_value(value)}"]))
        return (
            f"wrote {', '.join(str(file) for file in written)}. "
            f"The same frame: {page.workshop.command} {' '.join(words)}"
        )

    def _ask_frame(self) -> None:
        picture = self._page.picture
        if picture is None:
            ui.notify(_NO_PICTURE, type="negative")
            return
        names = image_names(picture.frame)

        def files(path: Path) -> list[Path]:
            return [path.with_name(f"{path.name}_{name}.png") for name in names]

        self._ask(f"Save this frame: {', '.join(names)}", str(Path.cwd() / "frame"),
                  "folder and beginning of the names", files, self._save_frame)  # fmt: skip

    def _save_frame(self, path: Path) -> str:
        picture = self._page.picture
        if picture is None:
            raise ConfigError(_NO_PICTURE)
        names = image_names(picture.frame)
        written = write_frame(picture.frame, path.parent, path.name, names)
        return f"wrote {', '.join(file.name for file in written)} in {path.parent}"
