"""Figures 2, 4, 5 and 6: methods side by side; depth, errors, surfaces and normals in rows.

A column for the truth, one for the noisy input and one per method, all in the scales of the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from glsim.denoise.interface import Depth
from glsim.errors import DeviceError
from glsim.eval.paper.figures.frames import FigureFrame
from glsim.eval.report.figures.map_pictures import (
    colour_legend,
    depth_colours,
    depth_picture,
    error_colours,
    error_picture,
    face_window,
    normal_picture,
)
from glsim.eval.report.figures.side_view import TURN_DEG, half_width_mm, side_view
from glsim.eval.report.figures.style import add_note, matplotlib, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PanelRow = Literal["depth", "error", "normals", "side"]
_LABELS: Final[dict[PanelRow, str]] = {
    "depth": "depth",
    "error": "error",
    "normals": "normals",
    "side": f"from {TURN_DEG:.0f}°",
}
_TITLE_SIZE, _TEXT_SIZE = 8, 6
#: Side of a panel, and room for labels at both sides, for an axis and at both ends, inch.
_PANEL_IN, _SIDES_IN, _AXIS_IN, _ENDS_IN = 1.35, 1.2, 0.3, 0.75
#: Distance of the ticks of maps, px, and of side views, mm.
_TICKS_PX, _TICKS_MM = 40, 100


def panel_figure(
    frame: FigureFrame, methods: Mapping[str, Depth], rows: Sequence[PanelRow], note: str
) -> Figure:
    """Draw a column of panels for the truth and for each method.

    Args:
        frame: the frame.
        methods: title -> (H, W) depth in millimetres, 0 = none; includes the noisy input.
        rows: kinds of panels.
        note: a line below the panels.
    """
    columns = {"truth": frame.clean, **methods}
    # A row of maps above a row of side views, and the last row, have an axis below.
    below = [kind != after for kind, after in pairwise([*(k == "side" for k in rows), None])]
    figure: Figure = new_figure(
        _PANEL_IN * len(columns) + _SIDES_IN,
        _PANEL_IN * len(rows) + _AXIS_IN * sum(below) + _ENDS_IN,
    )
    axes = figure.subplots(
        len(rows), len(columns) + 1, squeeze=False, width_ratios=[1.0] * len(columns) + [0.06]
    )
    for column, (title, depth) in enumerate(columns.items()):
        name, _, small = title.partition("\n")
        axes[0, column].set_title(f"{name}\n", fontsize=_TITLE_SIZE, pad=1)
        axes[0, column].text(
            0.5, 1.03, small, fontsize=_TEXT_SIZE, ha="center", transform=axes[0, column].transAxes
        )
        for row, kind in zip(axes, rows, strict=True):
            _draw(row[column], kind, depth, frame)
    for row, kind, bottom in zip(axes, rows, below, strict=True):
        _label(row[:-1], kind, bottom)
        _colour_bar(figure, row[-1], kind, frame)
    handles = [h for h in colour_legend() if "side" in rows or h.get_label() != "flying pixel"]
    figure.legend(
        handles=handles, loc="outside upper center", ncols=4, fontsize=_TEXT_SIZE, frameon=False
    )
    add_note(figure, note)
    return figure


def _draw(axis: Axes, kind: PanelRow, depth: Depth, frame: FigureFrame) -> None:
    if kind == "side":
        _draw_side_view(axis, depth, frame)
        return
    rows, columns = face_window(frame.clean)
    camera = frame.window.intrinsics
    if kind == "depth":
        picture = depth_picture(depth, depth_colours(frame.clean))
    elif kind == "error":
        picture = error_picture(depth, frame.clean, error_colours())
    else:
        picture = normal_picture(depth, camera)
    edges = (
        columns.start,
        min(columns.stop, camera.width),
        min(rows.stop, camera.height),
        rows.start,
    )
    axis.imshow(picture[rows, columns], interpolation="nearest", extent=edges)
    axis.set_xticks(np.arange(0, edges[1] + 1, _TICKS_PX))
    axis.set_yticks(np.arange(0, edges[2] + 1, _TICKS_PX))
    axis.set_xlim(edges[:2])
    axis.set_ylim(edges[2:])


def _draw_side_view(axis: Axes, depth: Depth, frame: FigureFrame) -> None:
    half = half_width_mm()
    try:
        picture = side_view(depth, frame.clean, frame.window.intrinsics)
    except DeviceError as error:
        axis.text(0.5, 0.5, f"needs OpenGL:\n{error}", fontsize=4, ha="center", wrap=True)
        return
    axis.imshow(picture, extent=(-half, half, -half, half))
    axis.set_xticks([-_TICKS_MM, 0, _TICKS_MM])
    axis.set_yticks([-_TICKS_MM, 0, _TICKS_MM])


def _label(axes: Sequence[Axes], kind: PanelRow, bottom: bool) -> None:
    """Label the axes of a row of panels with their units, px or mm.

    The vertical axis is labelled at the left end; the horizontal ones only if ``bottom``.
    """
    unit = "mm" if kind == "side" else "px"
    for number, axis in enumerate(axes):
        axis.tick_params(labelsize=_TEXT_SIZE, length=2, width=0.4)
        axis.tick_params(labelleft=number == 0, labelbottom=bottom)
        for side in axis.spines.values():
            side.set_linewidth(0.4)
        if bottom:
            axis.set_xlabel(f"x [{unit}]", fontsize=_TEXT_SIZE)
    up = "up" if kind == "side" else "row"
    axes[0].set_ylabel(f"{_LABELS[kind]}\n{up} [{unit}]", fontsize=_TITLE_SIZE - 1)


def _colour_bar(figure: Figure, axis: Axes, kind: PanelRow, frame: FigureFrame) -> None:
    if kind == "normals":
        _normal_key(axis)
        return
    if kind == "side":
        axis.set_visible(False)
        return
    mapping = depth_colours(frame.clean) if kind == "depth" else error_colours()
    figure.colorbar(mapping, cax=axis)
    text = "depth [mm]" if kind == "depth" else "method - truth [mm]"
    axis.set_ylabel(text, fontsize=_TEXT_SIZE)
    axis.tick_params(labelsize=_TEXT_SIZE)


def _normal_key(axis: Axes) -> None:
    """Say which direction has which colour."""
    axis.set_axis_off()
    lines = (("right", (1.0, 0.5, 0.5)), ("up", (0.5, 1.0, 0.5)), ("to camera", (0.5, 0.5, 1.0)))
    for place, (text, colour) in enumerate(lines):
        dark = matplotlib("colors").to_hex([0.8 * part for part in colour])
        axis.text(
            0.0, 0.65 - 0.15 * place, f"■ {text}", color=dark, fontsize=_TEXT_SIZE,
            transform=axis.transAxes,
        )  # fmt: skip
