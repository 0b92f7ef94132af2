"""What a reader of figures and tables meets: plain numbers, no -0, no flattened curves."""

from __future__ import annotations

from itertools import pairwise

import pytest

from glsim.eval.report.figures.bias_curves import _leave_out_far_curves
from glsim.eval.report.figures.style import new_figure, plain_log_axis
from glsim.eval.report.tables import few_subjects, format_number


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(-0.4, "px", "-0.40"), (-0.001, "mm", "0.00"), (-0.00001, "1", "-0.0000"), (0.0, "mm", "0"),
     (-12.3, "mm", "-12.30"), (1234.5, "mm", "1234")],
)  # fmt: skip
def test_no_number_is_minus_nothing(value: float, unit: str, text: str) -> None:
    assert format_number(value, unit) == text.replace("-0.0000", "0.0000")


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [(30, 800, ["50", "100", "200", "500"]), (12, 30, ["20", "30"]),
     (1, 1e4, ["1", "100", "10000"])],
)  # fmt: skip
def test_logarithmic_axes_have_plain_labels_that_do_not_overlap(
    low: float, high: float, labels: list[str]
) -> None:
    """They were 4 x 10^1, one over the other."""
    figure = new_figure(2.0, 2.0)
    axis = figure.subplots()
    axis.set_xscale("log")
    axis.set_xlim(low, high)
    plain_log_axis(axis.xaxis)
    figure.canvas.draw()
    inside = [t.get_text() for t in axis.get_xticklabels() if low <= t.get_position()[0] <= high]
    assert inside == labels
    assert not any(t.get_text() for t in axis.get_xticklabels(minor=True))
    boxes = [t.get_window_extent() for t in axis.get_xticklabels()]
    assert all(a.x1 < b.x0 for a, b in pairwise(boxes))


def test_one_far_curve_does_not_flatten_the_others() -> None:
    for tops, end in (({"a": 1.0, "b": 2.0, "far": 300.0}, 11.0), ({"a": 1.0, "b": 4.0}, None)):
        figure = new_figure(4.0, 3.0)
        axis = figure.subplots()
        axis.plot([0, 1], [0, max(tops.values())])
        before = axis.get_ylim()
        _leave_out_far_curves(figure, axis, tops)
        if end is None:
            assert axis.get_ylim() == before
        else:
            assert axis.get_ylim() == pytest.approx((-end, end))
            assert "far to 300 mm" in figure.get_supxlabel()


def test_few_subjects_are_said() -> None:
    assert "intervals are of 2 subjects, too few" in few_subjects(2)
    assert "no intervals" in few_subjects(1)
