"""The page in Debian's Chromium: what a user moves, types and saves.

One server and one browser serve all tests; the sensor is small, so that a frame takes milliseconds.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from glsim.cli import main
from glsim.core.files.png import read_image
from glsim.faces.sources.procedural import ProceduralFaces

pytest.importorskip("nicegui", reason="the extra glsim[tune] is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
]

#: Patience, not a limit of speed: a busy machine compiles the first shaders for a minute.
PATIENCE_MS = 180_000

SENSOR = """# A small sensor.
title = "small"
[rig]
width = 96      # pixels
height = 80
focal_px = [80, 80]
centre_px = [48, 40]

# Noise along the axis.
[[stage]]
use = "axial"
base_sigma_mm = 3   # loud

[[stage]]
use = "range_gate"
near_mm = 300
"""


@dataclass
class Server:
    folder: Path
    process: subprocess.Popen[bytes]

    @property
    def address(self) -> str:
        """The printed address, with the token."""
        return re.findall(r"http://\S+", (self.folder / "log").read_text())[0]

    @property
    def root(self) -> str:
        """The address without the token."""
        return self.address.partition("?")[0]


def start(folder: Path, *options: str) -> Server:
    """Start ``glsim tune`` in a folder, and wait for its address."""
    log = folder / "log"
    words = [sys.executable, "-m", "glsim", "tune", *options, "--no-browser"]
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    environment = {**kept, "PYTHONPATH": str(Path(__file__).parents[2]), "COLUMNS": "300"}
    environment["GLSIM_CACHE"] = str(folder / "cache")
    with log.open("wb") as out:
        process = subprocess.Popen(words, cwd=folder, env=environment, stdout=out, stderr=out)
    for _ in range(PATIENCE_MS // 100):
        if re.search(r"http://\S+\s", log.read_text()) or process.poll() is not None:
            break
        time.sleep(0.1)
    assert process.poll() is None, log.read_text()
    return Server(folder, process)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("tune")
    (folder / "small.toml").write_text(SENSOR)
    (folder / "head.obj").write_text(_face())
    options = ["small.toml", "--face", "head.obj", "--port", "0"]
    running = start(folder, *options, "--set", "scene.wall_mm=1500")
    try:
        yield running
    finally:
        running.process.terminate()
        running.process.wait()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as running:
        opened = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def page(server: Server, browser: Any) -> Iterator[Any]:
    """One tab for all tests, with the messages of its console in ``page.said``."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    opened = context.new_page()
    opened.set_default_timeout(PATIENCE_MS)
    opened.said, opened.asked = [], []
    opened.on("request", lambda request: opened.asked.append(request.url))
    opened.on("console", lambda m: opened.said.append(m.text) if m.type == "error" else None)
    opened.on("pageerror", lambda error: opened.said.append(str(error)))
    opened.goto(server.address)
    opened.wait_for_selector("#tune-view[data-shown]")
    opened.wait_for_selector("[data-stage]")
    opened.wait_for_timeout(500)  # errors of drawing come after the first frame
    assert not opened.said, opened.said
    yield opened
    context.close()


def _face() -> str:
    """An embedded head as an OBJ file: a mesh in which a face is found."""
    source = ProceduralFaces(seed=7)
    vertices, faces = source.neutral(source.subjects(1)[0])
    lines = [f"v {x:.2f} {y:.2f} {z:.2f}" for x, y, z in vertices]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in faces + 1)]) + "\n"


def shown(page: Any) -> int:
    return int(page.get_attribute("#tune-view", "data-shown"))


def after(page: Any, number: int) -> None:
    page.wait_for_function(f"+document.querySelector('#tune-view').dataset.shown > {number}")


def pixels(page: Any) -> list[int]:
    """The noisy layer that the page shows."""
    return list(page.evaluate("Array.from(glsimTune.state.picture.layers.noisy)"))


def undo(page: Any) -> None:
    number = shown(page)
    page.click('[aria-label="undo"]')
    after(page, number)


