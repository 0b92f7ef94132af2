"""The result of a comparison: its rows, as Markdown and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from glsim.compare.classifier import Verdict
from glsim.files.atomic import without_nan
from glsim.files.markdown import markdown_table
from glsim.measures.cells import DISTANCES_M, RADII_PX, Cell
from glsim.measures.correlation import LAGS
from glsim.measures.light import Light
from glsim.measures.pattern import FixedPattern
from glsim.measures.silhouettes import Side, Silhouettes
from glsim.measures.spatial import SpatialNoise
from glsim.measures.stacks import ratio
from glsim.measures.temporal import TemporalNoise


@dataclass(frozen=True)
class Measurements:
    """All measures of one set; size is (width, height), px, light is None without infrared."""

    title: str
    frames: int
    size: tuple[int, int]
    temporal: TemporalNoise
    spatial: SpatialNoise
    pattern: FixedPattern
    light: Light | None
    silhouettes: Silhouettes
    invalid: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Row:
    """One line of the table, compared by second / first, or else by second - first."""

    group: str
    name: str
    unit: str
    first: float
    second: float
    as_ratio: bool = True

    @property
    def change(self) -> float:
        """The ratio or the difference; NaN if either is unknown."""
        if self.as_ratio:
            return ratio(self.second, self.first)
        return self.second - self.first


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two measured sets, and the verdict of the classifier on each kind of patches."""

    first: Measurements
    second: Measurements
    verdicts: dict[str, Verdict]

    @property
    def rows(self) -> list[Row]:
        """The lines of the table that at least one set has."""
        rows = list(_rows(self.first, self.second))
        return [r for r in rows if math.isfinite(r.first) or math.isfinite(r.second)]

    def as_markdown(self) -> str:
        """Return the table of measures, and that of the classifier if there is one."""
        a, b = self.first, self.second
        head = ["measure", "unit", f"first: {a.title}", f"second: {b.title}", "second / first"]
        lines = [
            f"# {a.title} against {b.title}",
            "",
            f"{a.frames} frames of {a.size[0]}x{a.size[1]} with {a.temporal.pairs} static pairs; "
            f"{b.frames} frames of {b.size[0]}x{b.size[1]} with {b.temporal.pairs}. The last "
            "column is the ratio, or the difference where it has a sign.",
            "",
        ]
        group = ""
        table: list[list[str]] = []
        for row in self.rows:
            if row.group != group:
                table.append([f"**{row.group}**", "", "", "", ""])
                group = row.group
            table.append(
                [row.name, row.unit, _number(row.first), _number(row.second), _change(row)]
            )
        lines += markdown_table(head, table)
        verdicts = []
        for kind, v in self.verdicts.items():
            tells = "; ".join(
                f"{t.feature} {_number(t.first)} / {_number(t.second)} (alone {t.auc:.2f})"
                for t in v.telling
            )
            few = "too few patches"
            aucs = [f"{a:.2f}" if math.isfinite(a) else few for a in (v.auc, v.boosted_auc)]
            verdicts.append([kind, *aucs, str(v.patches), tells])
        if verdicts:
            lines += [
                "",
                "AUC of a logistic regression and of boosted trees on patches; 0.5 = "
                "indistinguishable. Features whose medians differ most come first.",
                "",
            ]
            head = ["patches", "AUC", "boosted", "of each", "what tells, median first / second"]
            lines += markdown_table(head, verdicts)
        return "\n".join(lines) + "\n"

    def as_json(self) -> dict[str, Any]:
        """Return everything as JSON values; None where a measure is not known."""
        tree: dict[str, Any] = {
            "first": asdict(self.first),
            "second": asdict(self.second),
            "rows": [asdict(row) | {"change": row.change} for row in self.rows],
            "classifier": {kind: asdict(v) for kind, v in self.verdicts.items()},
        }
        return {key: without_nan(value) for key, value in tree.items()}


def _rows(a: Measurements, b: Measurements) -> Iterator[Row]:
    yield from _cell_rows("temporal sigma", a.temporal.cells, b.temporal.cells)
    yield from _lag_rows("correlation of temporal noise", a.temporal, b.temporal)
    yield from _cell_rows(
        "spatial sigma (residual of a quadric in 7x7, rms)", a.spatial.cells, b.spatial.cells
    )
    yield from _lag_rows("correlation of the residual", a.spatial, b.spatial)
    for part, x, y in zip(
        ("p10", "median", "p90"), a.spatial.rough_mm, b.spatial.rough_mm, strict=True
    ):
        yield Row("residual of surfaces from a quadric in 7x7", part, "mm", x, y)
    yield from _pattern_rows(a.pattern, b.pattern)
    yield from _light_rows(a.light, b.light)
    for name in ("lit", "shadow"):
        yield from _side_rows(name, _side(a.silhouettes, name), _side(b.silhouettes, name))
    for (inner, outer, x), (_, _, y) in zip(a.invalid, b.invalid, strict=True):
        yield Row("pixels without depth", f"{inner:.0f} to {outer:.0f} px", "%", 100 * x, 100 * y)


