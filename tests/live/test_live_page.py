"""The page of ``glsim live`` in Debian's Chromium: a recording, and a camera by its stand-in."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from glsim.files.png import encode_png
from tests.live.test_stream import frames
from tests.support.camera_stand_ins import write_camera_module
from tests.tune.test_page import (
    PATIENCE_MS,
    Server,
    after,
    browser,
    playwright,
    pytestmark,
    shown,
    start,
)

__all__ = ["browser", "pytestmark"]  # a fixture, and where Chromium is missing


def opened(browser: Any, server: Server) -> Any:
    """A tab of the page, with the messages of its console in ``page.said``."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.said = []
    page.on("console", lambda m: page.said.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: page.said.append(str(error)))
    page.goto(server.address)
    page.wait_for_selector("#tune-view[data-shown]")
    return page


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("live")
    (folder / "recording").mkdir()
    for number, depth in enumerate(frames(5)):
        (folder / "recording" / f"{number}.png").write_bytes(encode_png(depth))
    running = start(folder, "recording", "-d", "median:size=5", "--port", "0", command="live")
    yield running
    running.process.terminate()
    running.process.wait(30)


@pytest.fixture(scope="module")
def page(server: Server, browser: Any) -> Iterator[Any]:
    page = opened(browser, server)
    yield page
    page.context.close()


def layer(page: Any, name: str) -> list[int]:
    return list(page.evaluate(f"Array.from(glsimTune.state.picture.layers.{name})"))


def choose(page: Any, spec: str) -> None:
    page.click('[aria-label="denoiser"]')
    page.locator(".q-item", has_text=re.compile(f"^{spec}$")).click()


def test_frames_follow_each_other_and_their_number_a_second_stands_in_the_corner(page: Any) -> None:
    seen = set()
    for _ in range(8):
        number = shown(page)
        seen.add(page.evaluate("glsimTune.state.picture.head.source_frame"))
        after(page, number)
    assert len(seen) > 2  # of a loop of five
    page.wait_for_function("+document.querySelector('#tune-rate').dataset.rate > 0.5")
    text = page.inner_text("#tune-rate")
    assert re.fullmatch(r"[\d.]+ frames/s · denoiser \d+ ms · frame [1-5] of 5", text)
    # In the corner: at the right edge of the top.
    box = page.locator("#tune-rate").bounding_box()
    assert box["y"] < 44
    assert box["x"] + box["width"] > 1240
    assert page.said == []


def test_measured_and_denoised_stand_side_by_side(page: Any) -> None:
    titles = page.eval_on_selector_all(
        ".tile:not([hidden]) figcaption > span:first-child", "all => all.map(s => s.textContent)"
    )
    assert titles[:3] == ["measured", "denoised", "measured \N{MINUS SIGN} denoised"]
    boxes = [page.locator(f'[data-kind="{kind}"]').bounding_box() for kind in ("noisy", "clean")]
    assert boxes[0]["y"] == boxes[1]["y"]
    assert boxes[0]["width"] == boxes[1]["width"] > 300
    # The median of 5 x 5 pixels leaves a sixth of the noise.
    noisy, clean = layer(page, "noisy"), layer(page, "clean")
    assert spread(clean) < 0.5 * spread(noisy)
    drawn = "c => c.getContext('2d').getImageData(c.width / 2, c.height / 2, 40, 40).data.join()"
    images = [page.eval_on_selector(f'[data-kind="{kind}"]', drawn) for kind in ("noisy", "clean")]
    assert images[0] != images[1]
    page.hover('[data-kind="clean"]')
    page.wait_for_function(
        "/denoised 9\\d\\d mm  measured [89]\\d\\d mm  difference/.test("
        "document.querySelector('.readout').textContent)"
    )


def spread(values: list[int]) -> float:
    mean = sum(values) / len(values)
    return (sum((v - mean) ** 2 for v in values) / len(values)) ** 0.5