def new_tab(page: Any) -> Any:
    """Open another tab of a page's, or a context's, browser."""
    opened = getattr(page, "context", page).new_page()
    opened.set_default_timeout(PATIENCE_MS)
    return opened


def select(page: Any, stage: str) -> None:
    page.click(f'[data-stage="{stage}"] button.name')
    page.wait_for_selector(f'[data-stage="{stage}"].selected')


def test_a_moved_slider_gives_other_pixels_and_undo_the_former(page: Any) -> None:
    before = pixels(page)
    select(page, "axial")
    number = shown(page)
    page.focus('[data-name="axial.base_sigma_mm"] .q-slider__track-container')
    page.keyboard.press("ArrowRight")
    after(page, number)
    assert pixels(page) != before
    page.wait_for_function(
        "document.querySelector('[data-name=\"axial.base_sigma_mm\"] .was').textContent == 'was 3'"
    )
    undo(page)
    assert pixels(page) == before


def test_a_syntax_error_is_marked_and_mended_code_changes_the_image(page: Any) -> None:
    select(page, "axial")
    page.wait_for_function("document.querySelector('.cm-content').textContent.includes('axial')")
    before, number = pixels(page), shown(page)
    page.click(".cm-content")
    page.keyboard.press("Control+End")
    page.keyboard.insert_text("wrong;")
    page.wait_for_selector(".cm-line.wrong")
    assert "syntax error" in page.inner_text(".code .problem")
    assert shown(page) == number, "the last good code runs"
    for _ in "wrong;":
        page.keyboard.press("Backspace")
    page.wait_for_selector(".cm-line.wrong", state="detached")
    page.keyboard.press("Control+Home")
    page.keyboard.press("ArrowDown")
    page.keyboard.insert_text("uniform float extra_mm = 40.0; //@ [0, 90] mm more of it\n")
    page.wait_for_selector('[data-name="axial.extra_mm"] .q-slider')
    assert pixels(page) == before, "nothing uses it yet"
    number = shown(page)
    page.click('[aria-label="undo"]')
    page.wait_for_selector('[data-name="axial.extra_mm"]', state="detached")


def test_a_saved_sensor_gives_the_bytes_that_the_page_shows(page: Any, server: Server) -> None:
    select(page, "range_gate")
    page.fill('[aria-label="range_gate.near_mm value"]', "450")
    page.wait_for_function(
        "document.querySelector('[data-name=\"range_gate.near_mm\"] .was').textContent != ''"
    )
    page.wait_for_timeout(500)
    page.click('[aria-label="save"]')
    page.click("text=Save sensor…")
    target = server.folder / "saved.toml"
    page.fill(".q-dialog input", str(target))
    page.click(".q-dialog button:has-text('Save')")
    page.wait_for_selector(f"text=wrote {target}")
    text = target.read_text()
    assert "near_mm = 450" in text
    assert "base_sigma_mm = 3   # loud" in text
    out = server.folder / "out"
    options = ["--sensor", str(target), "--set", "scene.wall_mm=1500", "-q"]
    assert main(["render", str(server.folder / "head.obj"), "-o", str(out), *options]) == 0
    width, height, window, noisy = page.evaluate(
        "(p => [p.head.width, p.head.height, p.head.window, Array.from(p.layers.noisy)])"
        "(glsimTune.state.picture)"
    )
    rendered = read_image(out / "head_noisy.png")
    assert rendered.shape == (height, width)
    left, top, w, h = window
    assert rendered[top : top + h, left : left + w].ravel().tolist() == noisy
    assert int((rendered > 0).sum()) == sum(1 for value in noisy if value), "nothing outside"


def test_a_typed_value_above_the_bound_is_said_at_once(page: Any) -> None:
    select(page, "range_gate")
    number = shown(page)
    page.fill('[aria-label="range_gate.far_mm value"]', "99999999")
    page.wait_for_selector("text=/at most [0-9]+ mm/")
    after(page, number)
    undo(page)


