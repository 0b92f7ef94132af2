"""Confidence intervals are drawn over subjects; numbers of tables have a fixed format."""

import math

import numpy as np
import pytest
import scipy.stats

from glsim.eval.report.score_tables import format_number
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval, paired_difference


def values(*means: float, frames: int = 10) -> SubjectSums:
    counts = np.full(len(means), float(frames))
    return SubjectSums(np.array(means) * frames, counts, counts)


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
    assert all(math.isnan(end) for end in bootstrap_interval(values(3.0)))


def test_a_difference_is_paired_by_subject() -> None:
    rng = np.random.default_rng(2)
    people, gain = rng.normal(5, 2, 20), rng.normal(0.3, 0.02, 20)
    found = paired_difference(values(*people), values(*(people + gain)))
    assert found.mean == pytest.approx(-gain.mean())
    assert (found.lower, found.subjects) == (20, 20)
    assert found.low < found.mean < found.high
    assert found.high - found.low < 0.03, "people differ by 2, and the difference by 0.02"
    assert math.isnan(paired_difference(values(3.0), values(4.0)).low)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(-0.4, "px", "-0.40"), (-0.001, "mm", "0.00"), (-0.00001, "1", "-0.0000"), (0.0, "mm", "0"),
     (-12.3, "mm", "-12.30"), (1234.5, "mm", "1234"), (123.45, "mm", "123.5"),
     (float("nan"), "mm", "n/a"), (0.99123, "1", "0.9912")],
)  # fmt: skip
def test_numbers_have_digits_that_mean_something_and_none_is_minus_nothing(
    value: float, unit: str, text: str
) -> None:
    assert format_number(value, unit) == text.replace("-0.0000", "0.0000")
