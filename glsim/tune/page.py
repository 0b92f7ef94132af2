"""The page of one tab: its elements, its drawing loop, and its reactions to changes."""

from __future__ import annotations

import asyncio
import time
from typing import Any

from nicegui import Client, background_tasks, ui

from glsim.errors import GlsimError
from glsim.reason import Reason
from glsim.sensors.sensor import Sensor
from glsim.tune.after_painting import AfterPainting
from glsim.tune.bench import DrawnFrame
from glsim.tune.editor import CodeEditor
from glsim.tune.packet import pack
from glsim.tune.sections import Sections
from glsim.tune.side_by_side import SideBySide
from glsim.tune.state import History, StageCode, Tuning
from glsim.tune.tab import Tab
from glsim.tune.topbar import TopBar
from glsim.tune.watched_files import WatchedFiles
from glsim.tune.workshop import Workshop

#: Pause between a painted picture and its statistics, and the same while the page plays, seconds.
_REST, _REST_PLAYING = 0.15, 1.5
#: Pause between two updates of the panel while the page plays, seconds: one takes the browser as
#: long as a picture.
_REST_PANEL = 0.5


class Page(Tab):
    """One open tab of the tuner: its history of tunings, its bench and its elements."""

    def __init__(
        self, workshop: Workshop, client: Client, start: Tuning, wanted: Tuning | None
    ) -> None:
        """Start from a tuning; undo leads from ``wanted``, of a link or the disk, to it."""
        super().__init__(client)
        self.workshop = workshop
        self.history = History(start)
        self._asked: Tuning | None = None
        self._open(wanted)
        self.bench = workshop.bench()
        self.picture: DrawnFrame | None = None
        self.selected = ""
        self._drawing = self._wanted = False
        self._files = WatchedFiles()
        self._after_painting = AfterPainting(self._newest, lambda: self.top.playing)
        self._ahead: tuple[Tuning, int | None, asyncio.Task[DrawnFrame]] | None = None

    # what is shown

    def build(self, problem: str) -> None:
        """Create the elements.

        Args:
            problem: a message about the address.
        """
        self.add_head()
        self.follow_system_theme()
        ui.on("tune_shown", self._after_painting.painted)
        with ui.element("main").classes("tune"):
            with ui.element("header").classes("top"):
                self.comparison = SideBySide(self, self._drawn, _figures)
                self.top = TopBar(self, self.comparison)
            with ui.element("nav").classes("left").props('aria-label="stages"'):
                self.sections = Sections(self, self._new_stage, self._show_code)
            ui.element("section").classes("view").props('id="tune-view" aria-label="images"')
            ui.element("aside").classes("figures").props('id="tune-figures" aria-label="figures"')
            with ui.element("section").classes("code").props('aria-label="code"'):
                self.editor = CodeEditor(self)
        if problem:
            ui.notify(problem, type="warning", timeout=12_000, close_button="ok")
        ui.timer(1.0, self._watch)

    async def begin(self) -> None:
        """Draw the first picture; called when the browser is connected."""
        self.call("build", "tune-view", "tune-figures", [r.help for r in Reason], self.tab)
        await self.refresh()
        self.editor.theme(await self.is_dark())
        if self._asked is not None:
            await self._ask_code(self._asked)
        await self.workshop.read_recording()
        self._show_recording(None)
        if self.workshop.recorded:
            self._follow_painted()

    def _open(self, wanted: Tuning | None) -> None:
        """Make a tuning of a link or the disk the current one, unless it would run new code."""
        if wanted is None:
            return
        try:
            forbidden = self.workshop.forbidden_code(wanted)
        except GlsimError:
            return  # its sensor's file is gone
        if forbidden:
            self._asked = wanted
        else:
            self.history.change(wanted)

    async def _ask_code(self, wanted: Tuning) -> None:
        """Ask whether the Python code of a link's sensor may run, and then open the link."""
        code = self.workshop.forbidden_code(wanted)
        with self.client, ui.dialog().props("persistent") as dialog, ui.card():
            ui.label("This link names a sensor with Python code, which would run with your rights:")
            for name in code:
                ui.label(name).classes("file")
            with ui.row():
                ui.button("Run it", on_click=lambda: dialog.submit(True)).props("flat")
                ui.button("Leave it", on_click=lambda: dialog.submit(False)).props("flat")
            allowed = await dialog
            dialog.delete()
        if allowed:
            self.workshop.allowed.update(code)
            self.change(wanted)

    async def rest(self) -> None:
        """Free what the tab holds, until its next picture; called when it is closed or hidden."""
        self.top.playing = False
        self._ahead = None
        self.comparison.packet = None
        await super().rest()
        await self.workshop.on_gl(self.bench.close)

    @property
    def other_packet(self) -> bytes | None:
        """The picture of setting B."""
        return self.comparison.packet

    def _new_stage(self) -> None:
        self.editor.new_stage()

    def _show_code(self, picture: DrawnFrame) -> None:
        self.editor.refresh(picture)

    # what changes

    @property
    def sensor(self) -> Sensor | None:
        """The sensor of the shown picture."""
        return self.picture.sensor if self.picture else None

    def change(self, tuning: Tuning, what: str = "") -> None:
        """Make a tuning the current one, and draw it soon.

        Args:
            what: name of the change, for undo.
        """
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
        self._present()

    async def refresh(self) -> None:
        """Draw the current tuning; while one is drawn, only the newest request waits."""
        self._wanted = True
        if self._drawing:
            return
        self._drawing = True
        try:
            while self._wanted and not self._closed:
                self._wanted = False
                tuning = self.history.now
                try:
                    await self._draw(tuning)
                except GlsimError as error:
                    self._refused(tuning, str(error))
                    continue
                self._present()
        finally:
            self._drawing = False

    async def _drawn(self, tuning: Tuning) -> DrawnFrame:
        return await self.workshop.on_gl(self.bench.draw, tuning, self.top.noise_of)

    async def _draw(self, tuning: Tuning) -> None:
        self._files.read_at = time.time()
        ahead, self._ahead = self._ahead, None
        if ahead is not None and ahead[:2] == (tuning, self.top.noise_of):
            self.picture = await ahead[2]
        else:
            self.picture = await self._drawn(tuning)

    async def packet_after(self, number: int) -> bytes | None:
        """Return the next picture as ``Tab`` does; while the page plays, begin to draw it."""
        if self.top.playing and number == self._number and not self._drawing:
            self.top.next_frame()
        return await super().packet_after(number)

    def _present(self) -> None:
        """Show the newest picture, and measure it beside the next one's drawing."""
        picture = self.picture
        if picture is None or self._closed:
            return
        self._after_painting.expect()
        number = self._number + 1
        self.publish(pack(picture.frame, number=number), number)
        with self.client:
            self.editor.problem("")
        self._follow_painted()
        if self.top.playing and self._ahead is None:
            self._draw_ahead(self.top.next_tuning())

    def _draw_ahead(self, tuning: Tuning) -> None:
        """Begin to draw a tuning's frame while the browser still takes the frame before it."""
        drawing = asyncio.create_task(self._drawn(tuning))
        # Errors are reported where the task is awaited; this only silences asyncio.
        drawing.add_done_callback(lambda task: task.cancelled() or task.exception())
        self._ahead = tuning, self.top.noise_of, drawing

    def _refused(self, tuning: Tuning, why: str) -> None:
        """Show why a tuning cannot be drawn, and return to the shown one."""
        if self._closed:
            return
        with self.client:
            self.editor.problem(why)
            self.top.stop()
            if self.picture is None or tuning == self.picture.tuning:
                return  # a file has changed; the tuning is good
            self.history.refuse(tuning)
            self.sections.refresh(self.picture)
            self.top.refresh()

    def _follow_painted(self) -> None:
        """Show the newest picture's settings in the panel, and its figures, when it is painted."""
        self._after_painting.call(self._list, 0.0, _REST_PANEL)
        self._after_painting.call(self._measure, _REST, _REST_PLAYING)

    async def _list(self, picture: DrawnFrame) -> None:
        with self.client:
            self.sections.refresh(picture)
            self.editor.refresh(picture)
            self.top.refresh()
        await self.workshop.measure(self.workshop.kept.save, self.history.now)

    async def _measure(self, picture: DrawnFrame) -> None:
        figures = await self.workshop.measure(_figures, picture)
        self.call("statistics", figures, self.comparison.figures)
        if self.workshop.recorded and not self.top.playing:
            from glsim.tune.recording import tuned_figures

            here = await self.workshop.measure(tuned_figures, [picture.frame])
            self._show_recording(here)

    def _show_recording(self, here: dict[str, Any] | None) -> None:
        if self.workshop.recorded:
            self.call("recording", self.workshop.recorded, here)

    def _newest(self) -> DrawnFrame | None:
        return None if self._closed else self.picture

    # looks, and files that change elsewhere

    async def change_theme(self) -> bool:
        """Change between dark and light."""
        dark = await super().change_theme()
        self.editor.theme(dark)
        return dark

    async def _watch(self) -> None:
        """Reload the sensor's own files when an editor outside has changed them."""
        if self.sensor is not None and self._files.have_changed(self.sensor):
            self.bench.reload()
            self.sections.reload()
            await self.refresh()


def open_page(workshop: Workshop, client: Client, link: str) -> Page:
    """Build the page of a new tab. link: of its address, or ""."""
    wanted, problem = workshop.wanted(link)
    page = Page(workshop, client, workshop.start, wanted)
    page.build(problem)
    return page


def _figures(picture: DrawnFrame) -> dict[str, Any]:
    from glsim.tune.statistics import frame_statistics, silhouette_widths  # takes 0.2 s

    return {
        **frame_statistics(picture.frame, picture.normal),
        "silhouettes": silhouette_widths(picture.frame),
        "milliseconds": round(picture.milliseconds, 1),
    }
