"""The code of the selected stage: it compiles while one types."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

from nicegui import background_tasks, ui

from glsim.gl.includes import SHADER_ROOT
from glsim.noise.stage import Stage
from glsim.tune.bench import DrawnFrame, marked_lines
from glsim.tune.desk import Desk
from glsim.tune.state import StageCode

TEMPLATE = Path(__file__).parent / "assets" / "template.glsl"

#: Wait for this long after the last key before compiling, seconds.
_PAUSE = 0.25
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


class CodeEditor:
    """Editor, its title and the driver's messages.

    The editor itself is loaded with the first code: its script is as large as all the others.
    """

    def __init__(self, page: Desk) -> None:
        self._page = page
        self._stage = ""
        self._text = ""
        with ui.element("div").classes("bar"):
            self._name = ui.label().style("font-weight: 600")
            self._file = ui.label().classes("file")
            ui.element("span").classes("grow")
            self._status = ui.label().classes("file").props('role="status"')
            self._reset = ui.button("Back to the file's", on_click=self._back).props(
                "flat dense size=sm"
            )
        self._problem = ui.label().classes("problem").props('role="alert"')
        self._problem.set_visibility(False)
        self._plain = ui.label("This stage is Python code, which the page does not change.")
        self._plain.classes("plain").set_visibility(False)
        self._place = ui.element("div").classes("editor")
        self._opened: ui.codemirror | None = None
        self._dark = False
        self._wanted, self._wrong = 0, False

    @property
    def _editor(self) -> ui.codemirror:
        if self._opened is None:
            with self._place:
                self._opened = ui.codemirror("", language="C++", on_change=self._typed)
            self.theme(self._dark)
        return self._opened

    def theme(self, dark: bool) -> None:
        """Follow the page's colours."""
        self._dark = dark
        if self._opened is not None:
            self._opened.set_theme("vscodeDark" if dark else "basicLight")

    def refresh(self, picture: DrawnFrame) -> None:
        """Show the code of the selected stage, unless it is being typed."""
        stages = {stage.name: stage for stage in picture.sensor.stages}
        stage = stages.get(self._page.selected)
        if stage is None:
            stage = stages.get(self._stage) or next(iter(stages.values()), None)
        if stage is None:
            return
        text = self._code(stage)
        changed = stage.name in self._page.history.now.code
        self._reset.set_visibility(changed)
        self._name.text = stage.name
        self._file.text = "changed here" if changed else _short(Path(stage.spec.file))
        self._file.props["title"] = stage.spec.file
        self._file.update()
        editable = stage.spec.source is not None
        self._plain.set_visibility(not editable)
        self._place.set_visibility(editable)
        if stage.name != self._stage or (text != self._text and not self._wrong):
            self._stage, self._text = stage.name, text
            self._editor.set_value(text)
            self.mark("")

    def _code(self, stage: Stage) -> str:
        code = self._page.history.now.code.get(stage.name)
        if code is not None:
            return code.text
        return "" if stage.spec.source is None else Path(stage.spec.file).read_text("utf-8")

    def mark(self, message: str) -> None:
        """Mark the lines that a message of the driver names; an empty one clears the marks."""
        lines = marked_lines(message, f"{Path(self._file_name()).name}") if message else {}
        last = self._text.count("\n") + 1
        inside = {n: text for n, text in lines.items() if 1 <= n <= last}
        self._wrong = bool(message)
        self._editor.decorations = [
            {"kind": "line", "line": n, "class": "wrong", "attributes": {"data-wrong": str(n)}}
            for n in inside
        ]
        self._editor.line_tooltips = inside
        shown = "  ".join(f"line {n}: {text}" for n, text in inside.items()) or message
        self._problem.text = shown
        self._problem.set_visibility(bool(shown))
        self._status.text = "the last good code runs" if message else ""

    def problem(self, message: str) -> None:
        """Show a message that is not about the code; an empty one clears it."""
        if not self._wrong:
            self._problem.text = message
            self._problem.set_visibility(bool(message))

    def _file_name(self) -> str:
        sensor = self._page.sensor
        found = {s.name: s.spec.file for s in sensor.stages} if sensor else {}
        return found.get(self._stage, f"{self._stage}.glsl")

    async def _typed(self, event: Any) -> None:
        text = str(event.value)
        if text == self._text:
            return
        self._text = text
        self._wanted += 1
        number, stage = self._wanted, self._stage
        await asyncio.sleep(_PAUSE)
        if number != self._wanted or stage != self._stage:
            return
        await self._compile(stage, text)

    async def _compile(self, stage: str, text: str) -> None:
        before = self._page.history.now.code.get(stage)
        place = (before.before, before.new) if before else (None, False)
        await self._page.set_code(stage, StageCode(text, *place))

    async def _back(self) -> None:
        stage, self._wrong = self._stage, False
        new = self._page.history.now.code.get(stage)
        if new is not None and new.new:
            self._page.selected = self._stage = ""
        await self._page.set_code(stage, None)

    def new_stage(self) -> None:
        """Ask for the name and the place of a new stage."""
        sensor = self._page.sensor
        if sensor is None:
            return
        names = [s.name for s in sensor.stages]
        shaders = [s.name for s in sensor.stages if s.spec.source is not None]
        with self._page.client, ui.dialog() as dialog, ui.card():
            ui.label("New stage")
            name = ui.input(
                "name", value="mine", validation=lambda v: _name_problem(str(v), names)
            ).props("dense outlined autofocus")
            before = ui.select(
                {"": "after all shader stages", **{n: f"before {n}" for n in shaders}},
                value=shaders[-1] if shaders else "", label="place",
            ).props("dense outlined")  # fmt: skip
            with ui.row():
                ui.button("Make", on_click=lambda: dialog.submit(True)).props("flat")
                ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat")

        async def ask() -> None:
            with self._page.client:
                wanted = await dialog
                dialog.delete()
            chosen = str(name.value)
            if wanted and _name_problem(chosen, names) is None:
                text = TEMPLATE.read_text("utf-8").replace("NAME", chosen)
                self._page.selected = chosen
                place = str(before.value) or None
                await self._page.set_code(chosen, StageCode(text, place, new=True))

        background_tasks.create(ask(), name="new stage")


def _short(file: Path) -> str:
    """The path of a shipped stage from its package."""
    root = SHADER_ROOT.parent
    return str(file.relative_to(root) if file.is_relative_to(root) else file)


def _name_problem(name: str, names: list[str]) -> str | None:
    if not _NAME.fullmatch(name):
        return "small letters, digits and _"
    return "this name is taken" if name in names else None
