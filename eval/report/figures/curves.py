"""Figures of a whole set: error distributions, MSE against surface error, bias over distance."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.eval.report.figures.style import add_note, method_style, new_figure, plain_log_axis
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.bias import BIAS_BIN_MM
from glsim.eval.scoring.blocks import BIN_MM, BINS

_TEXT_SIZE: Final = 7
#: Largest error on the cumulative curves, mm.
_END_MM: Final = 20.0
#: A curve of bias that reaches this many times farther than the middle one leaves the axis. Chosen.
_FAR: Final = 5.0
#: The axis of bias reaches at least to this, mm: the step of a depth file. Chosen.
_LEAST_MM: Final = 1.0


def error_curves(summary: ScoreSummary) -> Any:
    """Draw the cumulative distribution of |error| over pixels with depth in input and truth."""
    figure = new_figure(6.4, 3.4)
    axis = figure.subplots()
    for number, method in enumerate(summary.methods):
        errors_mm, share = cumulative_shares(summary.histograms[method])
        axis.plot(errors_mm, share, linewidth=1.2, label=method, **method_style(number))
    axis.set_xlim(0, _END_MM)
    axis.set_ylim(0, 1)
    _finish(
        figure, axis, "absolute error [mm], pixels with depth in input and truth", "share of pixels"
    )
    return figure


def cumulative_shares(
    counts: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute a method's error curve: |error|, mm, and the share of pixels with less error.

    Depth in whole millimetres has errors of whole millimetres: in bins of BIN_MM its curve would be
    a stair beside the lines of other methods. A rounded error k stands for errors of k - 1/2 to
    k + 1/2 steps, so such a curve has its points there. The step is the largest that all errors
    are multiples of.

    Args:
        counts: (BINS + 1,) pixels per BIN_MM of |error|; the last: larger errors.
    """
    step = max(1, int(np.gcd.reduce(np.flatnonzero(counts[:BINS]))))
    share = np.cumsum(counts[:BINS])[::step] / max(1, counts.sum())
    ends_mm = BIN_MM * (step * np.arange(len(share)) + (1 if step == 1 else step / 2))
    return np.concatenate([[0.0], ends_mm]), np.concatenate([[0.0], share])


def disagreement(summary: ScoreSummary) -> Any:
    """Draw all-pixel MSE against interior RMSE: small dots for frames, large dots for means."""
    figure = new_figure(6.4, 3.6)
    axis = figure.subplots()
    metrics = ("mse_mm2", "both_interior_rmse_mm")
    points = {method: summary.sampled_frames(method) for method in summary.methods}
    for number, (method, of_frames) in enumerate(points.items()):
        style = method_style(number)
        axis.scatter(*of_frames.T, s=2, alpha=0.25, color=style["color"], linewidths=0)
        axis.scatter(
            *(summary.mean(method, metric) for metric in metrics),
            s=110 if number == 0 else 46,  # the input, which other dots may cover
            color=style["color"], marker={"-": "o", "--": "s", ":": "^"}[style["linestyle"]],
            edgecolors="white", linewidths=0.8, label=method, zorder=3,
        )  # fmt: skip
    for place, scale in enumerate((axis.set_xscale, axis.set_yscale)):
        values = np.concatenate([*points.values()])[:, place]
        if values.size and values.min() > 0 and values.max() > 10 * values.min():
            scale("log")
    _finish(figure, axis, "MSE over all pixels [mm²]", "RMSE, interior, valid in both [mm]")
    return figure


def bias_curves(summary: ScoreSummary) -> Any | None:
    """Draw the mean error per distance bin with its interval, a line per method.

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
        style = method_style(number)
        means = [b.mean_mm for b in bins]
        axis.plot(middle_m, means, linewidth=1.2, marker=".", markersize=4, label=method, **style)
        low, high = [b.low_mm for b in bins], [b.high_mm for b in bins]
        axis.fill_between(middle_m, low, high, color=style["color"], alpha=0.12, linewidth=0)
        tops[method] = max(map(abs, means))
    if not tops:
        return None
    # The axis ends where most curves do, and names those beyond: one would flatten the others.
    end_mm = max(_FAR * sorted(tops.values())[(len(tops) - 1) // 2], _LEAST_MM)
    far = [f"{method} to {top:.3g} mm" for method, top in tops.items() if top > end_mm]
    if far:
        axis.set_ylim(-1.1 * end_mm, 1.1 * end_mm)
        add_note(figure, f"beyond the axis: {', '.join(far)}")
    axis.axhline(0.0, color="#888888", linewidth=0.6)
    _finish(figure, axis, "distance along the axis [m]", "bias, interior [mm]")
    return figure


def _finish(figure: Any, axis: Any, x: str, y: str) -> None:
    for one, scale in ((axis.xaxis, axis.get_xscale()), (axis.yaxis, axis.get_yscale())):
        if scale == "log":
            plain_log_axis(one)
    axis.set_xlabel(x, fontsize=_TEXT_SIZE)
    axis.set_ylabel(y, fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE, which="both")
    axis.grid(True, which="both", linewidth=0.3, alpha=0.5)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
