"""The page for the keyboard, a screen reader and a phone, in Debian's Chromium."""

from __future__ import annotations

from typing import Any

import pytest

from tests.tune.test_page import (
    PATIENCE_MS,
    after,
    browser,
    page,
    playwright,
    pytestmark,
    select,
    server,
    shown,
)

__all__ = ["browser", "page", "pytestmark", "server"]  # fixtures, of a server of their own


@pytest.fixture(autouse=True)
def _axial(page: Any) -> None:
    select(page, "axial")


#: Counts visible elements that take the focus and have no name.
_UNNAMED = """[...document.querySelectorAll(
  "a[href], button, input, select, textarea, [tabindex]")].filter(
  (e) => e.tabIndex >= 0 && e.getClientRects().length && !(e.getAttribute("aria-label") || e.title
    || e.textContent.trim() || e.placeholder || [...(e.labels ?? [])].some((l) => l.textContent)
  )).length"""


def test_a_box_shows_the_value_that_counts(page: Any) -> None:
    """What is out of the range, and an empty box, stayed on the page; 0 and 3 counted."""
    box = page.locator('[aria-label="axial.base_sigma_mm value"]')
    number = shown(page)
    box.fill("-5")
    after(page, number)
    box.blur()
    playwright.expect(box).to_have_value("0", timeout=PATIENCE_MS)
    box.fill("")
    box.blur()
    playwright.expect(box).to_have_value("0", timeout=PATIENCE_MS)


def test_home_and_end_move_a_slider_to_its_ends(page: Any) -> None:
    box = page.locator('[aria-label="axial.base_sigma_mm value"]')
    track = page.locator('[data-name="axial.base_sigma_mm"] .q-slider__track-container')
    seen = []
    for key in ("End", "Home"):
        number = shown(page)
        track.press(key)
        after(page, number)
        seen.append(float(box.input_value()))
    assert seen[0] > 3.0 > seen[1] == 0.0


def test_everything_that_takes_the_focus_has_a_name(page: Any) -> None:
    """For screen readers; Quasar focuses a part of its sliders that has none."""
    page.wait_for_function(_UNNAMED + " === 0")
    role = page.locator('[data-name="axial.base_sigma_mm"] .q-slider__track-container')
    assert role.get_attribute("role") == "slider"
    assert role.get_attribute("aria-label") == "axial.base_sigma_mm"
    slider = page.locator('[data-name="axial.base_sigma_mm"] .q-slider[aria-label]')
    assert role.get_attribute("aria-valuenow") == slider.get_attribute("aria-valuenow") is not None


def test_a_narrow_screen_shows_pictures_and_editor(page: Any) -> None:
    """390 px, a phone's: they had no width."""
    whole = page.viewport_size
    page.set_viewport_size({"width": 390, "height": 844})
    try:
        for place in (".left", ".view", ".figures", ".code", ".top"):
            box = page.locator(f".tune {place}").bounding_box()
            assert (box["x"], box["width"]) == (0, 390), place
            assert box["height"] > 60, place
        for tile in page.locator(".tile").all():
            if tile.is_visible():  # others are of layers that the sensor has not
                assert tile.bounding_box()["width"] > 150
    finally:
        page.set_viewport_size(whole)
