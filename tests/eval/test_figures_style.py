"""What a reader of figures and tables meets: plain numbers, no -0, no flattened curves."""

from __future__ import annotations

import numpy as np
import pytest

from glsim.eval.report.figures.curves import cumulative_shares
from glsim.eval.report.figures.style import new_figure, plain_log_axis
from glsim.eval.report.score_tables import format_number
from glsim.eval.scoring.blocks import BIN_MM, BINS


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


def test_logarithmic_axes_have_plain_labels() -> None:
    """They were 4 x 10^1, one over the other."""
    axis = new_figure(2.0, 2.0).subplots()
    axis.set_xscale("log")
    axis.set_xlim(30, 800)
    plain_log_axis(axis.xaxis)
    axis.figure.canvas.draw()
    inside = [t.get_text() for t in axis.get_xticklabels() if 30 <= t.get_position()[0] <= 800]
    assert inside == ["50", "100", "200", "500"]
    assert not any(t.get_text() for t in axis.get_xticklabels(minor=True))


def test_whole_millimetres_make_no_stairs() -> None:
    """The same errors, rounded and not, give curves that agree at every half millimetre."""
    errors_mm = np.abs(np.random.default_rng(3).normal(0, 2.5, 200_000))
    fine, whole = (
        cumulative_shares(
            np.bincount((e / BIN_MM + 1e-9).astype(int).clip(max=BINS), minlength=BINS + 1)
        )
        for e in (errors_mm, np.round(errors_mm))
    )
    assert np.allclose(np.diff(fine[0])[1:], BIN_MM)
    assert np.allclose(np.diff(whole[0])[1:], 1.0)
    np.testing.assert_allclose(np.interp(whole[0], *fine), whole[1], atol=1e-9)
    between = np.arange(0, 20, BIN_MM)
    np.testing.assert_allclose(np.interp(between, *fine), np.interp(between, *whole), atol=0.03)


def test_errors_of_nothing_have_a_curve() -> None:
    for only in (0, BINS):
        counts = np.zeros(BINS + 1, np.int64)
        counts[only] = 5
        errors_mm, share = cumulative_shares(counts)
        assert len(errors_mm) == len(share)
        assert share[-1] == (only == 0)
