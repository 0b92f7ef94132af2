"""Figures of the whole set: error distributions, and all-pixel MSE against surface error."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.eval.report.figures.style import method_style, new_figure, plain_log_axis
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.blocks import BIN_MM, BINS

_TEXT_SIZE: Final = 7
#: Largest error on the cumulative curves, mm.
_END_MM: Final = 20.0


def error_curves(summary: ScoreSummary) -> Any:
    """Draw the cumulative distribution of |error| over pixels with depth in input and truth."""
    figure = new_figure(6.4, 3.4)
    axis = figure.subplots()
    edges = BIN_MM * np.arange(1, BINS + 1)
    for number, method in enumerate(summary.methods):
        counts = summary.histograms[method]
        share = np.cumsum(counts[:BINS]) / max(1, counts.sum())
        axis.plot(edges, share, linewidth=1.2, label=method, **method_style(number))
    axis.set_xlim(0, _END_MM)
    axis.set_ylim(0, 1)
    _finish(axis, "absolute error [mm], pixels with depth in input and truth", "share of pixels")
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
    return figure


def disagreement(summary: ScoreSummary) -> Any:
    """Draw all-pixel MSE against interior RMSE: a dot per frame, a large one per method's mean."""
    figure = new_figure(6.4, 3.6)
    axis = figure.subplots()
    all_points: list[NDArray[np.float64]] = []
    for number, method in enumerate(summary.methods):
        line_style = method_style(number)
        points = summary.sampled_frames(method, "mse_mm2", "both_interior_rmse_mm")
        all_points.append(points)
        axis.scatter(*points.T, s=2, alpha=0.25, color=line_style["color"], linewidths=0)
    for number, method in enumerate(summary.methods):
        line_style = method_style(number)
        axis.scatter(
            summary.mean(method, "mse_mm2"),
            summary.mean(method, "both_interior_rmse_mm"),
            s=110 if number == 0 else 46,  # the input, which other dots may cover
            color=line_style["color"],
            marker={"-": "o", "--": "s", ":": "^"}[line_style["linestyle"]],
            edgecolors="white",
            linewidths=0.8,
            label=method,
            zorder=3,
        )
    for place, scale in enumerate((axis.set_xscale, axis.set_yscale)):
        values = np.concatenate(all_points)[:, place]
        if values.size and values.min() > 0 and values.max() > 10 * values.min():
            scale("log")
    _finish(axis, "MSE over all pixels [mm²]", "RMSE, interior, valid in both [mm]")
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
    return figure


#: Panels: metric -> heading.
_BOXES: Final = {
    "mse_mm2": "MSE, all pixels [mm²]",
    "input_interior_rmse_mm": "RMSE, interior [mm]",
    "normal_mean_deg": "normals [°]",
    "flips_px": "flipped pixels",
    "flying_px": "flying pixels",
}


def frame_boxes(summary: ScoreSummary) -> Any:
    """Draw a box per method over its frames, for the main metrics: quartiles, 5 to 95 %, mean."""
    methods = summary.methods
    figure = new_figure(9.6, 1.0 + 0.2 * len(methods))
    axes = figure.subplots(1, len(_BOXES), sharey=True)
    for axis, (metric, heading) in zip(axes, _BOXES.items(), strict=True):
        values = [summary.sampled_frames(method, metric)[:, 0] for method in methods]
        drawn = axis.boxplot(
            values,
            orientation="horizontal",
            whis=(5, 95),
            widths=0.6,
            showfliers=False,
            showmeans=True,
            patch_artist=True,
            medianprops={"color": "black", "linewidth": 1.0},
            meanprops={"marker": "D", "markersize": 2.5, "markeredgecolor": "black",
                       "markerfacecolor": "white", "markeredgewidth": 0.5},
            whiskerprops={"linewidth": 0.6},
            capprops={"linewidth": 0.6},
        )  # fmt: skip
        for number, box in enumerate(drawn["boxes"]):
            line_style = method_style(number)
            box.set(facecolor=line_style["color"], alpha=0.6, linewidth=0.5)
        all_values = np.concatenate(values)
        if all_values.size and 0 < 10 * all_values.min() < all_values.max():
            axis.set_xscale("log")
        _finish(axis, heading, "")
    axes[0].set_yticks(range(1, len(methods) + 1), methods)
    axes[0].invert_yaxis()
    return figure


def _finish(axis: Any, x: str, y: str) -> None:
    for one, scale in ((axis.xaxis, axis.get_xscale()), (axis.yaxis, axis.get_yscale())):
        if scale == "log":
            plain_log_axis(one)
    axis.set_xlabel(x, fontsize=_TEXT_SIZE)
    axis.set_ylabel(y, fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE, which="both")
    axis.grid(True, which="both", linewidth=0.3, alpha=0.5)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
