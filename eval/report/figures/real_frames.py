"""Figure of the scores on a real recording."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np

from glsim.core.units import MM_PER_M
from glsim.eval.real_frames.frame_truth import BINS_M, SHIFT_BIN_MM
from glsim.eval.real_frames.totals import RealScores
from glsim.eval.report.figures.style import method_style, new_figure
from glsim.eval.scoring.blocks import default_composites

_TEXT_SIZE: Final = 7
#: Range of the axis of shifts, mm: uncalibrated networks shift depth by a few mm, filters by less.
_SHIFT_RANGE_MM: Final = 6.0


def measures_figure(scores: RealScores) -> Any:
    """Draw errors on static pairs and on the board, depth shift, and losses at edges."""
    figure = new_figure(10.0, 7.4)
    (pairs, papers), (shifts, edges) = figure.subplots(2, 2)
    names = default_composites(scores.methods)  # only the tables show all composites
    kinds = ("ring_1_lost", "ring_2_lost", "shadow_filled")
    for number, name in enumerate(names):
        m, style = scores.methods[name], method_style(number)
        for axis, values in ((pairs, m.pair_rmse_mm), (papers, m.paper_rmse_mm)):
            axis.plot(range(len(values)), values, marker="o", markersize=3, linewidth=1, **style)
        if m.shift_by_100mm:
            at, shift = np.array(m.shift_by_100mm).T
            shifts.plot((at + SHIFT_BIN_MM / 2) / MM_PER_M, shift, linewidth=1, label=name, **style)
        edges.bar(
            np.arange(len(kinds)) + 0.85 * ((number + 0.5) / len(names) - 0.5),
            [100 * m.edges[kind] for kind in kinds],
            0.85 / len(names),
            color=style["color"],
            hatch={"-": "", "--": "///", ":": "..."}[style["linestyle"]],
            edgecolor="white",
            linewidth=0.3,
        )
    labels = [f"{near:g}-{far:g}" for near, far in pairwise(BINS_M)]
    for axis in (pairs, papers):
        axis.set_xticks(range(len(labels)), labels)
        axis.set_xlim(-0.3, len(labels) - 0.7)
        axis.set_ylim(bottom=0)
    shifts.axhline(0, color="#777777", linewidth=0.5)
    shifts.set_ylim(-_SHIFT_RANGE_MM, _SHIFT_RANGE_MM)
    edges.axhline(100 * scores.own_ring_losses[0], color="#777777", linewidth=0.8, linestyle=":")
    edges.set_xticks(range(3), ("outermost ring lost", "second ring lost", "holes beside filled"))
    for axis, title in {
        pairs: "static pairs: RMSE [mm]",
        papers: "chessboard's paper: RMSE from its plane [mm]",
        shifts: "smooth surfaces: denoised - raw [mm]",
        edges: "edges of foregrounds [%]; dotted: the sensor's own losses of the first ring",
    }.items():
        axis.set_title(title, fontsize=_TEXT_SIZE + 1, loc="left")
        axis.set_xlabel("" if axis is edges else "distance [m]", fontsize=_TEXT_SIZE)
        axis.tick_params(labelsize=_TEXT_SIZE)
        axis.spines[["top", "right"]].set_visible(False)
    handles = shifts.get_legend_handles_labels()
    place = "outside lower center"
    figure.legend(*handles, loc=place, ncols=3, fontsize=_TEXT_SIZE, frameon=False)
    return figure
