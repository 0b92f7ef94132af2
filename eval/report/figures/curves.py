"""Draw the bias of each method over distance, mm over m, from the scores of a data set."""

from __future__ import annotations

from typing import Any, Final

from glsim.core.units import MM_PER_M
from glsim.eval.report.figures.style import add_note, method_style, new_figure
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.bias import BIAS_BIN_MM

_TEXT_SIZE: Final = 7
#: The axis of bias ends at this multiple of the median curve's extent. Chosen, not measured.
_FAR: Final = 5.0
#: Smallest extent of the axis of bias, mm. Chosen: the step of a depth file.
_LEAST_MM: Final = 1.0


def bias_curves(summary: ScoreSummary) -> Any | None:
    """Draw the mean error per distance bin with its interval; None if no bin has enough pixels."""
    figure = new_figure(6.4, 3.2)
    axis = figure.subplots()
    tops: dict[str, float] = {}
    for number, method in enumerate(summary.methods):
        bins = [b for b in summary.bias_by_distance(method) if b.is_enough]
        if not bins:
            continue
        middle_m = [(b.from_mm + BIAS_BIN_MM / 2) / MM_PER_M for b in bins]
        style = method_style(number)
        means = [b.mean_mm for b in bins]
        bars = [[m - b.low_mm for m, b in zip(means, bins, strict=True)],
                [b.high_mm - m for m, b in zip(means, bins, strict=True)]]  # fmt: skip
        axis.errorbar(middle_m, means, bars, label=method, marker=".", markersize=4, **style,
                      linewidth=1.2, elinewidth=0.6, capsize=1.5)  # fmt: skip
        tops[method] = max(map(abs, means))
    if not tops:
        return None
    # The axis fits most curves. Larger curves would flatten them; a note names these.
    end_mm = max(_FAR * sorted(tops.values())[(len(tops) - 1) // 2], _LEAST_MM)
    far = [f"{method} to {top:.3g} mm" for method, top in tops.items() if top > end_mm]
    if far:
        axis.set_ylim(-1.1 * end_mm, 1.1 * end_mm)
        add_note(figure, f"beyond the axis: {', '.join(far)}")
    axis.axhline(0.0, color="#888888", linewidth=0.6)
    axis.set_xlabel("distance along the axis [m]", fontsize=_TEXT_SIZE)
    axis.set_ylabel("bias, interior [mm]", fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE)
    axis.grid(True, linewidth=0.3, alpha=0.5)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
    return figure
