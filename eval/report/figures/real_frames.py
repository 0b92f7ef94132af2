"""Figures of scores on a real recording: the measures, and one crop by every method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.denoise import load_denoiser
from glsim.denoise.composites import COMPOSITES, DEFAULT_COMPOSITE
from glsim.denoise.interface import Depth
from glsim.eval.real_frames.frame_truth import BINS_M, SHIFT_BIN_MM
from glsim.eval.real_frames.results import RealScores
from glsim.eval.real_frames.split import SplitRecording
from glsim.eval.report.figures.style import matplotlib, method_style, new_figure
from glsim.measures.frame import DepthFrame
from glsim.preview import shaded
from glsim.recordings.board_corners import board_corners

_TEXT_SIZE: Final = 7
#: The shift of networks without calibration is a few mm, that of filters tenths of one.
_SHIFT_RANGE_MM: Final = 6.0
#: Ends of the names of methods that are not drawn: tables have all composites.
_OTHERS: Final = tuple(f" [{name}]" for name in COMPOSITES if name != DEFAULT_COMPOSITE)
#: Side of the crop, px, most methods side by side, range of the colours of differences, mm.
_CROP_PX, _MOST_COLUMNS, _RANGE_MM = 176, 6, 8.0
_FILLED, _LOST, _NOTHING = "#ffc20a", "#1a1a1a", "#dcdcdc"


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


def crops_figure(recording: SplitRecording, denoisers: Sequence[str]) -> Any:
    """Draw a part of the frame in the middle of the recording by every method: shaded, difference.

    The part is around the chessboard, or the middle of the image. Raises what denoisers raise.
    """
    number = len(recording.frames) // 2
    frame = recording.frames[number]
    raw = np.nan_to_num(frame.depth_mm)
    maps: dict[str, Depth] = {"raw": raw}
    for method in map(load_denoiser, denoisers):
        maps[method.label] = method(raw).depth_mm
    return _draw_crops(frame, maps, _cut(recording, frame))


def _cut(recording: SplitRecording, frame: DepthFrame) -> tuple[slice, slice]:
    source = recording.source
    corners = board_corners(frame, source.path, source.pattern)
    shape = frame.depth_mm.shape
    middle = np.array(shape) / 2 if corners is None else corners.mean(axis=0)[::-1]
    starts = [
        int(np.clip(at - _CROP_PX / 2, 0, max(size - _CROP_PX, 0)))
        for at, size in zip(middle, shape, strict=True)
    ]
    return slice(starts[0], starts[0] + _CROP_PX), slice(starts[1], starts[1] + _CROP_PX)


def _draw_crops(frame: DepthFrame, maps: Mapping[str, Depth], cut: tuple[slice, slice]) -> Any:
    bands = -(-len(maps) // _MOST_COLUMNS)
    columns = -(-len(maps) // bands)
    figure = new_figure(1.7 * columns, 3.7 * bands + 0.4)
    axes = figure.subplots(2 * bands, columns, squeeze=False)
    for axis in axes.ravel():
        axis.set_axis_off()
    colours = matplotlib("colors")
    mapping = matplotlib("cm").ScalarMappable(colours.Normalize(-_RANGE_MM, _RANGE_MM), "RdBu_r")
    raw = maps["raw"]
    for number, (name, depth) in enumerate(maps.items()):
        band, column = divmod(number, columns)
        above, below = axes[2 * band, column], axes[2 * band + 1, column]
        picture = shaded(depth / np.float32(1000), frame.camera)[..., ::-1]
        above.imshow(picture[cut], interpolation="nearest")
        above.set_title(name.replace(":", ":\n", 1).replace(",cleanup=0", ""), fontsize=_TEXT_SIZE)
        below.imshow(_difference(depth, raw, mapping)[cut], interpolation="nearest")
    bar = figure.colorbar(mapping, ax=axes[:, -1], fraction=0.04, aspect=40)
    bar.ax.tick_params(labelsize=_TEXT_SIZE)
    bar.set_label("denoised - raw [mm]", fontsize=_TEXT_SIZE)
    patch = matplotlib("patches").Patch
    figure.legend(
        handles=[
            patch(facecolor=_FILLED, label="filled: no depth in the raw frame"),
            patch(facecolor=_LOST, label="lost: depth in the raw frame alone"),
            patch(facecolor=_NOTHING, label="no depth in either"),
        ],
        loc="outside lower center", ncols=3, fontsize=_TEXT_SIZE, frameon=False,
    )  # fmt: skip
    figure.suptitle(f"frame {frame.name}: shaded, and denoised - raw", fontsize=_TEXT_SIZE + 1)
    return figure


def _difference(depth: Depth, raw: Depth, mapping: Any) -> NDArray[np.float64]:
    picture: NDArray[np.float64] = mapping.to_rgba(depth - raw)[..., :3]
    valid, measured = depth > 0, raw > 0
    for pixels, colour in (
        (~valid & ~measured, _NOTHING),
        (valid & ~measured, _FILLED),
        (~valid & measured, _LOST),
    ):
        picture[pixels] = np.array(matplotlib("colors").to_rgb(colour))
    return picture
