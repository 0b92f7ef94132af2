"""Figure of one frame by every method: depth, signed error, normals, side view, scan line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.denoise.protocol import Depth
from glsim.depth_protocol import add_offset
from glsim.errors import DeviceError
from glsim.eval.report.figures.side_view import TURN_DEG, side_view
from glsim.eval.report.figures.style import matplotlib, new_figure
from glsim.geometry.camera import Intrinsics
from glsim.geometry.depth_map import normals

#: Range of the signed-error colours, mm, in every figure.
ERROR_RANGE_MM: Final = 10.0
#: Colours: no depth in either map; depth without a surface; a surface without depth.
NOTHING, FALSE_VALID, FALSE_INVALID = "#dcdcdc", "#ffc20a", "#1a1a1a"
#: Margins around the face, px, and around its nearest and farthest depth, mm.
_MARGIN_PX, _MARGIN_MM = 6, 25.0
_TITLE_SIZE, _TEXT_SIZE = 7, 6
#: Distance of faces whose distance is not known, mm: that of the paper's.
_ASSUMED_MM: Final = 900.0


@dataclass(frozen=True, eq=False)
class GalleryFrame:
    """A frame for the figure. predictions: method -> (H, W) millimetres, 0 = no depth.

    offset_mm: what was subtracted from all maps; NaN if it is not known. Surfaces are drawn at
    their distance from the camera (0.9 m if that is not known).
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
    cut = _around(clean)
    low, high = _range(clean)
    row = _nose_row(clean)
    figure = new_figure(1.35 * len(columns) + 0.9, 7.6)
    # The last column holds the colour bars.
    axes = figure.subplots(
        5,
        len(columns) + 1,
        squeeze=False,
        width_ratios=[1.0] * len(columns) + [0.06],
        height_ratios=[1.0, 1.0, 1.0, 1.0, 0.9],
    )
    colours = matplotlib("colors")
    depth_map, error_map = (
        matplotlib("cm").ScalarMappable(colours.Normalize(a, b), name)
        for a, b, name in ((low, high, "viridis_r"), (-ERROR_RANGE_MM, ERROR_RANGE_MM, "RdBu_r"))
    )
    for column, (name, prediction) in enumerate(columns.items()):
        panel = axes[:, column]
        panel[0].set_title(_wrapped(name), fontsize=_TITLE_SIZE)
        panel[0].imshow(_depth_picture(prediction, depth_map)[cut], interpolation="nearest")
        panel[0].axhline(row - cut[0].start, color="black", linewidth=0.5, linestyle=":")
        panel[1].imshow(_error_picture(prediction, clean, error_map)[cut], interpolation="nearest")
        picture = _normal_picture(frame.in_space(prediction), frame.intrinsics)
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
    patch = matplotlib("patches").Patch
    lines = matplotlib("lines").Line2D
    figure.legend(
        handles=[
            patch(facecolor=FALSE_VALID, label="depth where there is no surface"),
            patch(facecolor=FALSE_INVALID, label="surface without depth"),
            patch(facecolor=NOTHING, label="no depth in either"),
            lines([], [], marker="o", linestyle="", markersize=3, color="#dc1e1e",
                  label="flying pixel"),
            lines([], [], color="#888888", linewidth=1.5, label="clean"),
        ],
        loc="outside lower center", ncols=columns, fontsize=_TEXT_SIZE, frameon=False,
    )  # fmt: skip


def _wrapped(name: str) -> str:
    return name.replace(":", ":\n", 1).replace(",", ",\n").replace(" [", "\n[")


def _around(clean: Depth) -> tuple[slice, slice]:
    """Return rows and columns of the face with a margin; the whole image without a face."""
    rows, columns = (np.flatnonzero((clean > 0).any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return slice(0, clean.shape[0]), slice(0, clean.shape[1])
    return (
        slice(max(0, int(rows[0]) - _MARGIN_PX), int(rows[-1]) + 1 + _MARGIN_PX),
        slice(max(0, int(columns[0]) - _MARGIN_PX), int(columns[-1]) + 1 + _MARGIN_PX),
    )


def _range(clean: Depth) -> tuple[float, float]:
    """Return the range of the depth colours, mm: the truth's depths without the farthest 1 %."""
    depths = clean[clean > 0]
    if depths.size == 0:
        return 0.0, 1.0
    low, high = np.percentile(depths, [0, 99])
    return float(low), float(max(high, low + 1))


def _nose_row(clean: Depth) -> int:
    """Return the row of the nearest point."""
    return int(np.argmin(np.where(clean > 0, clean, np.inf).min(axis=1)))


def _rgb(colour: str) -> NDArray[np.float64]:
    return np.array(matplotlib("colors").to_rgb(colour))


def _depth_picture(depth: Depth, mapping: Any) -> NDArray[np.float64]:
    picture: NDArray[np.float64] = mapping.to_rgba(depth)[..., :3]
    picture[depth <= 0] = _rgb(NOTHING)
    return picture


def _error_picture(prediction: Depth, clean: Depth, mapping: Any) -> NDArray[np.float64]:
    picture: NDArray[np.float64] = mapping.to_rgba(prediction - clean)[..., :3]
    valid, real = prediction > 0, clean > 0
    for pixels, colour in (
        (~valid & ~real, NOTHING),
        (valid & ~real, FALSE_VALID),
        (~valid & real, FALSE_INVALID),
    ):
        picture[pixels] = _rgb(colour)
    return picture


def _normal_picture(depth: Depth, intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Colour normals as usual: x is red, y (up) green, towards the camera blue."""
    normal = normals(depth / np.float32(1000), intrinsics.rays())
    picture: NDArray[np.float64] = 0.5 + 0.5 * normal.astype(np.float64) * (1, -1, -1)
    picture[depth <= 0] = _rgb(NOTHING)
    return picture


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
