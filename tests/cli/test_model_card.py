"""The script behind docs/model_card.md, on few frames and a filter instead of a network."""

from __future__ import annotations

import math

import numpy as np
import pytest

from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import load_settings
from scripts.model_card import SECTIONS, CardJob, CardRow, mean, score_clean, score_row, score_sigma

IDLE = CardJob("noisy", {}, 2)


def test_a_denoiser_that_does_nothing_changes_nothing() -> None:
    for before, after in score_row(IDLE, CardRow("small", {}, crop=64)).values():
        assert before == after
        assert before > 0
    assert score_clean(IDLE, CardRow("small", {}, crop=64)) == (0, 0, 0)


def test_a_filter_that_smooths_helps_against_white_noise_and_moves_a_clean_surface() -> None:
    job = CardJob("quadric:sigma_px=2.5", {}, 2)
    row = CardRow("white", {"sensor": "kinect-v1"}, crop=64)
    before, after = score_row(job, row)["both_interior_rmse_mm"]
    assert after < 0.7 * before
    moved, rounded, flips = score_clean(job, CardRow("small", {}, crop=64))
    assert moved > 0.3
    assert rounded > 0.3
    assert flips == 0


class ConstantSigma:
    """Returns its input and states a constant sigma."""

    uncertain = True

    def __init__(self, sigma_mm: float) -> None:
        self.sigma_mm = sigma_mm

    def __call__(self, noisy_mm, valid):  # type: ignore[no-untyped-def]
        return noisy_mm, valid

    def with_uncertainty(self, noisy_mm, valid):  # type: ignore[no-untyped-def]
        return noisy_mm, valid, np.full_like(noisy_mm, self.sigma_mm)


def test_a_stated_sigma_is_held_against_the_errors() -> None:
    assert score_sigma(IDLE, CardRow("x", {}, crop=64)) is None
    flat = CardRow("x", {"sensor": "led3d", "pose": {"distance_mm": 900}}, crop=64)
    spread = [
        score_sigma(CardJob(f"{__name__}:ConstantSigma:sigma_mm={s}", {}, 2), flat) for s in (4, 40)
    ]
    assert spread[0] is not None
    assert spread[1] is not None
    assert spread[0][0] == 4
    assert spread[0][1] < spread[0][2] < spread[1][1]


def test_parts_of_the_noise_that_are_off_are_off() -> None:
    names = {row.name: row for row in SECTIONS["limits"]}
    every, none = (
        score_row(IDLE, CardRow("x", names[name].settings, crop=64))["both_interior_rmse_mm"][0]
        for name in ("kinect-v2 as it is", "without all three")
    )
    assert none < every


@pytest.mark.parametrize("section", SECTIONS)
def test_every_row_has_settings_that_load(section: str) -> None:
    for row in SECTIONS[section]:
        settings = load_settings(overrides={"output": {"crop": row.crop}} | row.settings)
        sensor_of(settings)
        distance_mm = row.settings.get("pose", {}).get("distance_mm", 900)
        assert row.crop >= 365.456 * 290 / distance_mm


def test_means_leave_out_what_is_undefined() -> None:
    assert mean([1.0, math.nan, 3.0]) == 2
    assert math.isnan(mean([math.nan]))
