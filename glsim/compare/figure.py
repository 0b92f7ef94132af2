"""Draw a comparison as one figure of nine panels."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from glsim.compare.report import Comparison, Measurements
from glsim.errors import require_package
from glsim.measures.cells import Cell
from glsim.measures.correlation import LAGS
from glsim.measures.silhouettes import Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import RcKeyType

#: Colours for grey printing and for colour-blind readers (Okabe and Ito).
_COLOURS = ("#0072B2", "#D55E00")
_MARKS = ("o-", "s--")


def draw_comparison(comparison: Comparison) -> bytes:
    """Draw nine panels as a PNG, 150 dpi. Raises ConfigError without matplotlib."""
    require_package("matplotlib", "--figure", "eval")
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: dict[RcKeyType, object] = {
        "font.size": 8, "axes.titlesize": 8, "axes.titleweight": "bold",
        "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False,
        "legend.frameon": False, "lines.markersize": 3,
    }  # fmt: skip
    sets = (comparison.first, comparison.second)
    with mpl.rc_context(style):
        drawn = Figure(figsize=(11.0, 9.0), layout="constrained")
        FigureCanvasAgg(drawn)
        axes = drawn.subplots(3, 3).ravel()
        for axis, panel in zip(axes, _PANELS, strict=False):
            panel(axis, sets)
        _classifier(axes[8], comparison)
        for number, (m, colour) in enumerate(zip(sets, _COLOURS, strict=True)):
            words = ("first", "second")[number]
            axes[0].plot([], [], _MARKS[number], color=colour, label=f"{words}: {m.title}")
        axes[0].legend(fontsize=7)
        file = io.BytesIO()
        drawn.savefig(file, dpi=150, metadata={"Software": "glsim"})
    return file.getvalue()


def _lines(
    axis: Axes,
    title: str,
    x_label: str,
    y_label: str,
    curves: Iterable[Sequence[tuple[float, float]]],
) -> None:
    for number, curve in enumerate(curves):
        known = [(x, y) for x, y in curve if math.isfinite(y)]
        if known:
            axis.plot(*zip(*known, strict=True), _MARKS[number], color=_COLOURS[number])
    axis.set_title(title)
    axis.set_xlabel(x_label)
    axis.set_ylabel(y_label)


def _by_distance(cells: Sequence[Cell]) -> list[tuple[float, float]]:
    """Average a table within 160 px, by the middle of the distance."""
    found: dict[float, list[float]] = {}
    for cell in cells:
        if cell.radius_px[1] <= 160.0:
            found.setdefault(sum(cell.distance_m) / 2, []).append(cell.value)
    return [(at, float(np.mean(values))) for at, values in sorted(found.items())]


def _temporal(axis: Axes, sets: Sequence[Measurements]) -> None:
    curves = [_by_distance(m.temporal.cells) for m in sets]
    _lines(axis, "temporal sigma, within 160 px", "distance (m)", "mm", curves)


def _spatial(axis: Axes, sets: Sequence[Measurements]) -> None:
    curves = [_by_distance(m.spatial.cells) for m in sets]
    _lines(axis, "residual of a quadric in 7x7", "distance (m)", "mm rms", curves)


def _correlation(axis: Axes, sets: Sequence[Measurements]) -> None:
    names = ["diag" if a and b else f"{max(a, b)}{'xy'[a > 0]}" for a, b in LAGS]
    known = [m.temporal if math.isfinite(m.temporal.correlation[0]) else m.spatial for m in sets]
    both = all(k is m.temporal for k, m in zip(known, sets, strict=True))
    used = [m.temporal if both else m.spatial for m in sets]
    curves = [list(enumerate(map(float, m.correlation))) for m in used]
    title = "correlation of " + ("temporal noise" if both else "residuals")
    _lines(axis, title, "lag (px)", "", [[(float(x), y) for x, y in c] for c in curves])
    axis.set_xticks(range(len(names)), names)
    axis.axhline(0, color="#777777", linewidth=0.5)


def _alternation(axis: Axes, sets: Sequence[Measurements]) -> None:
    curves = [
        [((k + 0.5) / len(m.pattern.alternation_mm), v)
         for k, v in enumerate(m.pattern.alternation_mm)]
        for m in sets
    ]  # fmt: skip
    title = "half step between odd and even rows"
    _lines(axis, title, "place down the image (share)", "mm", curves)
    axis.axhline(0, color="#777777", linewidth=0.5)


def _law(axis: Axes, sets: Sequence[Measurements]) -> None:
    laws = []
    for m in sets:
        law = None if m.light is None else m.light.spatial
        laws.append([] if law is None else [(ir, sigma) for ir, sigma, _ in law.classes])
    _lines(axis, "residual over infrared", "infrared (counts)", "mm", laws)
    if any(laws):
        axis.set_xscale("log")
        axis.set_yscale("log")


def _brightness(axis: Axes, sets: Sequence[Measurements]) -> None:
    curves = [[((a + b) / 2, v) for a, b, v in m.light.brightness] if m.light else [] for m in sets]
    title = r"IR r$^2$ / cos of the brightest surfaces"
    _lines(axis, title, "distance (m)", r"counts m$^2$", curves)
    axis.set_ylim(bottom=0)


def _rings(axis: Axes, sets: Sequence[Measurements]) -> None:
    curves = [[((a + b) / 2, v) for a, b, v in m.light.rings] if m.light else [] for m in sets]
    _lines(axis, "light over the image", "radius (px)", "relative to the centre", curves)
    axis.set_ylim(bottom=0)


def _gaps(axis: Axes, sets: Sequence[Measurements]) -> None:
    names = ("lit: width", "lit: invalid", "shadow: width", "shadow: invalid")
    for number, m in enumerate(sets):
        s = m.silhouettes
        lit, dark = (s.left, s.right) if s.shadow_side == "right" else (s.right, s.left)
        values = [v for side in (lit, dark) for v in _widths(side)]
        at = np.arange(4) + 0.4 * (number - 0.5)
        axis.bar(at, np.nan_to_num(values), 0.38, color=_COLOURS[number])
    axis.set_xticks(range(4), names, rotation=20)
    axis.set_title("gaps beside silhouettes")
    axis.set_ylabel("px, median")


def _widths(side: Side) -> tuple[float, float]:
    return side.width_px, side.invalid_px


def _classifier(axis: Axes, comparison: Comparison) -> None:
    verdicts = comparison.verdicts
    values = [v.auc for v in verdicts.values()]
    axis.barh(range(len(values)), np.nan_to_num(values), color="#009E73")
    axis.set_yticks(range(len(values)), [k.replace(", ", "\n") for k in verdicts])
    axis.set_xlim(0.5, 1.0)
    axis.invert_yaxis()
    axis.set_title("AUC of the classifier")
    axis.set_xlabel("0.5 = indistinguishable")


_PANELS = (
    _temporal, _spatial, _correlation, _alternation, _law, _brightness, _rings, _gaps,
)  # fmt: skip
