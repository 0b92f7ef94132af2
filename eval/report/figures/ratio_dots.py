"""Dot plot of ratios with intervals: a panel per metric, a row per group, a line at 1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from glsim.eval.report.figures.style import method_style, new_figure

_TEXT_SIZE: Final = 7
#: Height of a dot's line and of the gap between groups, inch.
_LINE_IN, _GAP = 0.085, 1.2
#: Ends of the logarithmic axis at most; dots beyond are drawn at the edge.
_ENDS: Final = (0.04, 25.0)
#: Ticks: fine ones where the axis spans less than a factor of _FINE, else coarse ones.
_FINE: Final = 5.0
_FINE_TICKS: Final = (0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 3.0, 4.0)
_COARSE_TICKS: Final = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)


@dataclass(frozen=True)
class RatioDot:
    """A ratio with its interval, in a row ``group``, of a colour ``kind``; circles may be open."""

    group: str
    kind: str
    open_circle: bool
    ratio: float
    low: float
    high: float
    goal: float = math.nan


def ratio_dots(panels: Sequence[tuple[str, Sequence[RatioDot]]], marks: tuple[str, str]) -> Any:
    """Draw the panels, which have the same groups.

    Args:
        panels: heading and dots of each.
        marks: meanings of a full and of an open circle.
    """
    groups = list(dict.fromkeys(dot.group for _, dots in panels for dot in dots))
    kinds = list(dict.fromkeys(dot.kind for _, dots in panels for dot in dots))
    lines = {
        group: max(sum(dot.group == group for dot in dots) for _, dots in panels)
        for group in groups
    }
    height = sum(lines.values()) + _GAP * len(groups)
    figure = new_figure(1.6 + 1.45 * len(panels), max(1.9, 0.9 + _LINE_IN * height))
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axis, (title, dots) in zip(axes, panels, strict=True):
        tops, centres, top = {}, [], _GAP / 2
        for number, group in enumerate(groups):
            tops[group] = top
            end = top + lines[group]
            centres.append((top + end - 1) / 2)
            if number % 2:
                axis.axhspan(
                    top - 0.5 - _GAP / 2, end - 0.5 + _GAP / 2, color="#f0f0f0", linewidth=0
                )
            top = end + _GAP
        axis.axvline(1.0, color="black", linewidth=0.8)
        _draw(axis, dots, tops, lines, kinds)
        axis.set_title(title, fontsize=_TEXT_SIZE + 0.5)
        axis.set_ylim(top - _GAP / 2 - 0.5, -0.5)
        axis.set_yticks(centres, groups)
        axis.tick_params(labelsize=_TEXT_SIZE, length=2, which="major")
        axis.tick_params(axis="y", length=0)
        axis.grid(True, axis="x", linewidth=0.3, alpha=0.6)
        axis.set_axisbelow(True)
        for side in ("top", "right", "left"):
            axis.spines[side].set_visible(False)
    figure.legend(
        handles=_legend(kinds, marks, panels),
        loc="outside lower center",
        ncols=4,
        fontsize=_TEXT_SIZE,
        frameon=False,
        handletextpad=0.4,
        columnspacing=1.4,
    )
    return figure


def _draw(
    axis: Any,
    dots: Sequence[RatioDot],
    tops: dict[str, float],
    lines: dict[str, int],
    kinds: list[str],
) -> None:
    """Draw the dots of a panel, one below the other in their group, and its logarithmic axis."""
    used = dict.fromkeys(tops, 0)
    for dot in dots:
        y = tops[dot.group] + used[dot.group]
        if not used[dot.group] and not math.isnan(dot.goal):
            reach = tops[dot.group] - 0.6, tops[dot.group] + lines[dot.group] - 0.4
            axis.plot(
                [dot.goal] * 2, reach, color="#666666", linewidth=0.8, linestyle=(0, (2, 1.5))
            )
        used[dot.group] += 1
        if not dot.ratio > 0:
            continue  # a ratio of 0 or an undefined one has no place on the axis
        colour = method_style(kinds.index(dot.kind) + 4)["color"]
        if dot.low > 0:
            axis.plot([dot.low, dot.high], [y, y], color=colour, linewidth=1.0)
        axis.plot(
            [min(max(dot.ratio, _ENDS[0]), _ENDS[1])],
            [y],
            marker="o",
            markersize=3.2,
            color=colour,
            markeredgewidth=0.8,
            markerfacecolor="white" if dot.open_circle else colour,
            linestyle="none",
            clip_on=False,
            zorder=3,
        )
    ends = [v for dot in dots for v in (dot.ratio, dot.low, dot.high, dot.goal) if v > 0]
    low, high = min([0.7, *(0.9 * v for v in ends)]), max([1.15, *(1.1 * v for v in ends)])
    low, high = max(low, _ENDS[0]), min(high, _ENDS[1])
    ticks = [
        tick
        for tick in (_FINE_TICKS if high < _FINE * low else _COARSE_TICKS)
        if low <= tick <= high
    ]
    axis.set_xscale("log")
    axis.set_xlim(low, high)
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.set_xticks([], minor=True)


def _legend(
    kinds: Sequence[str],
    marks: tuple[str, str],
    panels: Sequence[tuple[str, Sequence[RatioDot]]],
) -> list[Any]:
    from glsim.eval.report.figures.style import matplotlib

    line = matplotlib("lines").Line2D
    handles = [
        line([], [], color=method_style(number + 4)["color"], marker="o", markersize=3.2,
             linewidth=1.0, label=kind)
        for number, kind in enumerate(kinds)
    ]  # fmt: skip
    dots = [dot for _, of_panel in panels for dot in of_panel]
    if any(dot.open_circle for dot in dots):
        for fill, text in zip(("#444444", "white"), marks, strict=True):
            handles.append(
                line([], [], color="#444444", marker="o", markersize=3.2, markerfacecolor=fill,
                     markeredgewidth=0.8, linestyle="none", label=text)
            )  # fmt: skip
    if any(not math.isnan(dot.goal) for dot in dots):
        handles.append(
            line([], [], color="#666666", linewidth=0.8, linestyle=(0, (2, 1.5)), label="goal")
        )
    return handles
