"""Figure of the bias of methods over distance."""

from __future__ import annotations

from typing import Any, Final

from glsim.eval.report.figures.style import method_style, new_figure
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.bias import BIAS_BIN_MM

_TEXT_SIZE: Final = 7


def bias_curves(summary: ScoreSummary) -> Any | None:
    """Draw the mean error per bin of distance with its interval, a line per method.

    Returns None if no bin has enough pixels.
    """
    figure = new_figure(6.4, 3.2)
    axis = figure.subplots()
    drawn = False
    for number, method in enumerate(summary.methods):
        bins = [b for b in summary.bias_by_distance(method) if b.is_enough]
        if not bins:
            continue
        drawn = True
        middle_m = [(b.from_mm + BIAS_BIN_MM / 2) / 1000 for b in bins]
        line_style = method_style(number)
        axis.plot(
            middle_m, [b.mean_mm for b in bins], linewidth=1.2, marker=".", markersize=4,
            label=method, **line_style,
        )  # fmt: skip
        low, high = [b.low_mm for b in bins], [b.high_mm for b in bins]
        axis.fill_between(middle_m, low, high, color=line_style["color"], alpha=0.12, linewidth=0)
    if not drawn:
        return None
    axis.axhline(0.0, color="#888888", linewidth=0.6)
    axis.set_xlabel("distance along the axis [m]", fontsize=_TEXT_SIZE)
    axis.set_ylabel("bias, interior [mm]", fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE)
    axis.grid(linewidth=0.3, alpha=0.5)
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
    return figure
