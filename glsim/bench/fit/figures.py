"""Figures of noise and silhouettes with their standard errors, of frames and of their replays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from glsim.bench.compare.comparison import lines_of, measure
from glsim.core.depth_frame import Frames
from glsim.measures.disparity import LAGS_PX, measure_blocks, to_disparity
from glsim.measures.silhouettes import find_edges, measure_silhouettes
from glsim.measures.stacks import jackknife_error
from glsim.measures.static import UNMASKED_LAYER

#: Parts of the columns, or bands of rows, whose spread says the errors, and fewest parts with a
#: value. Chosen: a part of 100 px shows gaps and rows.
_PARTS, _LEAST_PARTS = 5, 3
#: Widest masked strip at the rim of still surfaces, px. Chosen: a gap of 40 px, and on both sides
#: 8 px of the mask of motion, 4 px of its windows, and 5 px that flicker.
_MOST_RIM_PX = 75
#: Groups and names of measures that are no noise, by their starts.
_LEFT_OUT = ("pixels without depth", "infrared", "IR r^2", "half step")
#: A value and its standard error, NaN = unknown.
Value = tuple[float, float]
Figures = dict[str, Value]

#: Figures of a fit: those that parameters move, and gaps.
FRAME, STATIC = "noise from frame to frame", "noise that stays"
WAVES, FINE = (
    "noise that stays: correlation at 4 px over 1 px",
    "noise that stays: correlation at 1 px",
)
HOLES = "single holes; pixels unlike their eight neighbours"
GAPS = ("width of the gap, mean; left of silhouettes", "width of the gap, mean; right of them")
LIGHT = "b; noise over infrared, static pairs: sigma^2 = a^2 + (b / IR)^2"
#: Figures that replays are compared by, beside those of disparity, by their starts.
_COMPARED = ("single", "width of the gap, mean;", "2 px along", "median; residual", LIGHT)
#: Stands for focal length times baseline, px mm, where none is known: 1/km is 1 mm at 1 m.
INVERSE_KM = 1e6
#: Lags at which correlations are listed, px.
_LISTED_PX = (1, 2, 4, 8)


def compared_figures(frames: Frames) -> Figures:
    """Return the measures that tell replays apart."""
    found = values_with_errors(frames).items()
    return {name: value for name, value in found if name.startswith(_COMPARED)}


def values_with_errors(frames: Frames) -> Figures:
    """Return measures of noise and silhouettes by name, with errors from parts of the image."""
    rims = _with_rims(frames)
    sides, parts, found = measure_silhouettes(rims), [], _gaps(rims)
    for part, part_rims in zip(_parts(frames), _parts(rims), strict=True):
        own = replace(measure_silhouettes(part_rims), shadow_side=sides.shadow_side)
        parts.append(lines_of(replace(measure(part), silhouettes=own)))
    for key, value in lines_of(replace(measure(frames), silhouettes=sides)).items():
        each = np.array([part.get(key, math.nan) for part in parts])
        each = each[np.isfinite(each)]
        error = each.std(ddof=1) / len(each) ** 0.5 if len(each) >= _LEAST_PARTS else math.nan
        if math.isfinite(value) and not any(text.startswith(_LEFT_OUT) for text in key[:2]):
            found[f"{key[1]}; {key[0]}"] = value, float(error)
    return found


def _with_rims(frames: Frames) -> Frames:
    """Return depths at the rims of still surfaces too, which flicker and so count as moving."""
    side, shown = np.ones((1, _MOST_RIM_PX), np.uint8), []
    for frame in frames:
        still = (frame.noisy_mm > 0).astype(np.uint8)
        near = cv2.morphologyEx(still, cv2.MORPH_CLOSE, side) > 0
        depth_mm = frame.layer(UNMASKED_LAYER if UNMASKED_LAYER in frame else "noisy_mm")
        shown.append(frame.changed({"noisy_mm": np.where(near, depth_mm, np.float32(0))}))
    return Frames.of(shown, frames.title)


def _parts(frames: Frames) -> list[Frames]:
    """Cut frames into parts of the columns, each with its own camera."""
    camera, parts = frames.intrinsics, []
    width = camera.width // _PARTS
    names = [name for name in ("noisy_mm", "infrared") if name in frames[0]]
    for left in range(0, _PARTS * width, width):
        own = replace(camera, width=width, cx=camera.cx - left)
        at = np.s_[:, left : left + width]
        cut = [f.changed({n: f.layer(n)[at] for n in names}, intrinsics=own) for f in frames]
        parts.append(Frames.of(cut, frames.title))
    return parts


def _gaps(frames: Frames) -> Figures:
    """Measure the mean width of the gaps left and right of silhouettes, px."""
    edges = [find_edges(frame) for frame in frames]
    side, row, width = (
        np.concatenate([getattr(e, name) for e in edges]) for name in ("side", "row", "width")
    )
    band, found = row * _PARTS // frames.intrinsics.height, {}
    for number, name in enumerate(GAPS):
        own = side == number
        bands = np.unique(band[own])
        if len(bands) >= _LEAST_PARTS:
            without = [width[own & (band != k)].mean() for k in bands]
            found[name] = float(width[own].mean()), float(jackknife_error(without))
    return found


def disparity_figures(frames: Frames, focal_baseline_px_mm: float) -> Figures:
    """Measure the noise of disparity on planes of a still view, px; NaN with too few planes.

    With ``INVERSE_KM`` as product it is that of 1 / depth, 1/km.
    """
    disparity = [to_disparity(f.measured_mm, focal_baseline_px_mm) for f in frames]
    noise = measure_blocks(disparity, list(pairwise(range(len(disparity)))))
    found: Figures = {}

    def add(name: str, values: Sequence[float]) -> None:
        found[name] = values[0], float(jackknife_error(values[1:]))

    add("residual of planes", [n.residual for n in noise])
    add(FRAME, [n.frame for n in noise])
    add(STATIC, [n.static for n in noise])
    static = np.array([np.add(n.static_rows, n.static_columns) / 2 for n in noise])
    add(WAVES, (static[:, LAGS_PX.index(4)] / static[:, 0]).tolist())
    add(FINE, static[:, 0].tolist())
    for part, title in (("frame", FRAME), ("static", STATIC)):
        for axis in ("rows", "columns"):
            for lag in _LISTED_PX:
                at = LAGS_PX.index(lag)
                name = f"{title}: correlation at {lag} px along {axis}"
                add(name, [getattr(n, f"{part}_{axis}")[at] for n in noise])
    return found


def mean_figures(drawn: Sequence[Figures]) -> Figures:
    """Average figures of several devices; their spread is a part of the error."""
    means: Figures = {}
    for name in drawn[0]:
        values = np.array([figures.get(name, (math.nan,) * 2) for figures in drawn])
        error = math.hypot(np.sqrt((values[:, 1] ** 2).mean()), values[:, 0].std(ddof=1))
        means[name] = float(values[:, 0].mean()), error / len(drawn) ** 0.5
    return means


def figure_text(value: Value) -> str:
    """Write a value and its standard error; "-" if it is unknown."""
    digits = 3 if abs(value[0]) < 0.2 else 2 if abs(value[0]) < 100 else 0
    spread = f" +- {value[1]:.{digits}f}" if math.isfinite(value[1]) else ""
    return f"{value[0]:.{digits}f}{spread}" if math.isfinite(value[0]) else "-"
