"""The page of ``glsim live``: what a camera measures beside what a denoiser makes of it."""

from __future__ import annotations

from typing import Any, Final

from nicegui import Client, ui

from glsim.denoise import denoiser_names
from glsim.errors import GlsimError
from glsim.live.player import Player
from glsim.tune.buttons import icon_button, scale_menu
from glsim.tune.tab import Tab

#: The tiles: layer of the packet -> title.
_TILES: Final = [
    ["noisy", "measured"],
    ["clean", "denoised"],
    ["difference", "measured \N{MINUS SIGN} denoised"],
    ["infrared", "infrared"],
]
#: How far the colours of depth reach behind the nearest surface, mm -> words; 0: to the farthest.
_SPANS_MM: Final = {0: "colours: all depths", 2000: "nearest 2 m", 500: "nearest 0.5 m"}


class LivePage(Tab):
    """One open tab."""

    def __init__(self, player: Player, client: Client) -> None:
        super().__init__(client)
        self._player = player
        self._settling = False

    def build(self) -> None:
        """Create the elements."""
        self.add_head()
        self.follow_system_theme()
        with ui.element("main").classes("tune live"):
            with ui.element("header").classes("top"):
                self._top()
            ui.element("section").classes("view").props('id="tune-view" aria-label="images"')

    def _top(self) -> None:
        stream = self._player.stream
        ui.html("<b>glsim live</b>", sanitize=False)
        ui.label(stream.source.title).classes("word")
        self._pause = icon_button(self._pause_icon, "pause or go on (space)", self.toggle_pause)
        ui.keyboard(self._key, ignore=["input", "textarea", "select", "button"])
        names = denoiser_names()
        listed = names if stream.spec in names else [stream.spec, *names]
        self._denoiser = ui.select(listed, value=stream.spec, on_change=self._choose)
        self._denoiser.props('dense outlined options-dense aria-label="denoiser"')
        self._denoiser.style("width: 190px")
        self._around = ui.checkbox("around the face", value=stream.around == "face")
        self._around.props("dense size=sm").on_value_change(self._choose)
        self._around.tooltip("denoise the nearest head alone; the rest stays as measured")
        self._problem = ui.label("").classes("problem").props('role="status"')
        ui.element("span").classes("grow")
        spans = ui.select(_SPANS_MM, value=0, on_change=lambda e: self.call("span", e.value))
        spans.props('dense outlined options-dense aria-label="colours of depth"')
        scale_menu(self.call)
        icon_button("fit_screen", "show the whole image", lambda: self.call("fit"))
        icon_button("contrast", "dark or light", self.change_theme)
        ui.element("span").classes("rate").props('id="tune-rate" aria-label="speed"')

    async def begin(self) -> None:
        """Show the first picture; called when the browser is connected."""
        frames = self._player.stream.source.frames
        self.call("build", "tune-view", None, [], self.tab, {"kinds": _TILES, "frames": frames})
        self._player.screens.add(self)
        self._player.start()
        self._player.show_again()

    async def packet_after(self, number: int) -> bytes | None:
        """Return the next picture as ``Tab`` does; a tab that has the newest asks for another."""
        if number >= self._player.number:
            self._player.ask()
        return await super().packet_after(number)

    async def close(self) -> None:
        """Leave the player; called when the browser has gone."""
        self._player.screens.discard(self)
        await super().close()

    def say(self, problem: str) -> None:
        """Show why there is no new picture; "" takes it back."""
        if not self._closed and problem != self._problem.text:
            self._problem.set_text(problem)

    # what the user does

    @property
    def _pause_icon(self) -> str:
        return "play_arrow" if self._player.paused else "pause"

    def toggle_pause(self) -> None:
        """Keep the present frame, or go on; for all tabs."""
        player = self._player
        player.paused = not player.paused
        for screen in player.screens:
            screen.follow()
        player.ask()

    def follow(self) -> None:
        """Show the player's state, which another tab may have changed."""
        stream = self._player.stream
        self._pause.props(f"icon={self._pause_icon}")
        self._settling = True
        self._denoiser.set_value(stream.spec)
        self._around.set_value(stream.around == "face")
        self._settling = False

    async def _key(self, event: Any) -> None:
        if event.action.keydown and not event.action.repeat and event.key == " ":
            self.toggle_pause()

    async def _choose(self, _event: Any) -> None:
        if self._settling:
            return
        try:
            await self._player.choose(self._denoiser.value, "face" if self._around.value else None)
        except GlsimError as error:
            ui.notify(str(error), type="negative", multi_line=True)
        for screen in self._player.screens:
            screen.follow()


def open_page(player: Player, client: Client, _link: str) -> LivePage:
    """Build the page of a new tab."""
    page = LivePage(player, client)
    page.build()
    return page