def test_saving_asks_before_it_replaces_and_makes_no_folder(page: Any, server: Server) -> None:
    letter = server.folder / "letter.toml"
    letter.write_text("precious")
    page.click('[aria-label="save"]')
    page.click("text=Save sensor…")
    for name, problem in (
        (str(server.folder / "missing" / "x.toml"), "no such folder"),
        ("", "give the name of a file"),
        (str(server.folder), "is a folder"),
    ):
        page.fill(".q-dialog input", name)
        page.click(".q-dialog button:has-text('Save')")
        page.wait_for_selector(f"text={problem}")
    assert not (server.folder / "missing").exists()
    page.fill(".q-dialog input", str(letter))
    page.click(".q-dialog button:has-text('Save')")
    page.wait_for_selector("text=letter.toml: already there. Click again to replace.")
    assert letter.read_text() == "precious"
    page.click(".q-dialog button:has-text('Replace')")
    page.wait_for_selector(f"text=wrote {letter}")
    assert "[[stage]]" in letter.read_text()


def test_a_new_stage_starts_from_a_template_and_can_be_taken_back(page: Any) -> None:
    before, number = pixels(page), shown(page)
    page.click("text=New stage")
    page.fill(".q-dialog input >> nth=0", "own_noise")
    page.click(".q-dialog button:has-text('Make')")
    page.wait_for_selector('[data-name="own_noise.amount_mm"] .q-slider')
    after(page, number)
    assert pixels(page) != before
    number = shown(page)
    page.click("text=Back to the file's")
    page.wait_for_selector('[data-stage="own_noise"]', state="detached")
    after(page, number)
    assert pixels(page) == before


def test_a_value_is_drawn_anew_from_a_range(page: Any) -> None:
    select(page, "axial")
    row = '[data-name="axial.base_sigma_mm"]'
    before, number = pixels(page), shown(page)
    page.click('[aria-label="menu of axial.base_sigma_mm"]')
    page.click("text=Drawn evenly from a range")
    after(page, number)
    assert page.inner_text(f"{row} .drawn") == "1.5 to 4.5 mm"
    assert pixels(page) != before
    number = shown(page)
    page.click('[aria-label="menu of axial.base_sigma_mm"]')
    page.click("text=Reset")
    after(page, number)
    assert pixels(page) == before


def test_a_file_that_is_edited_elsewhere_is_reloaded(page: Any, server: Server) -> None:
    select(page, "axial")
    file, box = server.folder / "small.toml", '[aria-label="axial.base_sigma_mm value"]'
    before, number = pixels(page), shown(page)
    file.write_text(SENSOR.replace("base_sigma_mm = 3", "base_sigma_mm = 7"))
    after(page, number)
    page.wait_for_function(f"document.querySelector('{box}').value === '7'")
    assert pixels(page) != before
    file.write_text(SENSOR.replace("base_sigma_mm = 3", "base_sigma_mm = -1"))
    page.wait_for_selector(".code .problem:has-text('outside')")
    number = shown(page)
    file.write_text(SENSOR)
    after(page, number)
    assert pixels(page) == before
    assert page.is_hidden(".code .problem")


def test_other_settings_stand_beside_these(page: Any) -> None:
    page.click('[aria-label="compare"]')
    page.click("text=Keep these settings as B")
    page.wait_for_function("glsimTune.state.other")
    noisy = "Array.from(glsimTune.state.other.layers.noisy)"
    before = page.evaluate(noisy)
    assert before == pixels(page)
    number = shown(page)
    page.click('[data-stage="axial"] .q-toggle')
    after(page, number)
    assert page.evaluate(noisy) == before != pixels(page)
    undo(page)
    page.click('[aria-label="compare"]')
    page.click("text=Show A alone")
    page.wait_for_function("!glsimTune.state.other")


def test_the_surface_turns(page: Any) -> None:
    picture = "document.querySelector('[data-kind=surface]').toDataURL()"
    before = page.evaluate(picture)
    page.focus('[data-kind="surface"]')
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(picture) != before


