"""Speed of the page of glsim tune, measured in Chromium: python -m benchmarks.tune [--changes 6].

Slider to picture: the time from an arrow key on a slider to the painted images and surface, for the
first slider of each stage in turn: the median over all stages, and that of the slowest stage.
Pictures a second: painted while the page plays for ten seconds. Both with the 3D surface, for the
window of a head, and for whole frames of 512x424 (a head before a wall, 54,000 quads in 3D).
First picture: from the start of the command to the page's first images, the browser's start
included. Needs the extra glsim[tune], Playwright and Chromium.
"""

from __future__ import annotations

import argparse
import itertools
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from glsim.errors import GlsimError

#: Scenes: options of the command line.
SCENES = {
    "window of a head": (),
    "whole frame, 512x424": ("--set", "scene.wall_mm=2500"),
}
#: Chromium as root. Without a GPU it composes pages on the CPU and has WebGL2 only if asked for it.
_FLAGS, _WEBGL = ["--no-sandbox"], ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
#: Patience with a busy machine, seconds.
_PATIENCE_S = 300.0
#: A slider that has not moved gives no picture.
_REFUSED_MS = 5000


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--sensor", default="kinect-v2")
    parser.add_argument("--changes", type=int, default=6, help="changes of each slider")
    parser.add_argument("--play", type=float, default=10.0, help="seconds of playing")
    arguments = parser.parse_args()
    table = Table(title=f"glsim tune {arguments.sensor}, {os.cpu_count()} cores")
    for name in (
        "scene",
        "first picture, s",
        "slider to picture, ms",
        "slowest stage, ms",
        "pictures/s",
    ):
        table.add_column(name, justify="left" if name == "scene" else "right")
    for scene, options in SCENES.items():
        with tune_page([arguments.sensor, *options]) as (page, first_s):
            times = slider_times(page, arguments.changes)
            rate = playing_rate(page, arguments.play)
        medians = {stage: statistics.median(of_stage) for stage, of_stage in times.items()}
        slowest = max(medians, key=lambda stage: medians[stage])
        median = statistics.median(itertools.chain(*times.values()))
        table.add_row(
            scene,
            f"{first_s:.1f}",
            f"{median:.0f}",
            f"{medians[slowest]:.0f} ({slowest})",
            f"{rate:.1f}",
        )
    Console().print(table)


@contextmanager
def chromium_page(*, webgl: bool = False, **options: Any) -> Iterator[Any]:
    """Yield an empty page of 1280x800 in Chromium.

    Raises GlsimError if Chromium or Playwright is missing.

    Args:
        options: of the browser's context.
        webgl: draw with WebGL2, on the CPU if there is no GPU; composing pages then takes longer
            too.
    """
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise GlsimError("chromium is not installed: apt-get install chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise GlsimError("playwright is not installed: pip install playwright") from None
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=chromium, args=_FLAGS + (_WEBGL if webgl else [])
        )
        page = browser.new_context(viewport={"width": 1280, "height": 800}, **options).new_page()
        page.set_default_timeout(1000 * _PATIENCE_S)
        yield page
        browser.close()


@contextmanager
def tune_page(words: Sequence[str], **options: Any) -> Iterator[tuple[Any, float]]:
    """Run ``glsim tune`` with these command-line arguments and open its page in a browser.

    Yields what ``served_page`` yields.
    """
    with served_page(["tune", *words], **options) as (page, first_s):
        page.wait_for_selector("[data-stage]")
        yield page, first_s


@contextmanager
def served_page(words: Sequence[str], **options: Any) -> Iterator[tuple[Any, float]]:
    """Run a command of glsim that serves a page and open the page in a browser.

    Args:
        words: the command and its arguments.
        **options: of the browser's window, as in ``chromium_page``.

    Yields Playwright's page, and the seconds from the command to the first picture.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        start = time.perf_counter()
        with log.open("wb") as out:
            command = [sys.executable, "-m", "glsim", *words, "--no-browser", "--port", "0"]
            environment = {**os.environ, "COLUMNS": "300"}
            server = subprocess.Popen(command, stdout=out, stderr=out, env=environment)
        try:
            with chromium_page(**options) as page:
                page.goto(_address(server, log))
                page.wait_for_selector("#tune-view[data-shown]")
                yield page, time.perf_counter() - start
        finally:
            server.terminate()
            server.wait(60)


def _address(server: subprocess.Popen[bytes], log: Path) -> str:
    """Return the address that the command prints. Raises GlsimError if it prints none."""
    end = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end and server.poll() is None:
        if found := re.search(r"http://\S+", log.read_text()):
            return found[0]
        time.sleep(0.02)
    raise GlsimError(f"glsim gave no address: {log.read_text().strip()}")


def shown(page: Any) -> int:
    """Return the number of the picture that the page shows."""
    return int(page.get_attribute("#tune-view", "data-shown"))


def after(page: Any, number: int) -> None:
    """Wait for a later picture than ``number``."""
    page.wait_for_function(f"+document.querySelector('#tune-view').dataset.shown > {number}")


def slider_times(page: Any, changes: int) -> dict[str, list[float]]:
    """Return stage -> ms to each painted picture of ``changes`` keys on its first slider."""
    from playwright.sync_api import TimeoutError as NothingPainted

    times: dict[str, list[float]] = {}
    for stage in page.eval_on_selector_all("[data-stage]", "all => all.map(e => e.dataset.stage)"):
        page.click(f'[data-stage="{stage}"] button.name')
        page.wait_for_timeout(1000)
        slider = page.query_selector("[data-name] .q-slider__track-container")
        if slider is None:
            continue
        slider.focus()
        page.evaluate("glsimTune.state.times.length = 0")
        painted: list[float] = []
        for number in range(changes):
            page.keyboard.press("ArrowRight" if number % 2 else "ArrowLeft")
            try:
                page.wait_for_function("glsimTune.state.times.length", timeout=_REFUSED_MS)
                painted += page.evaluate("glsimTune.state.times.splice(0)")
            except NothingPainted:  # the slider was at its end
                page.evaluate("glsimTune.state.pressed = 0")
            page.wait_for_timeout(300)  # the statistics of the last picture are done
        if painted:
            times[stage] = painted
    return times


def playing_rate(page: Any, seconds: float) -> float:
    """Let the page play for some seconds; return the pictures that it painted a second."""
    page.click('[aria-label="play or stop"]')
    number = shown(page)
    after(page, number + 2)
    painted, start = page.evaluate("[glsimTune.state.painted, performance.now()]")
    page.wait_for_timeout(1000 * seconds)
    count, end = page.evaluate("[glsimTune.state.painted, performance.now()]")
    page.click('[aria-label="play or stop"]')
    return float(1000 * (count - painted) / (end - start))


if __name__ == "__main__":
    main()
