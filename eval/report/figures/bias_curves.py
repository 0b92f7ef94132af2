"""Figure of the bias of methods over distance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from glsim.eval.report.figures.style import add_note, method_style, new_figure
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.bias import BIAS_BIN_MM

_TEXT_SIZE: Final = 7
#: A curve that reaches this many times farther than the middle one leaves the axis. Chosen.
_FAR: Final = 5.0
#: The axis reaches at least to this bias, mm: the step of a depth file. Chosen.
_LEAST_MM: Final = 1.0


def bias_curves(summary: ScoreSummary) -> Any | None:
    """Draw the mean error per bin of distance with its interval, a line per method.

    Returns None if no bin has enough pixels.
    """
    figure = new_figure(6.4, 3.2)
    axis = figure.subplots()
    tops: dict[str, float] = {}
    for number, method in enumerate(summary.methods):
        bins = [b for b in summary.bias_by_distance(method) if b.is_enough]
        if not bins:
            continue
        middle_m = [(b.from_mm + BIAS_BIN_MM / 2) / 1000 for b in bins]
        line_style = method_style(number)
        axis.plot(
            middle_m, [b.mean_mm for b in bins], linewidth=1.2, marker=".", markersize=4,
            label=method, **line_style,
        )  # fmt: skip
        tops[method] = max(abs(b.mean_mm) for b in bins)
        low, high = [b.low_mm for b in bins], [b.high_mm for b in bins]
        axis.fill_between(middle_m, low, high, color=line_style["color"], alpha=0.12, linewidth=0)
    if not tops:
        return None
    _leave_out_far_curves(figure, axis, tops)
    axis.axhline(0.0, color="#888888", linewidth=0.6)
    axis.set_xlabel("distance along the axis [m]", fontsize=_TEXT_SIZE)
    axis.set_ylabel("bias, interior [mm]", fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE)
    axis.grid(linewidth=0.3, alpha=0.5)
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
    return figure


def _leave_out_far_curves(figure: Any, axis: Any, tops: Mapping[str, float]) -> None:
    """Let the axis end where most curves do, and name those beyond: one would flatten the others.

    Args:
        tops: method -> largest bias, mm.
    """
    end_mm = max(_FAR * sorted(tops.values())[(len(tops) - 1) // 2], _LEAST_MM)
    far = [f"{method} to {top:.3g} mm" for method, top in tops.items() if top > end_mm]
    if far:
        axis.set_ylim(-1.1 * end_mm, 1.1 * end_mm)
        add_note(figure, f"beyond the axis: {', '.join(far)}")
