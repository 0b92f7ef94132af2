"""The page in Debian's Chromium: what a user moves, types and saves.

One server and one browser serve all tests; the sensor is small, so that a frame takes milliseconds.
"""

from __future__ import annotations

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
from glsim.files.png import read_depth_png
from glsim.tune.state import StageCode, Tuning, tuning_of_link

pytest.importorskip("nicegui", reason="the extra glsim[tune] is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.long,  # test_static_page has a quick test in Chromium
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
        """The address that was printed last: a ticket is used once."""
        return re.findall(r"http://\S+", (self.folder / "log").read_text())[-1]

    @property
    def port(self) -> int:
        return int(re.findall(r":(\d+)/", self.address)[0])


def start(folder: Path, *options: str, command: str = "tune", path: Path | None = None) -> Server:
    """Start a command that serves a page in a folder, and wait for its address.

    path: a folder with Python modules.
    """
    log = folder / "log"
    words = [sys.executable, "-m", "glsim", command, *options, "--no-browser"]
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    places = [str(p) for p in (path, Path(__file__).parents[2]) if p is not None]
    environment = {**kept, "PYTHONPATH": os.pathsep.join(places), "COLUMNS": "300"}
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
    (folder / "plate.obj").write_text(_face())
    options = ["small.toml", "--face", "plate.obj", "--port", "0"]
    running = start(folder, *options, "--set", "scene.wall_mm=1500")
    try:
        yield running
    finally:
        running.process.terminate()
        running.process.wait(30)


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
    opened.set_default_timeout(60_000)  # compiled by now: a broken page must not wait for an hour
    opened.wait_for_timeout(500)  # errors of drawing come after the first frame
    assert not opened.said, opened.said
    yield opened
    context.close()


def _face() -> str:
    """A curved plate of 200 x 240 mm that looks at the camera."""
    lines, wide, high = [], 12, 14
    for row in range(high + 1):
        for column in range(wide + 1):
            x, y = 200 * (column / wide - 0.5), 240 * (row / high - 0.5)
            lines.append(f"v {x:.2f} {y:.2f} {60 - 0.004 * (x * x + y * y):.2f}")
    for row in range(high):
        for column in range(wide):
            a = row * (wide + 1) + column + 1
            b, c, d = a + 1, a + wide + 1, a + wide + 2
            lines += [f"f {a} {b} {d}", f"f {a} {d} {c}"]
    return "\n".join(lines) + "\n"


def shown(page: Any) -> int:
    return int(page.get_attribute("#tune-view", "data-shown"))


def after(page: Any, number: int) -> None:
    page.wait_for_function(f"+document.querySelector('#tune-view').dataset.shown > {number}")


def pixels(page: Any) -> list[int]:
    """The noisy layer that the page shows."""
    return list(page.evaluate("Array.from(glsimTune.state.picture.layers.noisy)"))


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
    assert page.evaluate("glsimTune.state.times.length") >= 1
    number = shown(page)
    page.click('[aria-label="undo"]')
    after(page, number)
    assert pixels(page) == before


def test_what_has_not_changed_is_not_painted_anew_and_the_rest_is(page: Any) -> None:
    def canvases() -> dict[str, str]:
        script = "all => all.map(c => [c.dataset.kind, c.toDataURL()])"
        return dict(page.eval_on_selector_all("canvas[data-kind]", script))

    def pressed(name: str) -> dict[str, str]:
        number = shown(page)
        page.locator(f'[data-name="{name}"] .q-slider__track-container').press("ArrowRight")
        after(page, number)
        return canvases()

    first = canvases()
    select(page, "axial")
    louder = pressed("axial.base_sigma_mm")
    assert louder["clean"] == first["clean"]
    assert all(louder[kind] != first[kind] for kind in ("noisy", "difference", "surface"))
    page.click('[data-section="pose and scene"] button.name')
    turned = pressed("pose.yaw_deg")
    assert all(turned[kind] != louder[kind] for kind in ("clean", "noisy", "surface"))
    for _ in range(2):
        number = shown(page)
        page.click('[aria-label="undo"]')
        after(page, number)
    assert canvases() == first


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_editor_has_the_colours_of_the_system(
    server: Server, browser: Any, scheme: str
) -> None:
    context = browser.new_context(color_scheme=scheme)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(server.address)
    light = "(c => c[0] + c[1] + c[2] > 380)"
    page.wait_for_function(
        f"{light}((getComputedStyle(document.querySelector('.cm-editor') ?? document.body)"
        f".backgroundColor.match(/\\d+/g) ?? []).map(Number)) === {str(scheme == 'light').lower()}"
        " && document.querySelector('.cm-editor')"
    )
    context.close()


def test_the_whole_of_the_editor_can_be_seen(page: Any) -> None:
    ends = page.evaluate(
        "['.code', '.code .cm-scroller'].map("
        "css => document.querySelector(css).getBoundingClientRect().bottom)"
    )
    assert ends[1] <= ends[0] <= 800


def test_a_frame_is_sent_as_it_is(page: Any) -> None:
    """The server does not compress layers: that takes longer than to draw them."""
    script = (
        "async () => [...(await fetch(`/tune/next/${glsimTune.state.tab}?after=0`)).headers.keys()]"
    )
    names = page.evaluate(script)
    assert "content-length" in names
    assert "content-encoding" not in names


def test_a_request_waits_for_the_next_picture(page: Any) -> None:
    """Answer 200 if a later picture is there; else wait 2 s and answer 204."""
    script = """async (after) => {
        const answer = await fetch(`/tune/next/${glsimTune.state.tab}?after=${after}`);
        return [answer.status, performance.now()];
    }"""
    now = shown(page)
    start = page.evaluate("performance.now()")
    assert page.evaluate(script, now - 1)[0] == 200
    status, end = page.evaluate(script, now)
    assert status == 204
    assert end - start > 1900
    assert page.evaluate("fetch('/tune/next/none?after=0').then((answer) => answer.status)") == 404
    page.said.clear()  # the browser logs the answer 404 itself


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
    assert main(["render", str(server.folder / "plate.obj"), "-o", str(out), *options]) == 0
    width, height, window, noisy = page.evaluate(
        "(p => [p.head.width, p.head.height, p.head.window, Array.from(p.layers.noisy)])"
        "(glsimTune.state.picture)"
    )
    rendered = read_depth_png(out / "plate_noisy.png")
    assert rendered.shape == (height, width)
    left, top, w, h = window
    assert rendered[top : top + h, left : left + w].ravel().tolist() == noisy
    assert int((rendered > 0).sum()) == sum(1 for value in noisy if value), "nothing outside"


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
    page.click('[aria-label="save"]')
    page.click("text=Save this frame…")
    page.fill(".q-dialog input", str(server.folder / "a frame"))
    page.click(".q-dialog button:has-text('Save')")
    page.wait_for_selector("text=wrote a frame_clean.png")
    assert (server.folder / "a frame_noisy.png").exists()


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


def test_a_file_that_a_stage_includes_is_reloaded(page: Any, server: Server) -> None:
    wanted, amount = server.folder / "small.toml", server.folder / "amount.glsl"
    push = "#version 330 core\n// push: moves all away.\n//@ sparse\n"
    push += '#include "amount.glsl"\nuniform sampler2D u_depth;\nout float depth;\n'
    push += "void main() { depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r + AMOUNT_M; }\n"
    (server.folder / "push.glsl").write_text(push)
    amount.write_text("const float AMOUNT_M = 0.1;\n")
    before, number = pixels(page), shown(page)
    wanted.write_text(SENSOR + '[[stage]]\nuse = "push.glsl"\n')
    after(page, number)
    pushed, number = pixels(page), shown(page)
    assert pushed != before
    amount.write_text("const float AMOUNT_M = 0.2;\n")
    after(page, number)
    assert pixels(page) not in (before, pushed)
    number = shown(page)
    wanted.write_text(SENSOR)
    after(page, number)
    assert pixels(page) == before


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
    number = shown(page)
    page.click('[aria-label="undo"]')
    after(page, number)
    page.click('[aria-label="compare"]')
    page.click("text=Show A alone")
    page.wait_for_function("!glsimTune.state.other")


def test_a_stereo_camera_shows_both_images_and_what_was_matched(page: Any, server: Server) -> None:
    (server.folder / "stereo.toml").write_text(
        'extends = "realsense-d435"\ntitle = "small"\n[rig]\nwidth = 160\nheight = 120\n'
        "focal_px = [110, 110]\ncentre_px = [80, 60]\n"
    )
    tuning = Tuning("stereo.toml", {"pose.distance_mm": 500})
    other = page.context.new_page()
    other.set_default_timeout(PATIENCE_MS)
    problems: list[str] = []
    other.on("pageerror", lambda error: problems.append(str(error)))
    other.goto(f"http://127.0.0.1:{server.port}/?s={tuning.link()}")
    other.wait_for_selector("#tune-view[data-shown]")
    other.wait_for_selector('[data-stage="match_stereo"]')

    def tiles() -> list[str]:
        script = "all => all.filter(c => c.offsetWidth).map(c => c.dataset.kind)"
        return list(other.eval_on_selector_all("canvas[data-kind]", script))

    def picture(kind: str) -> str:
        return str(other.evaluate(f"document.querySelector('[data-kind={kind}]').toDataURL()"))

    def moved(name: str, key: str = "ArrowRight") -> None:
        number = shown(other)
        other.locator(f'[data-name="{name}"] .q-slider__track-container').press(key)
        after(other, number)

    depths = ["clean", "noisy", "disparity", "difference"]
    assert tiles() == [*depths, "reason", "infrared", "infrared_right", "surface"]
    other.hover('[data-kind="disparity"]')
    said = other.inner_text(".readout")
    assert re.search(r"disparity \d+\.\d\d px  infrared \d+ and \d+ counts", said), said
    first = {kind: picture(kind) for kind in ("infrared", "infrared_right", "disparity")}
    select(other, "stereo_light")
    moved("stereo_light.gain_counts")
    assert all(picture(kind) != before for kind, before in first.items())
    second = {kind: picture(kind) for kind in first}
    select(other, "match_stereo")
    moved("match_stereo.p2")
    assert picture("infrared") == second["infrared"]
    assert picture("disparity") != second["disparity"]
    moved("match_stereo.window_px")
    assert other.input_value('[aria-label="match_stereo.window_px value"]') == "11"
    number = shown(other)
    other.click('[data-stage="match_stereo"] .q-toggle')
    after(other, number)
    shown_now = ["clean", "noisy", "difference", "reason", "infrared", "infrared_right", "surface"]
    assert tiles() == shown_now
    assert problems == []
    other.close()
    page.said.clear()


def test_playing_shows_frame_after_frame(page: Any) -> None:
    number = shown(page)
    page.click('[aria-label="play or stop"]')
    after(page, number + 3)
    page.click('[aria-label="play or stop"]')
    page.wait_for_timeout(500)
    stopped = shown(page)
    page.wait_for_function("+document.querySelector('[aria-label=frame]').value >= 3")
    page.wait_for_timeout(1000)
    assert shown(page) <= stopped + 1, "one may have been on its way"


def test_the_page_says_nothing_on_its_console_and_asks_no_other_server(
    page: Any, server: Server
) -> None:
    assert page.said == []
    own = f"http://127.0.0.1:{server.port}/"
    assert {url for url in page.asked if not url.startswith((own, "blob:", "data:"))} == set()


def test_two_tabs_have_their_own_settings_and_a_link_carries_them(
    page: Any, server: Server, browser: Any
) -> None:
    page.wait_for_function("location.search.startsWith('?s=')")
    link = page.evaluate("location.search")
    second = page.context.new_page()
    second.set_default_timeout(PATIENCE_MS)
    second.goto(f"http://127.0.0.1:{server.port}/{link}")
    second.wait_for_selector("#tune-view[data-shown]")
    assert pixels(second) == pixels(page), "the link holds the changed value"
    number, of_second = shown(page), shown(second)
    second.click('[data-stage="axial"] .q-toggle')
    after(second, of_second)
    assert pixels(second) != pixels(page)
    assert shown(page) == number
    address = second.evaluate("`/tune/next/${glsimTune.state.tab}?after=0`")
    assert page.evaluate(f"fetch('{address}').then((answer) => answer.status)") == 200
    second.close()
    for _ in range(PATIENCE_MS // 500):
        if page.evaluate(f"fetch('{address}').then((answer) => answer.status)") != 200:
            break
        page.wait_for_timeout(500)
    else:
        pytest.fail("the closed tab is still held")
    page.said.clear()  # the browser logs the answer 404 itself


def test_a_link_runs_code_after_a_click_alone(page: Any, server: Server) -> None:
    """The code stands in the folder, so that a link may name it; elsewhere it may not."""
    (server.folder / "own.py").write_text(
        "from glsim.noise.stage import array_stage\n"
        "open('ran', 'a').write('x')\n"
        "@array_stage()\ndef keep(view, layers, p):\n    return {'depth': layers['depth']}\n"
    )
    (server.folder / "coded.toml").write_text(SENSOR + '[[stage]]\nuse = "own.py:keep"\n')
    other = page.context.new_page()
    other.set_default_timeout(PATIENCE_MS)
    root = f"http://127.0.0.1:{server.port}/?s="
    other.goto(root + Tuning("coded.toml").link())
    other.wait_for_selector("text=coded.toml: own.py:keep")
    other.click("text=Leave it")
    other.wait_for_timeout(500)
    assert not (server.folder / "ran").exists()
    other.goto(root + Tuning("coded.toml").link())
    other.click("text=Run it")
    other.wait_for_selector('[data-stage="keep"]')
    assert (server.folder / "ran").exists()
    other.goto(root + Tuning("/etc/evil.toml").link())
    other.wait_for_selector("text=outside of")
    script = 'x" innerHTML="<img src=x onerror=document.title=1>'
    text = (Path(__file__).parents[2] / "glsim/tune/assets/template.glsl").read_text()
    code = {script: StageCode(text.replace("NAME", "mine"), new=True)}
    other.goto(root + Tuning("small.toml", code=code).link())
    other.wait_for_selector("text=is no name of a stage")
    assert other.title() == "glsim tune"
    other.close()
    page.said.clear()


def _kept_values(folder: Path) -> list[Any]:
    """Return the changed values of the one tuning that is kept on the disk; [] without one."""
    for path in (folder / "cache" / "tune").glob("*.link"):
        return list(tuning_of_link(path.read_text("ascii")).values.values())
    return []


def test_a_killed_page_comes_back_with_its_settings(tmp_path: Path, browser: Any) -> None:
    (tmp_path / "small.toml").write_text(SENSOR)
    (tmp_path / "plate.obj").write_text(_face())
    options = ["small.toml", "--face", "plate.obj", "--port"]
    first = start(tmp_path, *options, "0")
    port = first.port
    context = browser.new_context()
    opened = context.new_page()
    opened.set_default_timeout(PATIENCE_MS)
    opened.goto(first.address)
    opened.fill('[aria-label="axial.base_sigma_mm value"]', "7")
    opened.wait_for_function("location.search.length > 40")
    # The first picture writes the file too: wait for the one with the typed value.
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while 7 not in _kept_values(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.1)
    first.process.kill()
    first.process.wait(30)
    opened.close()  # it would reload itself, with the link in its address
    second = start(tmp_path, *options, str(port))
    try:
        assert second.port == port
        opened = context.new_page()
        opened.set_default_timeout(PATIENCE_MS)
        opened.goto(f"http://127.0.0.1:{port}/")  # a bookmark: the cookie is still good
        opened.wait_for_selector("text=these are your last settings")
        opened.wait_for_function(
            "document.querySelector('[aria-label=\"axial.base_sigma_mm value\"]')?.value === '7'"
        )
        opened.click('[aria-label="undo"]')
        opened.wait_for_function(
            "document.querySelector('[aria-label=\"axial.base_sigma_mm value\"]')?.value === '3'"
        )
    finally:
        second.process.terminate()
        second.process.wait(30)
        context.close()


def test_without_a_ticket_nothing_is_served(server: Server) -> None:
    for path in ("", "?ticket=wrong", "tune/assets/tune.js", "tune/next/x?after=0", "_nicegui/x"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"http://127.0.0.1:{server.port}/{path}")
        assert refused.value.code == 403
        refused.value.close()
