"""Methods side by side: depth, errors, normals, surfaces from aside and a scan line in rows.

A column for the truth and one per method, all in the scales of the truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from glsim.core.camera import Intrinsics
from glsim.core.depth_protocol import add_offset
from glsim.core.errors import DeviceError
from glsim.denoise.interface import Depth
from glsim.eval.report.figures.map_pictures import (
    colour_legend,
    depth_colours,
    depth_picture,
    depth_range,
    error_colours,
    error_picture,
    face_window,
    normal_picture,
    nose_row,
)
from glsim.eval.report.figures.side_view import TURN_DEG, half_width_mm, side_view
from glsim.eval.report.figures.style import add_note, new_figure

PanelRow = Literal["depth", "error", "normals", "side", "scan"]
#: Row -> label at its left end.
_LABELS: Final[dict[PanelRow, str]] = {
    "depth": "depth\nrow [px]",
    "error": "error\nrow [px]",
    "normals": "normals\nrow [px]",
    "side": f"from {TURN_DEG:.0f}°\nup [mm]",
    "scan": "scan line [mm]",
}
PANEL_ROWS: Final[tuple[PanelRow, ...]] = ("depth", "error", "normals", "side", "scan")
_TITLE_SIZE, _TEXT_SIZE = 8, 6
#: Side of a panel, and room for labels at both sides, and at both ends, inch.
_PANEL_IN, _SIDES_IN, _ENDS_IN = 1.35, 1.2, 1.1
#: Margin around the nearest and farthest depth of scan lines, mm.
_MARGIN_MM: Final = 25.0
#: Distance of faces whose distance is not known, mm: that of the paper's.
_ASSUMED_MM: Final = 900.0


@dataclass(frozen=True, eq=False)
class PanelFrame:
    """The frame of a figure; surfaces are drawn at their distance from the camera.

    Attributes:
        clean: (H, W) millimetres, 0 = no depth.
        intrinsics: its camera.
        title: names the frame.
        offset_mm: subtracted from all maps; NaN if unknown, then the face is drawn at 0.9 m.
    """

    clean: Depth
    intrinsics: Intrinsics
    title: str = ""
    offset_mm: float = 0.0

    def in_space(self, depth: Depth) -> Depth:
        """Return a map in millimetres from the camera."""
        return add_offset(depth, self.offset_mm if math.isfinite(self.offset_mm) else _ASSUMED_MM)


def method_panels(
    frame: PanelFrame, methods: Mapping[str, Depth], rows: Sequence[PanelRow], note: str
) -> Any:
    """Draw a column of panels for the truth and for each method; return the figure.

    Args:
        frame: the frame.
        methods: title -> (H, W) millimetres, 0 = no depth; lines after the first are small.
        rows: kinds of panels.
        note: a line below the panels.
    """
    columns = {"clean": frame.clean, **methods}
    figure = new_figure(_PANEL_IN * len(columns) + _SIDES_IN, _PANEL_IN * len(rows) + _ENDS_IN)
    axes = figure.subplots(
        len(rows), len(columns) + 1, squeeze=False, width_ratios=[1.0] * len(columns) + [0.06]
    )
    mappings = {"depth": depth_colours(frame.clean), "error": error_colours()}
    for column, (title, depth) in enumerate(columns.items()):
        name, _, small = title.partition("\n")
        axes[0, column].set_title(f"{name}\n{small}", fontsize=_TEXT_SIZE if small else _TITLE_SIZE)
        for axis, kind in zip(axes[:, column], rows, strict=True):
            _draw(axis, kind, depth, frame, mappings)
            axis.tick_params(labelsize=_TEXT_SIZE - 1, length=2, width=0.4, labelleft=column == 0)
    for axis, kind in zip(axes[:, 0], rows, strict=True):
        axis.set_ylabel(_LABELS[kind], fontsize=_TEXT_SIZE)
    for axis, kind in zip(axes[:, -1], rows, strict=True):
        if kind not in mappings:
            axis.set_visible(False)
            continue
        figure.colorbar(mappings[kind], cax=axis)
        axis.set_ylabel("mm", fontsize=_TEXT_SIZE)
        axis.tick_params(labelsize=_TEXT_SIZE)
    figure.legend(
        handles=colour_legend(), loc="outside upper center", ncols=4 if len(columns) > 3 else 2,
        fontsize=_TEXT_SIZE, frameon=False,
    )  # fmt: skip
    add_note(figure, note)
    return figure


def _draw(
    axis: Any, kind: PanelRow, depth: Depth, frame: PanelFrame, mappings: Mapping[str, Any]
) -> None:
    rows, columns = face_window(frame.clean)
    if kind == "side":
        _draw_side_view(axis, depth, frame)
        return
    if kind == "scan":
        row, (low, high) = nose_row(frame.clean), depth_range(frame.clean)
        for line, colour, width in (
            (frame.clean[row], "#888888", 1.5),
            (depth[row], "#0072b2", 0.6),
        ):
            axis.plot(np.where(line > 0, line, np.nan), color=colour, linewidth=width)
        axis.set_xlim(columns.start, columns.stop)
        axis.set_ylim(high + _MARGIN_MM, low - _MARGIN_MM)
        return
    if kind == "depth":
        picture = depth_picture(depth, mappings["depth"])
        axis.axhline(nose_row(frame.clean), color="black", linewidth=0.4, linestyle=":")
    elif kind == "error":
        picture = error_picture(depth, frame.clean, mappings["error"])
    else:
        picture = normal_picture(frame.in_space(depth), frame.intrinsics)
    height, width = depth.shape
    edges = (columns.start, min(columns.stop, width), min(rows.stop, height), rows.start)
    axis.imshow(picture[rows, columns], interpolation="nearest", extent=edges)
    axis.set_xlim(edges[:2])
    axis.set_ylim(edges[2:])


def _draw_side_view(axis: Any, depth: Depth, frame: PanelFrame) -> None:
    half = half_width_mm()
    try:
        picture = side_view(frame.in_space(depth), frame.in_space(frame.clean), frame.intrinsics)
    except DeviceError as error:
        axis.text(0.5, 0.5, f"needs OpenGL:\n{error}", fontsize=4, ha="center", wrap=True)
        return
    axis.imshow(picture, extent=(-half, half, -half, half))
