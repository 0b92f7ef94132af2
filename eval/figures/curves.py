"""The whole set in two figures: how large errors are, and why MSE does not say so."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ..aggregate import Summary
from ..blocks import BIN_MM, BINS
from . import new_figure, style

_TEXT_SIZE: Final = 7
#: The cumulative curves end here, mm.
_END_MM: Final = 20.0


def error_curves(summary: Summary) -> Any:
    """Share of the pixels with depth in input and truth whose error is at most so large."""
    figure = new_figure(6.4, 3.4)
    axis = figure.subplots()
    edges = BIN_MM * np.arange(1, BINS + 1)
    for number, method in enumerate(summary.methods):
        counts = summary.histograms[method]
        share = np.cumsum(counts[:BINS]) / max(1, counts.sum())
        axis.plot(edges, share, linewidth=1.2, label=method, **style(number))
    axis.set_xlim(0, _END_MM)
    axis.set_ylim(0, 1)
    _finish(axis, "absolute error [mm], pixels with depth in input and truth", "share of pixels")
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
    return figure


def disagreement(summary: Summary) -> Any:
    """All-pixel MSE against interior RMSE: a dot a frame, a large one for a method's mean."""
    figure = new_figure(6.4, 3.6)
    axis = figure.subplots()
    for number, method in enumerate(summary.methods):
        look = style(number)
        points = np.array(summary.points.get(method, [])).reshape(-1, 2)
        axis.scatter(*points.T, s=2, alpha=0.25, color=look["color"], linewidths=0)
    for number, method in enumerate(summary.methods):
        look = style(number)
        axis.scatter(
            summary.mean(method, "mse_mm2"),
            summary.mean(method, "both_interior_rmse_mm"),
            s=110 if number == 0 else 46,  # the input, which others may cover
            color=look["color"],
            marker={"-": "o", "--": "s", ":": "^"}[look["linestyle"]],
            edgecolors="white",
            linewidths=0.8,
            label=method,
            zorder=3,
        )
    everything = np.array([point for points in summary.points.values() for point in points])
    for place, scale in enumerate((axis.set_xscale, axis.set_yscale)):
        values = everything.reshape(-1, 2)[:, place]
        if values.size and values.min() > 0 and values.max() > 10 * values.min():
            scale("log")
    _finish(axis, "MSE over all pixels [mm²]", "RMSE, interior, valid in both [mm]")
    figure.legend(loc="outside right center", fontsize=_TEXT_SIZE - 1, frameon=False)
    return figure


def _finish(axis: Any, x: str, y: str) -> None:
    axis.set_xlabel(x, fontsize=_TEXT_SIZE)
    axis.set_ylabel(y, fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE, which="both")
    axis.grid(True, which="both", linewidth=0.3, alpha=0.5)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
