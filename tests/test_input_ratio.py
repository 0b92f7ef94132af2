"""Test `benchmarks.input_ratio`: its ratios for errors of known size, mm, and its printed table."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.input_ratio import input_ratios, main


def test_known_errors() -> None:
    truth_mm = np.zeros((64, 64), np.float32)
    truth_mm[8:56, 8:56] = 900.0
    noise_mm = np.random.default_rng(0).normal(0, 2, truth_mm.shape).astype(np.float32)
    noisy_mm = np.where(truth_mm > 0, truth_mm + noise_mm, 0)
    half_mm = np.where(truth_mm > 0, truth_mm + noise_mm / 2, 0)
    half_mm[8] += 100.0  # a rim, which is no interior
    assert input_ratios(half_mm, noisy_mm, truth_mm) == pytest.approx((0.5, 0.5), rel=1e-4)
    # A constant offset is an error of depth and none of differences.
    depth, differences = input_ratios(half_mm + 3, noisy_mm, truth_mm) or (0.0, 0.0)
    assert depth == pytest.approx(np.hypot(0.5, 1.5), rel=0.05)
    assert differences == pytest.approx(0.5, rel=1e-4)
    assert input_ratios(half_mm[:20], noisy_mm[:20], truth_mm[:20]) is None


def test_the_table_has_a_row_for_each_denoiser_and_a_column_for_each_set(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    truth_mm = np.full((48, 48), 900.0, np.float32)
    noise_mm = np.random.default_rng(0).normal(0, 2, truth_mm.shape).astype(np.float32)
    frame = SimpleNamespace(noisy_mm=truth_mm + noise_mm, expected_mm=truth_mm)
    monkeypatch.setattr("benchmarks.input_ratio.open_dataset", lambda path: [frame, frame])
    main(["near", "far", "-d", "noisy", "-d", "smooth@masked_gaussian"])
    title, _, noisy, smooth = capsys.readouterr().out.splitlines()
    assert title == "| denoiser | interior | differences | near | far |"
    assert noisy == "| noisy | 1.000 | 1.000 | 1.000 | 1.000 |"
    cells = [float(cell) for cell in smooth.split("|")[2:-1]]
    assert smooth.startswith("| smooth |")
    assert max(cells) < 0.6
    monkeypatch.setattr("benchmarks.input_ratio.open_dataset", lambda path: [])
    with pytest.raises(SystemExit):
        main(["near", "-d", "noisy"])
    assert "near: no frame has 500 pixels" in capsys.readouterr().err
