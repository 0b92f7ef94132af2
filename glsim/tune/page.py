"""The page of one tab: what is shown, and what happens when something is moved."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import Client, background_tasks, ui

from glsim.errors import GlsimError
from glsim.reason import Reason
from glsim.sensors.sensor import Sensor, sensor_names
from glsim.tune.bench import Bench, Picture
from glsim.tune.editor import CodeEditor
from glsim.tune.outputs import Outputs
from glsim.tune.packet import pack
from glsim.tune.recording import measure_frames
from glsim.tune.sections import Sections
from glsim.tune.state import History, StageCode, Tuning
from glsim.tune.statistics import frame_statistics, silhouette_widths
from glsim.tune.workshop import Workshop

_HEAD = """
<link rel="stylesheet" href="/tune/assets/tune.css">
<script>window.tuneCall = (name, ...given) => window.glsimTune
  ? window.glsimTune[name](...given) : (window.tuneQueue ??= []).push([name, given]);</script>
<script type="module" src="/tune/assets/tune.js"></script>
"""


class Page:
    """One open tab: its history of tunings, its bench and its elements."""

    def __init__(self, workshop: Workshop, client: Client, start: Tuning) -> None:
        self.workshop, self.client, self.tab = workshop, client, client.id
        self.history = History(start)
        self.bench = Bench(workshop.base, workshop.open_sources, workshop.backend)
        self.picture: Picture | None = None
        self.selected = ""
        self.playing = self.locked = False
        self.second: Tuning | None = None
        self._second_figures: dict[str, Any] | None = None
        self._number = 0
        self._drawing = self._wanted = self._measuring = self._closed = False
        self._presenting, self._held = False, 0
        self._files: dict[Path, float] = {}

    # what is shown

    def build(self, problem: str) -> None:
        """Create the elements. problem: a message about the address."""
        ui.add_head_html(_HEAD)
        self.dark = ui.dark_mode(None)
        ui.on("tune_shown", self._shown)
        with ui.element("main").classes("tune"):
            with ui.element("header").classes("top"):
                self._top()
            with ui.element("nav").classes("left").props('aria-label="stages"'):
                self.sections = Sections(self, self._new_stage, self._show_code)
            ui.element("section").classes("view").props('id="tune-view" aria-label="images"')
            ui.element("aside").classes("figures").props('id="tune-figures" aria-label="figures"')
            with ui.element("section").classes("code").props('aria-label="code"'):
                self.editor = CodeEditor(self)
        if problem:
            ui.notify(problem, type="warning")
        ui.timer(1.0, self._watch)

    def _top(self) -> None:
        ui.html("<b>glsim tune</b>", sanitize=False)
        names = sensor_names()
        own = self.history.now.sensor
        self._sensor = (
            ui.select(
                names if own in names else [own, *names], value=own, on_change=self._to_sensor
            )
            .props('dense outlined options-dense aria-label="sensor"')
            .style("width: 168px")
        )
        self._play = ui.button(icon="play_arrow", on_click=self.toggle_play)
        self._play.props('flat dense aria-label="play or stop"').tooltip("play: frame after frame")
        self._frame = (
            ui.number(value=self.history.now.frame, min=0, format="%d", on_change=self._to_frame)
            .props('dense outlined aria-label="frame"')
            .classes("number")
            .style("width: 62px")
        )
        self._frame.tooltip("number of the frame: expression, pose and noise")
        ui.checkbox("same noise", on_change=self._lock).props("dense size=sm").tooltip(
            "keep the noise of this frame while others are shown"
        )
        ui.label("seed").classes("word")
        self._seed = ui.number(value=self._seed_now(), min=0, format="%d", on_change=self._to_seed)
        self._seed.props('dense outlined debounce=400 aria-label="seed"').classes("number")
        self._seed.style("width: 62px").tooltip("other people, other noise")
        ui.element("span").classes("grow")
        self._undo = ui.button(icon="undo", on_click=self.undo).props(
            'flat dense aria-label="undo"'
        ).tooltip("undo (Ctrl+Z)")  # fmt: skip
        self._redo = ui.button(icon="redo", on_click=self.redo).props(
            'flat dense aria-label="redo"'
        ).tooltip("redo (Ctrl+Shift+Z)")  # fmt: skip
        ui.keyboard(self._key, ignore=["input", "textarea", "select"])
        with ui.button("A | B").props('flat dense aria-label="compare"'), ui.menu():
            ui.menu_item("Keep these settings as B", self.keep_second)
            ui.menu_item("Change places of A and B", self.swap)
            ui.menu_item("Show A alone", self.drop_second)
        with ui.button("± 10 mm").props("flat dense") as scale, ui.menu():
            scale.tooltip("range of colours of the difference")
            for mm in (2, 5, 10, 20, 50, 100):
                ui.menu_item(f"± {mm} mm", lambda mm=mm: self._scale(scale, mm))
        ui.button(icon="fit_screen", on_click=lambda: self.call("fit")).props(
            'flat dense aria-label="show all"'
        ).tooltip("show the whole surface")  # fmt: skip
        self.outputs = Outputs(self)
        ui.button(icon="contrast", on_click=self._theme).props(
            'flat dense aria-label="dark or light"'
        ).tooltip("dark or light")  # fmt: skip

    async def begin(self) -> None:
        """Draw the first picture; called when the browser is connected."""
        self.call("build", "tune-view", "tune-figures", [r.help for r in Reason], self.tab)
        await self.refresh()
        await self.workshop.read_recording()
        self._show_recording(None)
        if self.workshop.recorded:
            await self._measure()

    async def rest(self) -> None:
        """Free what the tab holds, until its next picture; called when it is closed or hidden."""
        self.playing = False
        for which in ("a", "b"):
            self.workshop.packets.pop(f"{self.tab}/{which}", None)
        await self.workshop.on_gl(self.bench.close)

    async def close(self) -> None:
        """Free all; called when the browser has gone."""
        self._closed = True
        await self.rest()

    def call(self, name: str, *given: Any) -> None:
        """Call a function of assets/tune.js."""
        if not self._closed:
            listed = ", ".join(json.dumps(value) for value in (name, *given))
            self.client.run_javascript(f"tuneCall({listed})")

    def _new_stage(self) -> None:
        self.editor.new_stage()

    def _show_code(self, picture: Picture) -> None:
        self.editor.refresh(picture)

    # what changes

    @property
    def sensor(self) -> Sensor | None:
        """The sensor of the shown picture."""
        return self.picture.sensor if self.picture else None

    def change(self, tuning: Tuning, what: str = "") -> None:
        """Make a tuning the current one, and draw it soon. what: name of the change, for undo."""
        if self.history.change(tuning, what):
            background_tasks.create(self.refresh(), name="glsim tune")

    def set_value(self, name: str, value: Any) -> None:
        """Change one value by its name of ``--set``; None takes it back."""
        self.change(self.history.now.with_value(name, value), name)

    async def set_code(self, stage: str, code: StageCode | None) -> None:
        """Change the GLSL of a stage. Code that does not compile is marked and changes nothing."""
        tuning = self.history.now.with_code(stage, code)
        if tuning == self.history.now:
            self.editor.mark("")
            return
        try:
            await self._draw(tuning)
        except GlsimError as error:
            self.editor.mark(str(error))
            return
        self.editor.mark("")
        self.history.change(tuning, f"code {stage}")
        await self._present()

    async def undo(self) -> None:
        """Go one step back."""
        self.history.undo()
        await self.refresh()

    async def redo(self) -> None:
        """Go one step forward."""
        self.history.redo()
        await self.refresh()

    async def refresh(self) -> None:
        """Draw the current tuning; while one is drawn, only the newest request waits."""
        self._wanted = True
        if self._drawing:
            return
        self._drawing = True
        try:
            while self._wanted and not self._closed:
                self._wanted = False
                try:
                    await self._draw(self.history.now)
                except GlsimError as error:
                    self.editor.problem(str(error))
                    continue
                await self._present()
        finally:
            self._drawing = False

    async def _draw(self, tuning: Tuning) -> None:
        noise_of = self._held if self.locked else None
        drawn = await self.workshop.on_gl(self.bench.draw, tuning, noise_of)
        self.picture = drawn
        self.workshop.packets[f"{self.tab}/a"] = pack(drawn.frame)

    async def _present(self) -> None:
        picture = self.picture
        if picture is None or self._closed:
            return
        self._number += 1
        self.call("show", f"/tune/frame/{self.tab}/a?n={self._number}", self._number)
        with self.client:
            self.editor.problem("")
            self.sections.refresh(picture)
            self.editor.refresh(picture)
            self.outputs.refresh(self.history.now)
        self._presenting = True
        self._sensor.set_value(self.history.now.sensor)
        self._frame.set_value(self.history.now.frame)
        self._seed.set_value(self._seed_now())
        self._presenting = False
        self._undo.set_enabled(self.history.can_undo)
        self._redo.set_enabled(self.history.can_redo)
        if not self._measuring:
            await self._measure()

    async def _measure(self) -> None:
        """Measure the newest picture; what was drawn meanwhile is measured next."""
        self._measuring = True
        try:
            measured = None
            while self.picture is not None and self.picture is not measured and not self._closed:
                measured = self.picture
                figures = await self.workshop.measure(_figures, measured)
                self.call("statistics", figures, self._second_figures)
                if self.workshop.recorded and not self.playing:
                    here = await self.workshop.measure(measure_frames, [measured.frame])
                    self._show_recording(here)
        finally:
            self._measuring = False

    def _show_recording(self, here: dict[str, Any] | None) -> None:
        if self.workshop.recorded:
            self.call("recording", self.workshop.recorded, here)

    # time

    def toggle_play(self) -> None:
        """Start or stop showing frame after frame."""
        self.playing = not self.playing
        self._play.props(f"icon={'stop' if self.playing else 'play_arrow'}")
        if self.playing:
            self._next_frame()

    def _shown(self) -> None:
        if self.playing:
            self._next_frame()

    def _next_frame(self) -> None:
        count = self.picture.frames if self.picture else 1
        tuning = self.history.now
        self.change(replace(tuning, frame=(tuning.frame + 1) % count), "frame")

    def _to_frame(self, event: Any) -> None:
        if event.value is not None and not self._presenting:
            self.change(replace(self.history.now, frame=int(event.value)), "frame")

    async def _lock(self, event: Any) -> None:
        self.locked, self._held = bool(event.value), self.history.now.frame
        await self.refresh()

    def _seed_now(self) -> int:
        return int(self.history.now.values.get("seed", self.workshop.base.seed))

    def _to_seed(self, event: Any) -> None:
        if event.value is not None and not self._presenting:
            self.set_value("seed", int(event.value))

    def _to_sensor(self, event: Any) -> None:
        if event.value != self.history.now.sensor and not self._presenting:
            tuning = self.history.now
            own = ("pose.", "scene.", "seed")
            kept = {k: v for k, v in tuning.values.items() if k.startswith(own)}
            self.selected = ""
            self.change(Tuning(event.value, kept, {}, tuning.frame))

    async def _key(self, event: Any) -> None:
        if event.action.keydown and str(event.key).lower() == "z" and event.modifiers.ctrl:
            await (self.redo() if event.modifiers.shift else self.undo())

    # A and B

    async def keep_second(self) -> None:
        """Keep the current settings as B."""
        await self._show_second(self.history.now)

    async def swap(self) -> None:
        """Make B the current settings, and the current ones B."""
        if self.second is not None:
            first, second = self.history.now, self.second
            await self._show_second(first)
            self.change(second)

    async def drop_second(self) -> None:
        """Show the current settings alone."""
        self.second = self._second_figures = None
        self.call("showOther", None)
        await self.refresh()

    async def _show_second(self, tuning: Tuning) -> None:
        try:
            drawn = await self.workshop.on_gl(self.bench.draw, tuning, None)
        except GlsimError as error:
            ui.notify(str(error), type="negative")
            return
        self.second = tuning
        self.workshop.packets[f"{self.tab}/b"] = pack(drawn.frame)
        self._number += 1
        self.call("showOther", f"/tune/frame/{self.tab}/b?n={self._number}")
        self._second_figures = await self.workshop.measure(_figures, drawn)
        await self.refresh()

    # looks, and files that change elsewhere

    def _scale(self, button: Any, mm: int) -> None:
        button.text = f"± {mm} mm"
        self.call("scale", mm)

    async def _theme(self) -> None:
        dark = await ui.run_javascript("document.body.classList.contains('body--dark')")
        self.dark.set_value(not dark)
        self.editor.theme(not dark)
        self.call("themed")

    async def _watch(self) -> None:
        """Reload the sensor's own files when an editor outside has changed them."""
        if self.sensor is None:
            return
        files = {self.sensor.file, *(Path(s.spec.file) for s in self.sensor.stages)}
        times = {f: f.stat().st_mtime for f in files if f.is_file()}
        known, self._files = self._files, times
        if any(known.get(f, t) != t for f, t in times.items()):
            self.bench.reload()
            await self.refresh()


def _figures(picture: Picture) -> dict[str, Any]:
    return {
        **frame_statistics(picture.frame, picture.normal),
        "silhouettes": silhouette_widths(picture.frame),
        "milliseconds": round(picture.milliseconds, 1),
    }
