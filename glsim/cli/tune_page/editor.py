"""Code editor of the selected stage, which compiles while the user types."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

from nicegui import background_tasks, ui

from glsim.cli.tune_page.preview import Picture, marked_lines
from glsim.cli.tune_page.tab import TuneTab
from glsim.cli.tune_page.tuning import StageCode
from glsim.gl.includes import display_name
from glsim.noise.stage import Stage

_TEMPLATE = Path(__file__).parent / "assets" / "template.glsl"
#: Seconds from the last key to the compilation.
_PAUSE = 0.25
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


class CodeEditor:
    """Code editor with a title and the messages of the OpenGL driver."""

    def __init__(self, page: TuneTab) -> None:
        self._page = page
        self._stage: Stage | None = None
        self._text = ""
        self._wanted, self._wrong = 0, False
        with ui.element("div").classes("bar"):
            self._name = ui.label().style("font-weight: 600")
            self._file = ui.label().classes("file")
            ui.element("span").classes("grow")
            self._status = ui.label().classes("file").props('role="status"')
            self._reset = ui.button("Back to the file's", on_click=self._back)
            self._reset.props("flat dense size=sm")
        self._problem = ui.label().classes("problem").props('role="alert"')
        self._problem.set_visibility(False)
        with ui.element("div").classes("editor"):
            self._editor = ui.codemirror("", language="C++", on_change=self._typed)
            self._editor.set_theme("vscodeDark")

    def refresh(self, picture: Picture) -> None:
        """Show the code of the selected stage, unless the user is typing."""
        stages = {stage.name: stage for stage in picture.sensor.stages}
        before = self._stage.name if self._stage else ""
        wanted = next((n for n in (self._page.selected, before, *stages) if n in stages), None)
        if wanted is None:
            return
        stage, code = stages[wanted], self._page.history.now.code.get(wanted)
        self._reset.set_visibility(code is not None)
        self._name.text = wanted
        self._file.text = "changed here" if code else display_name(Path(stage.spec.file))
        if stage.spec.source is None:
            text = "// This stage is Python code, which the page does not change.\n"
        else:
            text = code.text if code else Path(stage.spec.file).read_text("utf-8")
        if wanted != before or (text != self._text and not self._wrong):
            self._stage, self._text = stage, text
            self._editor.set_value(text)
            self.mark("")
        self._stage = stage

    def mark(self, message: str) -> None:
        """Mark the lines that a driver message names; an empty message clears the marks."""
        name = Path(self._stage.spec.file).name if self._stage else ""
        last = self._text.count("\n") + 1
        lines = {n: text for n, text in marked_lines(message, name).items() if 1 <= n <= last}
        self._wrong = bool(message)
        self._editor.decorations = [
            {"kind": "line", "line": n, "class": "wrong", "attributes": {"data-wrong": str(n)}}
            for n in lines
        ]
        self._editor.line_tooltips = lines
        self._say("  ".join(f"line {n}: {text}" for n, text in lines.items()) or message)
        self._status.text = "the last good code runs" if message else ""

    def problem(self, message: str) -> None:
        """Show a message that does not concern the code; an empty message clears it."""
        if not self._wrong:
            self._say(message)

    def _say(self, message: str) -> None:
        self._problem.text = message
        self._problem.set_visibility(bool(message))

    async def _typed(self, event: Any) -> None:
        text, stage = str(event.value), self._stage
        if text == self._text or stage is None or stage.spec.source is None:
            return
        self._text = text
        self._wanted += 1
        number = self._wanted
        await asyncio.sleep(_PAUSE)
        if number == self._wanted and self._stage and stage.name == self._stage.name:
            code = self._page.history.now.code.get(stage.name, StageCode(""))
            await self._page.set_code(stage.name, StageCode(text, code.before, code.new))

    async def _back(self) -> None:
        if self._stage is not None:
            name, self._wrong = self._stage.name, False
            await self._page.set_code(name, None)

    async def new_stage(self) -> None:
        """Ask the user for name and place of a new stage, and add it."""
        picture = self._page.picture
        if picture is None:
            return
        names = [stage.name for stage in picture.sensor.stages]
        shaders = [s.name for s in picture.sensor.stages if s.spec.source is not None]

        def problem_of(value: Any) -> str | None:
            if not _NAME.fullmatch(str(value)):
                return "small letters, digits and _"
            return "this name is taken" if value in names else None

        with self._page.client, ui.dialog() as dialog, ui.card():
            ui.label("New stage")
            name = ui.input("name", value="mine", validation=problem_of)
            name.props("dense outlined autofocus")
            places = {"": "after all shader stages", **{n: f"before {n}" for n in shaders}}
            place = ui.select(places, value=(["", *shaders])[-1], label="place")
            place.props("dense outlined")
            with ui.row():
                ui.button("Make", on_click=lambda: dialog.submit(True)).props("flat")
                ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat")

        async def ask() -> None:
            made = await dialog
            dialog.delete()
            if made and problem_of(name.value) is None:
                text = _TEMPLATE.read_text("utf-8").replace("NAME", name.value)
                self._page.selected = name.value
                await self._page.set_code(
                    name.value, StageCode(text, str(place.value) or None, new=True)
                )

        background_tasks.create(ask(), name="new stage")
