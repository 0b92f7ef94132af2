"""Figure that compares methods: rows of depth, errors, normals and side views.

The first column is the truth; a column per method follows, with the truth's colour scales.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal

import numpy as np

from glsim.core.array_types import Depth
from glsim.core.depth_frame import DepthFrame
from glsim.core.depth_map import normals
from glsim.core.units import add_offset, to_metres
from glsim.eval.report.figures.side_view import FLYING, TURN_DEG, half_width_mm, side_view
from glsim.eval.report.figures.style import add_note, matplotlib, new_figure

PanelRow = Literal["depth", "error", "normals", "side"]
#: Kind of panels in a row -> labels left of and below its first panel.
_LABELS: Final[dict[PanelRow, tuple[str, str]]] = {
    "depth": ("depth\nrow [px]", "column [px]"),
    "error": ("prediction - truth\nrow [px]", "column [px]"),
    "normals": ("normals\nrow [px]", "column [px]"),
    "side": (f"from {TURN_DEG:.0f}°\nup [mm]", "right [mm]"),
}
#: Kind of panels -> label of its colour bar.
_BARS: Final = {"depth": "depth [mm]", "error": "← too near   [mm]   too far →"}
PANEL_ROWS: Final[tuple[PanelRow, ...]] = ("depth", "error", "normals", "side")
_TEXT_SIZE: Final = 6
#: Side of a panel; width for labels left and right; height for labels above and below, inch.
_PANEL_IN, _SIDES_IN, _ENDS_IN = 1.35, 1.3, 1.1
#: Height of the label below a row, inch; side of the key of normals, px.
_LABEL_IN, _KEY_PX = 0.15, 48
#: Range of the signed-error colours, mm, in every figure.
_ERROR_RANGE_MM: Final = 10.0
#: Colours of pixels: no depth in both maps, depth in the prediction only, depth in the truth only.
_NOTHING, _FALSE_VALID, _FALSE_INVALID = "#dcdcdc", "#ffc20a", "#1a1a1a"
#: Margin around the face, px.
_MARGIN_PX: Final = 6
#: Distance of the paper's faces, mm; assumed for a face at an unknown distance.
_ASSUMED_MM: Final = 900.0


def method_panels(
    frame: DepthFrame, methods: Mapping[str, Depth], rows: Sequence[PanelRow], note: str
) -> Any:
    """Draw a column of panels for the truth and a column for each method; return the figure.

    Args:
        frame: a frame with clean depth; surfaces are drawn at their distance from the camera.
        methods: title of up to two lines -> (H, W) millimetres, 0 = no depth.
    """
    columns = {"clean": frame.clean_mm, **methods}
    height_in = (_PANEL_IN + _LABEL_IN) * len(rows) + _ENDS_IN
    figure = new_figure(_PANEL_IN * len(columns) + _SIDES_IN, height_in)
    axes = figure.subplots(
        len(rows), len(columns) + 1, squeeze=False, width_ratios=[1.0] * len(columns) + [0.06]
    )
    mappings = {
        "depth": _colours(*_depth_range(frame.clean_mm), "viridis_r"),
        "error": _colours(-_ERROR_RANGE_MM, _ERROR_RANGE_MM, "RdBu_r"),
    }
    for column, (title, depth) in enumerate(columns.items()):
        axes[0, column].set_title(title, fontsize=_TEXT_SIZE + 1)
        for axis, kind in zip(axes[:, column], rows, strict=True):
            _draw(axis, kind, depth, frame, mappings)
            axis.tick_params(labelsize=_TEXT_SIZE - 1, length=2, width=0.4, labelleft=column == 0)
    for axis, kind in zip(axes[:, 0], rows, strict=True):
        left, below = _LABELS[kind]
        axis.set_ylabel(left, fontsize=_TEXT_SIZE)
        axis.set_xlabel(below, fontsize=_TEXT_SIZE, labelpad=1)
        if kind == "normals":
            _draw_key(axis)
    for axis, kind in zip(axes[:, -1], rows, strict=True):
        if kind not in mappings:
            axis.set_visible(False)
            continue
        figure.colorbar(mappings[kind], cax=axis)
        axis.set_ylabel(_BARS[kind], fontsize=_TEXT_SIZE)
        axis.tick_params(labelsize=_TEXT_SIZE)
    figure.legend(
        handles=_legend(), loc="outside upper center", ncols=4 if len(columns) > 3 else 2,
        fontsize=_TEXT_SIZE, frameon=False,
    )  # fmt: skip
    add_note(figure, note)
    return figure


def _draw(
    axis: Any, kind: PanelRow, depth: Depth, frame: DepthFrame, mappings: Mapping[str, Any]
) -> None:
    clean = frame.clean_mm
    seen = clean > 0
    if kind == "side":
        half = half_width_mm()
        surface = side_view(in_space(frame, depth), in_space(frame, clean), frame.intrinsics)
        axis.imshow(surface, extent=(-half, half, -half, half))
        return
    rows, columns = (
        slice(max(0, first - _MARGIN_PX), last + 1 + _MARGIN_PX)
        for first, last in (_ends(seen.any(axis=1)), _ends(seen.any(axis=0)))
    )
    picture: Any
    marks: list[tuple[Any, str]] = [(depth <= 0, _NOTHING)]
    if kind == "depth":
        picture = mappings["depth"].to_rgba(depth)[..., :3]
    elif kind == "error":
        picture = mappings["error"].to_rgba(depth - clean)[..., :3]
        marks = [
            ((depth <= 0) & ~seen, _NOTHING),
            ((depth > 0) & ~seen, _FALSE_VALID),
            ((depth <= 0) & seen, _FALSE_INVALID),
        ]
    else:  # red: x, green: y (up), blue: towards the camera
        normal = normals(to_metres(in_space(frame, depth)), frame.rays)
        picture = 0.5 + 0.5 * normal.astype(np.float64) * (1, -1, -1)
    for pixels, colour in marks:
        picture[pixels] = matplotlib("colors").to_rgb(colour)
    height, width = depth.shape
    edges = (columns.start, min(columns.stop, width), min(rows.stop, height), rows.start)
    axis.imshow(picture[rows, columns], interpolation="nearest", extent=edges)
    axis.set_xlim(edges[:2])
    axis.set_ylim(edges[2:])


def _draw_key(axis: Any) -> None:
    """Draw the colours of the normals of a sphere, seen by the camera, into the lower corner."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, _KEY_PX)] * 2)
    z = np.sqrt(np.clip(1 - x * x - y * y, 0, None))
    colours = 0.5 + 0.5 * np.stack([x, -y, z], axis=-1)
    key = axis.inset_axes([0.0, 0.0, 0.24, 0.24])
    key.imshow(np.dstack([colours, z > 0]))
    key.set_axis_off()


