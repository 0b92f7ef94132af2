"""The script behind docs/model_card.md, on few frames and a filter instead of a network."""

from __future__ import annotations

from glsim.denoise.registry import load_denoiser
from scripts.model_card import SECTIONS, CardRow, score_row


def test_a_denoiser_that_does_nothing_changes_nothing() -> None:
    noisy = load_denoiser("noisy")
    for before, after in score_row(noisy, CardRow("small", {}, crop=64), {}, 2).values():
        assert before == after > 0
    clean = score_row(noisy, CardRow("small", {}, crop=64), {}, 2, clean=True)
    assert clean["both_rmse_mm"] == clean["flips_px"] == (0, 0)


def test_a_filter_that_smooths_helps_against_white_noise_and_moves_a_clean_surface() -> None:
    smooth = load_denoiser("quadric:sigma_px=2.5")
    row = CardRow("white", {"sensor": "kinect-v1"}, crop=64)
    before, after = score_row(smooth, row, {}, 2)["both_interior_rmse_mm"]
    assert after < 0.7 * before
    assert score_row(smooth, CardRow("x", {}, 64), {}, 2, clean=True)["both_rmse_mm"][1] > 0.3


def test_parts_of_the_noise_that_are_off_are_off() -> None:
    rows = {row.name: row.settings for row in SECTIONS["limits"][1]}
    noisy = load_denoiser("noisy")
    every, none = (
        score_row(noisy, CardRow("x", rows[name], 64), {}, 2)["both_interior_rmse_mm"][0]
        for name in ("kinect-v2 as it is", "without all three")
    )
    assert none < every
