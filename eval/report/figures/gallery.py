"""Figure of one frame by every method: depth, signed error, normals, side view, scan line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from glsim.denoise.interface import Depth
from glsim.depth_protocol import add_offset
from glsim.errors import DeviceError
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
from glsim.eval.report.figures.side_view import TURN_DEG, side_view
from glsim.eval.report.figures.style import matplotlib, new_figure
from glsim.geometry.camera import Intrinsics

#: Margin around the nearest and farthest depth of scan lines, mm.
_MARGIN_MM: Final = 25.0
_TITLE_SIZE, _TEXT_SIZE = 7, 6
#: Distance of faces whose distance is not known, mm: that of the paper's.
_ASSUMED_MM: Final = 900.0


@dataclass(frozen=True, eq=False)
class GalleryFrame:
    """A frame for the figure; surfaces are drawn at their distance from the camera.

    Attributes:
        predictions: method -> (H, W) millimetres, 0 = no depth.
        offset_mm: subtracted from all maps; NaN if unknown, then the face is drawn at 0.9 m.
    """

    clean: Depth
    intrinsics: Intrinsics
    predictions: Mapping[str, Depth]
    caption: str
    offset_mm: float = 0.0

    def in_space(self, depth: Depth) -> Depth:
        """Return a map in millimetres from the camera."""
        known = math.isfinite(self.offset_mm)
        return add_offset(depth, self.offset_mm if known else _ASSUMED_MM)


def method_gallery(frame: GalleryFrame) -> Any:
    """Draw a column for the truth and one per method, all in one scale; return the figure."""
    clean = frame.clean
    columns = {"clean": clean, **frame.predictions}
    cut = face_window(clean)
    low, high = depth_range(clean)
    row = nose_row(clean)
    figure = new_figure(1.35 * len(columns) + 0.9, 7.6)
    # The last column holds the colour bars.
    axes = figure.subplots(
        5,
        len(columns) + 1,
        squeeze=False,
        width_ratios=[1.0] * len(columns) + [0.06],
        height_ratios=[1.0, 1.0, 1.0, 1.0, 0.9],
    )
    depth_map, error_map = depth_colours(clean), error_colours()
    for column, (name, prediction) in enumerate(columns.items()):
        panel = axes[:, column]
        panel[0].set_title(_wrapped(name), fontsize=_TITLE_SIZE)
        panel[0].imshow(depth_picture(prediction, depth_map)[cut], interpolation="nearest")
        panel[0].axhline(row - cut[0].start, color="black", linewidth=0.5, linestyle=":")
        panel[1].imshow(error_picture(prediction, clean, error_map)[cut], interpolation="nearest")
        picture = normal_picture(frame.in_space(prediction), frame.intrinsics)
        panel[2].imshow(picture[cut], interpolation="nearest")
        _draw_side_view(panel[3], prediction, frame)
        _draw_scan(panel[4], prediction[row], clean[row], cut[1], (low, high))
        for axis in panel[:4]:
            axis.set_xticks([])
            axis.set_yticks([])
            for side in axis.spines.values():
                side.set_visible(False)
        if column:
            panel[4].set_yticklabels([])
    titles = ("depth", "prediction - clean", "normals", f"from {TURN_DEG:.0f}°", "scan line [mm]")
    for axis, text in zip(axes[:, 0], titles, strict=True):
        axis.set_ylabel(text, fontsize=_TITLE_SIZE)
    for axis, mapping in zip(axes[:, -1], (depth_map, error_map, None, None, None), strict=True):
        if mapping is None:
            axis.set_visible(False)
            continue
        figure.colorbar(mapping, cax=axis)
        axis.set_ylabel("mm", fontsize=_TEXT_SIZE)
        axis.tick_params(labelsize=_TEXT_SIZE)
    _legend(figure, columns=5 if len(columns) > 4 else 2)
    figure.suptitle(frame.caption, fontsize=_TITLE_SIZE)
    return figure


def _legend(figure: Any, columns: int) -> None:
    truth = matplotlib("lines").Line2D([], [], color="#888888", linewidth=1.5, label="clean")
    figure.legend(
        handles=[*colour_legend(), truth],
        loc="outside lower center", ncols=columns, fontsize=_TEXT_SIZE, frameon=False,
    )  # fmt: skip


def _wrapped(name: str) -> str:
    return name.replace(":", ":\n", 1).replace(",", ",\n").replace(" [", "\n[")


def _draw_side_view(axis: Any, prediction: Depth, frame: GalleryFrame) -> None:
    try:
        maps = frame.in_space(prediction), frame.in_space(frame.clean)
        axis.imshow(side_view(*maps, frame.intrinsics))
    except DeviceError as error:
        axis.text(0.5, 0.5, f"needs OpenGL:\n{error}", fontsize=4, ha="center", wrap=True)


def _draw_scan(
    axis: Any, prediction: Depth, clean: Depth, cut: slice, limits: tuple[float, float]
) -> None:
    columns = np.arange(len(clean))
    axis.plot(columns, np.where(clean > 0, clean, np.nan), color="#888888", linewidth=1.5)
    axis.plot(
        columns,
        np.where(prediction > 0, prediction, np.nan),
        color="#0072b2",
        linewidth=0.5,
        marker=".",
        markersize=1.5,
    )
    axis.set_xlim(cut.start, cut.stop)
    axis.set_ylim(limits[1] + _MARGIN_MM, limits[0] - _MARGIN_MM)
    axis.tick_params(labelsize=_TEXT_SIZE - 1, length=2)