def in_space(frame: DepthFrame, depth: Depth) -> Depth:
    """Return the distance from the camera, mm: the depth map plus the frame's offset, or 900 mm."""
    return add_offset(depth, frame.offset_mm if math.isfinite(frame.offset_mm) else _ASSUMED_MM)


def _ends(used: Any) -> tuple[int, int]:
    """Return the first and last true index of ``used``, or of the whole axis if none is true."""
    places = np.flatnonzero(used if used.any() else ~used)
    return int(places[0]), int(places[-1])


def _depth_range(clean: Depth) -> tuple[float, float]:
    """Compute the range of the depth colours, mm, from true depths without the farthest 1 %."""
    low, high = np.percentile(clean[clean > 0], [0, 99]) if (clean > 0).any() else (0, 1)
    return float(low), float(max(high, low + 1))


def _colours(low_mm: float, high_mm: float, name: str) -> Any:
    return matplotlib("cm").ScalarMappable(matplotlib("colors").Normalize(low_mm, high_mm), name)


def _legend() -> list[Any]:
    patch, line = matplotlib("patches").Patch, matplotlib("lines").Line2D
    return [
        patch(facecolor=_FALSE_VALID, label="depth where there is no surface"),
        patch(facecolor=_FALSE_INVALID, label="surface without depth"),
        patch(facecolor=_NOTHING, label="no depth in either"),
        line([], [], marker="o", linestyle="", markersize=3, color=FLYING, label="flying pixel"),
    ]