def _cell_rows(group: str, a: tuple[Cell, ...], b: tuple[Cell, ...]) -> Iterator[Row]:
    """Pair the cells of two tables, in the order of distances and radii."""
    first = {(c.distance_m, c.radius_px): c.value for c in a}
    second = {(c.distance_m, c.radius_px): c.value for c in b}
    for near, far in pairwise(DISTANCES_M):
        for inner, outer in pairwise(RADII_PX):
            key = ((near, far), (inner, outer))
            if key in first or key in second:
                name = f"{near:g} to {far:g} m, {inner:.0f} to {outer:.0f} px"
                yield Row(group, name, "mm", first.get(key, math.nan), second.get(key, math.nan))


def _lag_rows(
    group: str, a: TemporalNoise | SpatialNoise, b: TemporalNoise | SpatialNoise
) -> Iterator[Row]:
    for (down, right), x, y in zip(LAGS, a.correlation, b.correlation, strict=True):
        name = "diagonal" if down and right else f"{max(down, right)} px along {'xy'[down > 0]}"
        yield Row(group, name, "", x, y, as_ratio=False)


def _pattern_rows(a: FixedPattern, b: FixedPattern) -> Iterator[Row]:
    group = "fixed pattern"
    for name, x, y in (
        ("rows", a.rows_mm, b.rows_mm),
        ("alternation of rows, rms half step", a.alternation_rms_mm, b.alternation_rms_mm),
        ("columns", a.columns_mm, b.columns_mm),
        ("rest", a.rest_mm, b.rest_mm),
    ):
        yield Row(group, name, "mm", x, y)
    x, y = a.rest_correlation, b.rest_correlation
    yield Row(group, "rest, correlation at 1 px along x", "", x, y, as_ratio=False)
    count = len(a.alternation_mm)
    for k, (x, y) in enumerate(zip(a.alternation_mm, b.alternation_mm, strict=True)):
        name = f"half step of odd rows, {k + 1}/{count} from the top"
        yield Row(group, name, "mm", x, y, as_ratio=False)


def _light_rows(a: Light | None, b: Light | None) -> Iterator[Row]:
    def both(name: str) -> tuple[float, float]:
        """Look up a dotted name in the measures of both sets; NaN for a set without infrared."""
        values = []
        for light in (a, b):
            value: Any = light
            for part in name.split("."):
                value = math.nan if value is None else getattr(value, part, math.nan)
            values.append(float(value))
        return values[0], values[1]

    for kind, words in (("temporal", "static pairs"), ("spatial", "residuals in 7x7")):
        group = f"noise over infrared, {words}: sigma^2 = a^2 + (b / IR)^2"
        yield Row(group, "a", "mm", *both(f"{kind}.floor_mm"))
        yield Row(group, "b", "mm counts", *both(f"{kind}.slope_mm"))
    group = "IR r^2 / cos of the brightest surfaces"
    yield Row(group, "median over the distances", "counts m^2", *both("overall"))
    known = a or b
    if known is None:
        return
    for k, (near, far, _) in enumerate(known.brightness):
        x, y = (math.nan if light is None else light.brightness[k][2] for light in (a, b))
        yield Row(group, f"{near:g} to {far:g} m", "counts m^2", x, y)
    for k, (inner, outer, _) in enumerate(known.rings):
        x, y = (math.nan if light is None else light.rings[k][2] for light in (a, b))
        name = f"{inner:.0f} to {outer:.0f} px, relative to the centre"
        yield Row(group, name, "", x, y)
    saturated = [100 * value for value in both("saturated")]
    yield Row("infrared", "saturated pixels", "%", saturated[0], saturated[1], as_ratio=False)


def _side(silhouettes: Silhouettes, name: str) -> Side:
    on_right = silhouettes.shadow_side == "right"
    return silhouettes.right if on_right == (name == "shadow") else silhouettes.left


def _side_rows(name: str, a: Side, b: Side) -> Iterator[Row]:
    group = f"silhouettes, {name} side"
    for words, unit, field, scale in (
        ("width of the gap, median", "px", "width_px", 1.0),
        ("width of the gap, mean", "px", "width_mean_px", 1.0),
        ("invalid pixels of it, median", "px", "invalid_px", 1.0),
        ("invalid share of 8 px outside", "%", "band_invalid", 100.0),
        ("behind the background, share of 8 px", "%", "band_behind", 100.0),
    ):
        yield Row(group, words, unit, scale * getattr(a, field), scale * getattr(b, field))
    if name == "shadow":
        yield Row(group, "width over S: slope", "mm", a.slope_mm, b.slope_mm)
        yield Row(group, "width over S: offset", "px", a.offset_px, b.offset_px, as_ratio=False)


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    size = abs(value)
    digits = 0 if size >= 100 else 1 if size >= 10 else 2
    return f"{value:,.{digits}f}"


def _change(row: Row) -> str:
    if not math.isfinite(row.change):
        return ""
    return f"{row.change:.2f}" if row.as_ratio else f"{row.change:+.2f}"
