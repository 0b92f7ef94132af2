"""The script behind docs/model_card.md, on few frames and a filter instead of a network."""

from __future__ import annotations

import math

import pytest

from glsim.config import load_settings
from glsim.sensor import sensor_of
from scripts.model_card import SECTIONS, Cell, Job, mean, score_cell, score_clean

IDLE = Job("noisy", {}, 2)


def test_a_denoiser_that_does_nothing_changes_nothing() -> None:
    for before, after in score_cell(IDLE, Cell("small", {}, crop=64)).values():
        assert before == after
        assert before > 0
    assert score_clean(IDLE, Cell("small", {}, crop=64)) == (0, 0, 0)


def test_a_filter_that_smooths_helps_against_white_noise_and_moves_a_clean_surface() -> None:
    job = Job("quadric:sigma_px=2.5", {}, 2)
    cell = Cell("white", {"sensor": "kinect-v1"}, crop=64)
    before, after = score_cell(job, cell)["both_interior_rmse_mm"]
    assert after < 0.7 * before
    moved, rounded, flips = score_clean(job, Cell("small", {}, crop=64))
    assert moved > 0.3
    assert rounded > 0.3
    assert flips == 0


def test_parts_of_the_noise_that_are_off_are_off() -> None:
    names = {cell.name: cell for cell in SECTIONS["limits"]}
    every, none = (
        score_cell(IDLE, Cell("x", names[name].settings, crop=64))["both_interior_rmse_mm"][0]
        for name in ("kinect-v2 as it is", "without all three")
    )
    assert none < every


@pytest.mark.parametrize("section", SECTIONS)
def test_every_cell_has_settings_that_load(section: str) -> None:
    for cell in SECTIONS[section]:
        settings = load_settings(overrides={"output": {"crop": cell.crop}} | cell.settings)
        sensor_of(settings)
        distance_mm = cell.settings.get("pose", {}).get("distance_mm", 900)
        assert cell.crop >= 365.456 * 290 / distance_mm


def test_means_leave_out_what_is_undefined() -> None:
    assert mean([1.0, math.nan, 3.0]) == 2
    assert math.isnan(mean([math.nan]))
