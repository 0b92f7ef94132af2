"""Means over subjects, their intervals and tests, and number formats."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import scipy.stats

from glsim.eval.metrics.score import METRICS
from glsim.eval.report.tables import format_number, table_latex, table_markdown
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.run import Evaluation
from glsim.eval.scoring.statistics import (
    SubjectSums,
    bootstrap_interval,
    holm_correction,
    sign_flip_test,
)


def test_numbers_have_digits_that_mean_something() -> None:
    assert [format_number(v) for v in (0.0, 1234.5, 123.45, 1.2345, 0.0123, float("nan"))] == [
        "0", "1234", "123.5", "1.23", "0.01", "n/a",
    ]  # fmt: skip
    assert format_number(0.99123, "1") == "0.9912"


def values(*means: float, frames: int = 10) -> SubjectSums:
    counts = np.full(len(means), float(frames))
    return SubjectSums(np.array(means) * frames, counts, counts)


def test_bootstrap_interval_covers_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(200):
        low, high = bootstrap_interval(values(*rng.normal(5, 2, 40)))
        hits += low <= 5 <= high
    assert 0.88 < hits / 200 < 0.99  # 95 %, a little less for 40 subjects; z < 4.5
    assert all(math.isnan(end) for end in bootstrap_interval(values(3.0)))


def test_sign_flip_is_exact_for_few_and_right_for_many() -> None:
    base = values(1, 1, 1, 1)
    assert sign_flip_test(values(2, 3, 2.5, 4), base) == pytest.approx(2 / 2**4)
    assert sign_flip_test(base, base) == 1.0
    rng = np.random.default_rng(1)
    p = [sign_flip_test(values(*rng.normal(0, 1, 8)), values(*np.zeros(8))) for _ in range(400)]
    assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.07)
    many = values(*(np.arange(20) % 2 + 0.1))
    assert sign_flip_test(many, values(*np.zeros(20))) < 0.01
    assert math.isnan(sign_flip_test(values(1.0), values(2.0)))


def test_the_bootstrap_interval_is_scipys() -> None:
    """Ours draws once for all methods and needs no SciPy; the tables of two runs are the same."""
    rng = np.random.default_rng(3)
    counts = rng.integers(1, 30, 25).astype(float)
    sums = counts * rng.normal(4, 1.5, 25)
    expected = scipy.stats.bootstrap(
        (sums, counts),
        lambda sums, counts, axis: sums.sum(axis) / counts.sum(axis),
        paired=True,
        vectorized=True,
        n_resamples=20_000,
        method="percentile",
        rng=rng,
    ).confidence_interval
    ends = bootstrap_interval(SubjectSums(sums, counts, counts))
    # 2000 draws: the 2.5 % point varies by 0.004 of probability, 7 % of the half width.
    assert ends == pytest.approx(expected, abs=0.25 * (expected.high - expected.low) / 2)


@pytest.mark.parametrize("shift", [0.0, 0.6, 2.0])
def test_exact_sign_flips_are_scipys(shift: float) -> None:
    rng = np.random.default_rng(4)
    first, second = rng.normal(shift, 1, 9), rng.normal(0, 1, 9)
    expected = scipy.stats.permutation_test(
        (first, second),
        lambda a, b, axis: np.mean(a - b, axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=10_000,
    ).pvalue
    assert sign_flip_test(values(*first), values(*second)) == pytest.approx(expected)


def test_holm_by_hand() -> None:
    corrected = holm_correction(np.array([0.01, 0.04, np.nan, 0.03]))
    np.testing.assert_allclose(corrected, [0.03, 0.06, np.nan, 0.06])


def test_undefined_values_are_counted_not_averaged() -> None:
    summary = ScoreSummary(2)
    nothing = dict.fromkeys(METRICS)
    place = {"sequence": "s", "frame": 0, "method": "m"}
    summary.add(nothing | place | {"subject": "a", "iou": 0.5})
    summary.add(nothing | place | {"subject": "b"})
    entries = summary.entries("m")
    assert entries["iou"].mean == 0.5
    assert (entries["iou"].frames, entries["iou"].undefined) == (1, 1)
    assert math.isnan(entries["mse_mm2"].mean)
    found = Evaluation(summary, ScoreSummary(0), 2, 0, ())
    table = {"m": entries}
    assert "n/a" in table_markdown(found, table, "x")
    assert "n/a" in table_latex(table)
    assert json.dumps(format_number(entries["mse_mm2"].mean)) == '"n/a"'
