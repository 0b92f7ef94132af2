"""Make docs/figures/tune*.png, live.png and tune.webp: python -m scripts.tune_figures.

Photographs of the pages of ``glsim tune`` and ``glsim live`` in Chromium, light and dark, and a
moving picture of a minute's work: a slider, a turned surface, a mistake in the code, A beside B.
Needs the extra glsim[tune], Playwright, Pillow and Chromium; takes a minute or two.
"""

from __future__ import annotations

import argparse
import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from PIL import Image

from benchmarks.tune import after, chromium_page, served_page, shown, tune_page
from glsim.cli import main as main_of_glsim
from glsim.files.atomic import write_atomic
from glsim.gl.includes import SHADER_ROOT
from glsim.tune.static_page import write_static_page

FIGURES = Path(__file__).resolve().parents[1] / "docs" / "figures"
#: What the pages show: a head that looks to the side, before a wall.
_SCENE: Final = ("--set", "scene.wall_mm=1500", "--set", "pose.yaw_deg=-20")
#: Width of the moving picture, px: text is readable, and it takes less than 1.5 MB.
_WIDTH: Final = 960
#: How long a photograph of the moving picture stands, ms.
_SHORT, _LONG = 140, 1500


def main() -> None:
    """Write all figures."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for dark, name in ((False, "tune.png"), (True, "tune_dark.png")):
        scheme = "dark" if dark else "light"
        with tune_page(["kinect-v2", *_SCENE], color_scheme=scheme) as (page, _):
            _open(page, "tof_taps")
            _write(_photograph(page), FIGURES / name)
            if not dark:
                _film(page, FIGURES / "tune.webp")
    with tune_page(["realsense-d435", *_SCENE, "--set", "pose.distance_mm=600"]) as (page, _):
        _open(page, "stereo_light")
        page.hover('[data-kind="disparity"]')
        _write(_photograph(page), FIGURES / "tune_stereo.png")
    with tempfile.TemporaryDirectory() as folder:
        write_static_page(Path(folder), sensors=["kinect-v2", "kinect-v1"])
        for name, scheme in (("tune_static.png", "light"), ("tune_static_dark.png", "dark")):
            with chromium_page(webgl=True, color_scheme=scheme) as page:
                page.goto((Path(folder) / "index.html").as_uri() + "#scene=wall")
                page.wait_for_selector("body[data-frames]")
                page.wait_for_timeout(1500)
                _write(_photograph(page), FIGURES / name)

    _photograph_live(FIGURES / "live.png")


def _photograph_live(file: Path) -> None:
    """Photograph ``glsim live`` on frames of one person before a wall."""
    with tempfile.TemporaryDirectory() as folder:
        data = str(Path(folder) / "a person")
        size = ["--subjects", "1", "--frames-per-subject", "12", "-q"]
        layers = ["--layers", "clean,noisy,infrared"]
        if status := main_of_glsim(["generate", "-o", data, *size, *layers, *_SCENE]):
            raise SystemExit(status)
        with served_page(["live", data, "-d", "face", "--around", "face"]) as (page, _):
            page.locator('[aria-label="colours of depth"]').click()
            page.locator(".q-item", has_text="nearest 0.5 m").click()
            page.mouse.move(900, 740)
            page.wait_for_timeout(9000)  # the rate stands
            _write(_photograph(page), file)


def _open(page: Any, stage: str) -> None:
    """Open a stage, and wait until the statistics stand."""
    page.click(f'[data-stage="{stage}"] button.name')
    page.wait_for_selector(f'[data-stage="{stage}"].selected')
    page.wait_for_selector("#tune-figures .reasons td")
    page.mouse.move(660, 560)  # no tooltip
    page.wait_for_timeout(1500)


def _photograph(page: Any) -> Image.Image:
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def _write(picture: Image.Image, file: Path) -> None:
    stream = io.BytesIO()
    picture.save(stream, "PNG", optimize=True)
    write_atomic(stream.getvalue(), file)


def _film(page: Any, file: Path) -> None:
    """Work in the page and write the photographs as an animated WebP."""
    photographs: list[Image.Image] = []
    times: list[int] = []

    def take(milliseconds: int = _SHORT) -> None:
        picture = _photograph(page)
        height = round(_WIDTH * picture.height / picture.width)
        photographs.append(picture.resize((_WIDTH, height), Image.Resampling.LANCZOS))
        times.append(milliseconds)

    take(_LONG)
    _move_slider(page, take)
    _turn(page, take)
    _mistake(page, take)
    _compare(page, take)
    stream = io.BytesIO()
    photographs[0].save(
        stream, "WEBP", save_all=True, append_images=photographs[1:], duration=times, loop=0,
        quality=60, method=4,
    )  # fmt: skip
    write_atomic(stream.getvalue(), file)


def _move_slider(page: Any, take: Callable[..., None]) -> None:
    """Move a slider of the open stage."""
    slider = page.locator('[data-name="tof_taps.read_variance"] .q-slider__track-container')
    slider.focus()
    for _ in range(12):
        number = shown(page)
        for _ in range(10):
            page.keyboard.press("ArrowRight")
        after(page, number)
        page.wait_for_timeout(400)
        take()
    page.wait_for_timeout(1000)
    take(_LONG)


def _turn(page: Any, take: Callable[..., None]) -> None:
    page.focus('[data-kind="surface"]')
    for _ in range(10):
        page.keyboard.press("ArrowLeft")
        page.wait_for_timeout(150)
        take()
    take(_LONG // 2)


def _mistake(page: Any, take: Callable[..., None]) -> None:
    page.click('[data-stage="tof_floor"] button.name')
    page.wait_for_selector('[data-name="tof_floor.sigma_mm"]')
    page.wait_for_timeout(400)
    page.click(".cm-content")
    page.keyboard.press("Control+Home")
    page.keyboard.press("ArrowDown")
    page.keyboard.insert_text("uniform float shift_mm = ;\n")
    page.wait_for_selector(".cm-line.wrong")
    page.wait_for_timeout(400)
    take(_LONG)
    first, rest = (SHADER_ROOT / "tof/tof_floor.glsl").read_text().split("\n", 1)
    page.keyboard.press("Control+a")
    page.keyboard.insert_text(
        f"{first}\nuniform float shift_mm = 5.0; //@ [0, 50] mm farther\n{rest}"
    )
    page.keyboard.press("Control+Home")
    page.wait_for_selector('[data-name="tof_floor.shift_mm"] .q-slider')
    page.wait_for_timeout(800)
    take(_LONG)


def _compare(page: Any, take: Callable[..., None]) -> None:
    page.click('[aria-label="compare"]')
    page.click("text=Keep these settings as B")
    page.wait_for_function("glsimTune.state.other")
    number = shown(page)
    page.click('[data-stage="tof_floor"] .q-toggle')
    after(page, number)
    page.mouse.move(660, 560)
    page.wait_for_timeout(1500)
    take(_LONG)
    box = page.locator('[data-kind="difference"]').bounding_box()
    middle = box["y"] + 0.5 * box["height"]
    page.mouse.move(box["x"] + 0.5 * box["width"], middle)
    page.mouse.down()
    for share in (0.4, 0.3, 0.2, 0.35, 0.5, 0.65, 0.8, 0.65, 0.5):
        page.mouse.move(box["x"] + share * box["width"], middle)
        page.wait_for_timeout(150)
        take()
    page.mouse.up()
    take(_LONG)


if __name__ == "__main__":
    main()
