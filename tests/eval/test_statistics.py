"""Means over subjects, their intervals and tests, and number formats."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats

from glsim.eval.metrics.frame_score import METRICS
from glsim.eval.report.score_tables import table_markdown
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.evaluate import Evaluation
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval


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


def test_undefined_values_are_counted_not_averaged() -> None:
    summary = ScoreSummary()
    nothing = dict.fromkeys(METRICS)
    place = {"sequence": "s", "frame": 0, "method": "m"}
    summary.add(nothing | place | {"subject": "a", "iou": 0.5})
    summary.add(nothing | place | {"subject": "b"})
    entries = summary.entries("m")
    assert entries["iou"].mean == 0.5
    assert (entries["iou"].frames, entries["iou"].undefined) == (1, 1)
    assert math.isnan(entries["mse_mm2"].mean)
    found = Evaluation(summary, ScoreSummary(), 2, 0, ())
    table = {"m": entries}
    assert "n/a" in table_markdown(found, table, "x")