def test_pause_keeps_the_frame_and_another_denoiser_is_shown_on_it(page: Any) -> None:
    page.click('[aria-label="pause or go on"]')
    page.wait_for_function("+document.querySelector('#tune-rate').dataset.rate === 0")
    still, frame = shown(page), page.evaluate("glsimTune.state.picture.head.source_frame")
    page.wait_for_timeout(1000)
    assert shown(page) == still
    denoised = layer(page, "clean")
    choose(page, "noisy")
    after(page, still)
    assert page.evaluate("glsimTune.state.picture.head.source_frame") == frame
    assert layer(page, "clean") == layer(page, "noisy") != denoised
    number = shown(page)
    choose(page, "bm3d")  # no extra of the tests brings it
    page.wait_for_selector(".q-notification")
    assert "bm3d needs bm3d, which is not installed" in page.inner_text(".q-notification")
    playwright.expect(page.locator('[aria-label="denoiser"]')).to_have_value("noisy")
    choose(page, "median:size=5")
    after(page, number)
    # The box that went back to "noisy" may draw that once more before.
    page.wait_for_function("""() => { const { noisy, clean } = glsimTune.state.picture.layers;
        return clean.some((d, i) => d !== noisy[i]); }""")
    assert layer(page, "clean") == denoised
    page.click('[aria-label="pause or go on"]')
    after(page, shown(page))


def test_around_the_face_leaves_the_rest_as_measured(page: Any) -> None:
    number = shown(page)
    page.click("text=around the face")
    after(page, number + 1)
    script = """() => { const { noisy, clean } = glsimTune.state.picture.layers;
        return noisy.filter((d, i) => d !== clean[i]).length / noisy.length; }"""
    assert 0 < page.evaluate(script) < 1
    page.click("text=around the face")


def test_the_space_bar_pauses(page: Any) -> None:
    page.click(".strip")
    page.keyboard.press(" ")
    page.wait_for_function("+document.querySelector('#tune-rate').dataset.rate === 0")
    page.keyboard.press(" ")
    after(page, shown(page))


def test_a_second_tab_shows_the_same_pause(page: Any, server: Server) -> None:
    other = page.context.new_page()
    other.goto(f"http://127.0.0.1:{server.port}/")
    other.wait_for_selector("#tune-view[data-shown]", timeout=PATIENCE_MS)
    other.click('[aria-label="pause or go on"]')
    playwright.expect(page.locator('[aria-label="pause or go on"] i')).to_have_text("play_arrow")
    other.click('[aria-label="pause or go on"]')
    playwright.expect(page.locator('[aria-label="pause or go on"] i')).to_have_text("pause")
    other.close()
    after(page, shown(page))


def test_a_narrow_screen_shows_the_pictures(page: Any) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    try:
        for kind in ("noisy", "clean", "difference", "surface"):
            assert page.locator(f'.tile [data-kind="{kind}"]').bounding_box()["width"] > 150
        assert page.locator("#tune-rate").bounding_box()["x"] >= 0
    finally:
        page.set_viewport_size({"width": 1280, "height": 800})


def test_a_damaged_frame_is_named_and_play_goes_on(page: Any, server: Server) -> None:
    file = server.folder / "recording" / "2.png"
    whole = file.read_bytes()
    file.write_bytes(b"damaged")
    page.wait_for_function("document.querySelector('.problem').textContent.includes('2.png')")
    file.write_bytes(whole)
    page.wait_for_function("document.querySelector('.problem').textContent === ''")
    after(page, shown(page))


def test_everything_that_takes_the_focus_has_a_name(page: Any) -> None:
    from tests.tune.test_page_access import _UNNAMED

    page.wait_for_function(_UNNAMED + " === 0")


def test_a_camera_plays_through_its_library(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_camera_module(tmp_path, "pyrealsense2")
    words = ["--camera", "realsense", "-d", "median", "--port", "0"]
    server = start(tmp_path, *words, command="live", path=tmp_path)
    try:
        page = opened(browser, server)
        assert "Intel RealSense Stand-in" in page.inner_text(".top")
        depths = []
        for _ in range(3):
            number = shown(page)
            depths.append(max(layer(page, "noisy")))
            after(page, number)
        assert depths == sorted(depths, reverse=True)  # the plate comes nearer
        assert depths[0] > depths[-1] > 600 * 5
        assert set(layer(page, "infrared")) == {90}
        page.wait_for_function("+document.querySelector('#tune-rate').dataset.rate > 0.5")
        assert re.search(r"· frame \d+$", page.inner_text("#tune-rate"))
        assert page.said == []
        page.context.close()
    finally:
        server.process.terminate()
        assert server.process.wait(30) is not None
