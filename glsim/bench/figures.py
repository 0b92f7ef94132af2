"""Figures of ``glsim compare`` and ``glsim validate``: one page each, PNG, by Matplotlib."""

from __future__ import annotations

import io
import math
from pathlib import Path
from textwrap import fill
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.bench.compare.comparison import Comparison
from glsim.bench.validate.report import Band, ValidationReport
from glsim.core.depth_frame import Frames
from glsim.core.errors import counted
from glsim.core.files.atomic import write_atomic

#: Most frames of a page. Relief is depth minus its mean in a window of this side, px; colours reach
#: to this many times the first set's median relief. Letters of a title's line. Chosen.
_FRAMES, _WINDOW_PX, _COLOURS, _TITLE_LETTERS = 4, 13, 6.0, 160


def draw_comparison(comparison: Comparison, first: Frames, second: Frames, file: Path) -> None:
    """Draw frames of both sets: depth and relief, the first set left, and the summary."""
    count = min(len(first), len(second))
    numbers = sorted({*np.linspace(0, count - 1, _FRAMES).astype(int).tolist()})
    figure = _figure(13.0, 0.6 + 2.7 * len(numbers))
    lines = [fill(line.replace("*", ""), _TITLE_LETTERS) for line in comparison.summary()[:2]]
    taken = f"{comparison.first.taken}; {comparison.second.taken}"
    lines.append(f"Measured: {taken}. Drawn: {counted(len(numbers), 'frame')} of each set.")
    figure.suptitle("\n".join(lines), fontsize=8)
    axes = figure.subplots(len(numbers), 4, squeeze=False)
    for row, number in zip(axes, numbers, strict=True):
        depths = [np.nan_to_num(f[number].measured_mm) for f in (first, second)]
        reliefs = [_relief(depth) for depth in depths]
        most = _COLOURS * float(np.nanmedian(np.abs(reliefs[0])))
        near, far = np.quantile(np.concatenate([d[d > 0] for d in depths]), (0.02, 0.98))
        depths = [np.where(depth > 0, depth, np.nan) for depth in depths]
        names = [f"{frames.title[-20:]}: {frames[number].name[-30:]}" for frames in (first, second)]
        for axis, name in zip(row, (*names, *(f"{name}: relief" for name in names)), strict=True):
            axis.set_title(name, fontsize=8)
        for pair, maps, colours, low, high, name in (
            (row[:2], depths, "viridis_r", near, far, "depth [mm]"),
            (row[2:], reliefs, "RdBu", -most, most, "relief [mm]"),
        ):
            style = {"cmap": colours, "vmin": low, "vmax": high, "interpolation": "nearest"}
            drawn = [axis.imshow(each, **style) for axis, each in zip(pair, maps, strict=True)]
            figure.colorbar(drawn[0], ax=pair, label=name, shrink=0.8)
    for axis in axes.flat:
        axis.set(xticks=[], yticks=[], facecolor="black")
    _save(figure, file)


def draw_validation(report: ValidationReport, file: Path) -> None:
    """Draw each published band as a bar of one width, and the simulated number on it."""
    rows = [(r, band, r.value(band)) for r in report.results for band in r.bands]
    figure = _figure(9.0, 1.0 + 0.17 * len(rows))
    axis = figure.subplots()
    axis.axvspan(0.0, 1.0, color="0.85", label="published")
    places = [_place(band, value) for _, band, value in rows]
    colours = ["C0" if band.holds(value) else "C3" for _, band, value in rows]
    axis.scatter(places, range(len(rows)), c=colours, s=14, zorder=2, label="simulated")
    names = [f"{r.check.number}: {b.key} {v:.3g} ({b.text})" for r, b, v in rows]
    axis.set_yticks(range(len(rows)), names, fontsize=7)
    axis.set(xlim=(-1.1, 2.1), ylim=(len(rows) - 0.5, -0.5), xticks=[])
    axis.set_title(f"{report.title}\n{report.sheet}", fontsize=9)
    axis.legend(fontsize=7, loc="upper right")
    _save(figure, file)


def _place(band: Band, value: float) -> float:
    """Return a number's place in units of its band's width, 0 at the low end, -1 to 2."""
    width = band.high - band.low
    if not math.isfinite(width) or width == 0:
        width = abs(band.low if math.isfinite(band.low) else band.high) or 1.0
    low = band.low if math.isfinite(band.low) else band.high - width
    return float(np.clip((value - low) / width, -1.0, 2.0))


def _relief(depth_mm: NDArray[np.float32]) -> NDArray[Any]:
    """Compute relief, depth minus its mean in a window around the pixel, mm; NaN without depth."""
    known, size = (depth_mm > 0).astype(np.float64), (_WINDOW_PX, _WINDOW_PX)
    mean = cv2.blur(depth_mm * known, size) / np.maximum(cv2.blur(known, size), 1e-9)
    return np.where(known > 0, depth_mm - mean, np.nan)


def _figure(width_in: float, height_in: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def _save(figure: Any, file: Path) -> None:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110, metadata={"Software": None})
    write_atomic(stream.getvalue(), file)