def test_playing_shows_frame_after_frame(page: Any) -> None:
    number = shown(page)
    page.click('[aria-label="play or stop"]')
    after(page, number + 3)
    page.click('[aria-label="play or stop"]')
    page.wait_for_function("+document.querySelector('[aria-label=frame]').value >= 3")
    seen = [-1, shown(page)]
    while seen[-1] != seen[-2]:  # a busy machine may still draw a frame that it was asked for
        page.wait_for_timeout(1000)
        seen.append(shown(page))
    undo(page)


def test_the_page_says_nothing_on_its_console_and_asks_no_other_server(
    page: Any, server: Server
) -> None:
    assert page.said == []
    own = (server.root, "blob:", "data:")
    assert {url for url in page.asked if not url.startswith(own)} == set()


def test_a_stereo_camera_shows_both_images_and_what_was_matched(
    tmp_path: Path, browser: Any
) -> None:
    (tmp_path / "head.obj").write_text(_face())
    (tmp_path / "stereo.toml").write_text(
        'extends = "realsense-d435"\ntitle = "small"\n[rig]\nwidth = 160\nheight = 120\n'
        "focal_px = [110, 110]\ncentre_px = [80, 60]\n"
    )
    options = ["stereo.toml", "--face", "head.obj", "--port", "0"]
    values = ["--set", "pose.distance_mm=500", "--set", "scene.wall_mm=1500"]
    running = start(tmp_path, *options, *values)
    context = browser.new_context()
    other = new_tab(context)
    other.goto(running.address)
    other.wait_for_selector('[data-stage="match_stereo"]')
    script = "all => all.filter(c => c.offsetWidth).map(c => c.dataset.kind)"
    tiles = other.eval_on_selector_all("canvas[data-kind]", script)
    depths = ["clean", "noisy", "disparity", "difference"]
    assert tiles == [*depths, "reason", "infrared", "infrared_right", "surface"]
    other.hover('[data-kind="disparity"]')
    said = other.inner_text(".readout")
    assert re.search(r"disparity \d+\.\d\d px  infrared \d+ and \d+ counts", said), said
    context.close()
    running.process.terminate()
    running.process.wait()


def _kept_values(folder: Path) -> list[Any]:
    """The changed values of the settings that are kept on the disk."""
    kept = json.loads((folder / "cache" / "tune.json").read_text()).get("tunings", {})
    return [value for tuning in kept.values() for value in tuning["values"].values()]


def test_a_killed_page_comes_back_with_its_settings(tmp_path: Path, browser: Any) -> None:
    (tmp_path / "small.toml").write_text(SENSOR)
    (tmp_path / "head.obj").write_text(_face())
    options = ["small.toml", "--face", "head.obj", "--port"]
    first = start(tmp_path, *options, "0")
    root = first.root
    box = '[aria-label="axial.base_sigma_mm value"]'
    context = browser.new_context()
    opened = new_tab(context)
    opened.goto(first.address)
    opened.fill(box, "7")
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while 7 not in _kept_values(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.1)
    first.process.kill()
    first.process.wait()
    opened.close()  # it would reload itself
    second = start(tmp_path, *options, re.findall(r":(\d+)/", root)[0])
    try:
        opened = new_tab(context)
        opened.goto(root)  # a bookmark: the cookie is still good
        opened.wait_for_selector("text=these are your last settings")
        opened.wait_for_function(f"document.querySelector('{box}')?.value === '7'")
        opened.click('[aria-label="undo"]')
        opened.wait_for_function(f"document.querySelector('{box}')?.value === '3'")
    finally:
        second.process.terminate()
        second.process.wait()
        context.close()


def test_without_a_token_nothing_is_served(server: Server) -> None:
    for path in ("", "?token=wrong", "tune/assets/tune.js", "tune/next/x?after=0", "_nicegui/x"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(server.root + path)
        assert refused.value.code == 403
        refused.value.close()
