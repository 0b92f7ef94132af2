"""The figure of scores on a real recording."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np

from glsim.denoise.composites import COMPOSITES, DEFAULT_COMPOSITE
from glsim.eval.real_frames.frame_truth import BINS_M, SHIFT_BIN_MM
from glsim.eval.real_frames.results import RealScores
from glsim.eval.report.figures.style import method_style, new_figure

_TEXT_SIZE: Final = 7
#: The shift of networks without calibration is a few mm, that of filters tenths of one.
_SHIFT_RANGE_MM: Final = 6.0
#: Ends of the names of methods that are not drawn: tables have all composites.
_OTHERS: Final = tuple(f" [{name}]" for name in COMPOSITES if name != DEFAULT_COMPOSITE)


def measures_figure(scores: RealScores) -> Any:
    """Draw static pairs and the board by distance, the shift by 100 mm, and losses at edges."""
    figure = new_figure(10.0, 7.4)
    axes = figure.subplots(2, 2)
    names = [name for name in scores.methods if not name.endswith(_OTHERS)]
    for number, name in enumerate(names):
        m, style = scores.methods[name], method_style(number)
        for axis, values in ((axes[0, 0], m.pair_rmse_mm), (axes[0, 1], m.paper_rmse_mm)):
            axis.plot(range(len(values)), values, marker="o", markersize=3, linewidth=1, **style)
        if m.shift_by_100mm:
            at, shift = np.array(m.shift_by_100mm).T
            axes[1, 0].plot((at + SHIFT_BIN_MM / 2) / 1000, shift, linewidth=1, label=name, **style)
    labels = [f"{near:g}-{far:g}" for near, far in pairwise(BINS_M)]
    for axis, title in (
        (axes[0, 0], "static pairs: RMSE [mm]"),
        (axes[0, 1], "chessboard's paper: RMSE from its plane [mm]"),
    ):
        axis.set_xticks(range(len(labels)), labels)
        axis.set_xlim(-0.3, len(labels) - 0.7)
        axis.set_ylim(bottom=0)
        _finish(axis, title, "distance [m]")
    axes[1, 0].axhline(0, color="#777777", linewidth=0.5)
    axes[1, 0].set_ylim(-_SHIFT_RANGE_MM, _SHIFT_RANGE_MM)
    _finish(axes[1, 0], "smooth surfaces: denoised - raw [mm]", "distance [m]")
    _draw_losses(axes[1, 1], scores, names)
    figure.legend(
        *axes[1, 0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
        fontsize=_TEXT_SIZE,
        frameon=False,
    )
    return figure


def _draw_losses(axis: Any, scores: RealScores, names: Sequence[str]) -> None:
    kinds = ("ring_1_lost", "ring_2_lost", "shadow_filled")
    for number, name in enumerate(names):
        values = [100 * scores.methods[name].edges[kind] for kind in kinds]
        at = np.arange(len(kinds)) + 0.85 * ((number + 0.5) / len(names) - 0.5)
        style = method_style(number)
        hatch = {"-": "", "--": "///", ":": "..."}[style["linestyle"]]
        axis.bar(
            at, values, 0.85 / len(names), color=style["color"], hatch=hatch, edgecolor="white",
            linewidth=0.3,
        )  # fmt: skip
    axis.axhline(100 * scores.own_ring_losses[0], color="#777777", linewidth=0.8, linestyle=":")
    axis.set_xticks(range(3), ("outermost ring lost", "second ring lost", "holes beside filled"))
    _finish(axis, "edges of foregrounds [%]; dotted: the sensor's own losses of the first ring", "")


def _finish(axis: Any, title: str, x_label: str) -> None:
    axis.set_title(title, fontsize=_TEXT_SIZE + 1, loc="left")
    axis.set_xlabel(x_label, fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
