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

#: Title of a panel -> measure of each distance.
_ERRORS: Final = {
    "static pairs: RMSE [mm]": "pair_rmse_mm",
    "planes: RMSE from the plane of a tile [mm]": "plane_rmse_mm",
    "chessboard's paper: RMSE from its plane [mm]": "paper_rmse_mm",
}
_SHIFTS: Final = "smooth surfaces: denoised - raw [mm]"
_LOSSES: Final = "edges of foregrounds [%]; dotted: the sensor's own losses of the first ring"
_EDGES: Final = {
    "ring_1_lost": "outermost ring lost",
    "ring_2_lost": "second ring lost",
    "shadow_filled": "holes beside filled",
}


def measures_figure(scores: RealScores) -> Any:
    """Draw what was measured: errors by distance, depth shift, and losses at edges."""
    names = default_composites(scores.methods)  # only the tables show all composites
    methods = [scores.methods[name] for name in names]
    styles = [method_style(number) for number in range(len(names))]
    lines = {t: np.array([getattr(m, field) for m in methods]) for t, field in _ERRORS.items()}
    lines = {title: values for title, values in lines.items() if not np.isnan(values).all()}
    shares = 100 * np.array([[m.edges[kind] for kind in _EDGES] for m in methods])
    kinds = ~np.isnan(shares).all(axis=0)
    shifts = [_SHIFTS] if any(m.shift_by_100mm for m in methods) else []
    panels = [*lines, *shifts, *([_LOSSES] if np.nanmax(shares, initial=0) > 0 else [])]
    rows = -(-len(panels) // 2) or 1
    figure = new_figure(10.0, 3.7 * rows)
    axes = figure.subplots(rows, 2, squeeze=False).ravel()
    for unused in axes[len(panels) :]:
        unused.set_visible(False)
    for title, axis in zip(panels, axes, strict=False):
        for number, (name, m, style) in enumerate(zip(names, methods, styles, strict=True)):
            if title in lines:
                values = lines[title][number]
                axis.plot(values, marker="o", markersize=3, linewidth=1, label=name, **style)
            elif title == _SHIFTS and m.shift_by_100mm:
                at, shift = np.array(m.shift_by_100mm).T
                middle_m = (at + SHIFT_BIN_MM / 2) / MM_PER_M
                axis.plot(middle_m, shift, linewidth=1, label=name, **style)
            elif title == _LOSSES:
                axis.bar(
                    np.arange(kinds.sum()) + 0.85 * ((number + 0.5) / len(names) - 0.5),
                    shares[number, kinds],
                    0.85 / len(names),
                    color=style["color"],
                    hatch={"-": "", "--": "///", ":": "..."}[style["linestyle"]],
                    edgecolor="white",
                    linewidth=0.3,
                )
        if title in lines:
            used = np.flatnonzero(~np.isnan(lines[title]).all(axis=0))
            labels = [f"{near:g}-{far:g}" for near, far in pairwise(BINS_M)]
            axis.set_xticks(used, [labels[n] for n in used])
            axis.set_xlim(used[0] - 0.3, used[-1] + 0.3)
            axis.set_ylim(bottom=0)
        elif title == _SHIFTS:
            axis.axhline(0, color="#777777", linewidth=0.5)
            axis.set_ylim(-_SHIFT_RANGE_MM, _SHIFT_RANGE_MM)
        else:
            own = 100 * scores.own_ring_losses[0]
            axis.axhline(own, color="#777777", linewidth=0.8, linestyle=":")
            texts = [text for text, used in zip(_EDGES.values(), kinds, strict=True) if used]
            axis.set_xticks(range(len(texts)), texts)
        axis.set_title(title, fontsize=_TEXT_SIZE + 1, loc="left")
        axis.set_xlabel("" if title == _LOSSES else "distance [m]", fontsize=_TEXT_SIZE)
        axis.tick_params(labelsize=_TEXT_SIZE)
        axis.spines[["top", "right"]].set_visible(False)
    handles = axes[0].get_legend_handles_labels()
    place = "outside lower center"
    figure.legend(*handles, loc=place, ncols=3, fontsize=_TEXT_SIZE, frameon=False)
    return figure
