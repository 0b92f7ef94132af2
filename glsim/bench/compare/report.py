"""The result of a comparison: its rows, as Markdown and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from glsim.bench.compare.classifier import Verdict
from glsim.bench.measures.cells import DISTANCES_M, RADII_PX
from glsim.bench.measures.correlation import LAGS
from glsim.bench.measures.light import RINGS_PX, Light
from glsim.bench.measures.pattern import FixedPattern
from glsim.bench.measures.silhouettes import Silhouettes
from glsim.bench.measures.spatial import SpatialNoise
from glsim.bench.measures.stacks import ratio
from glsim.bench.measures.temporal import TemporalNoise
from glsim.core.files.atomic import without_nan
from glsim.core.files.markdown import markdown_table


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
        rows = [
            Row(group, name, unit, first, second, as_ratio)
            for (group, name, unit, first, as_ratio), (*_, second, _) in zip(
                _lines(self.first), _lines(self.second), strict=True
            )
        ]
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


#: One line of a set: group, name, unit, value, and whether sets are compared by their ratio.
_Line = tuple[str, str, str, float, bool]


def _lines(m: Measurements) -> Iterator[_Line]:
    """Return all measures of a set, in the same order for every set; NaN for what it lacks."""
    for group, noise, of in (
        ("temporal sigma", m.temporal, "temporal noise"),
        ("spatial sigma (residual of a quadric in 7x7, rms)", m.spatial, "the residual"),
    ):
        found = {(c.distance_m, c.radius_px): c.value for c in noise.cells}
        for near, far in pairwise(DISTANCES_M):
            for inner, outer in pairwise(RADII_PX):
                name = f"{near:g} to {far:g} m, {inner:.0f} to {outer:.0f} px"
                value = found.get(((near, far), (inner, outer)), math.nan)
                yield group, name, "mm", value, True
        for (down, right), value in zip(LAGS, noise.correlation, strict=True):
            along = f"{max(down, right)} px along {'xy'[down > 0]}"
            yield f"correlation of {of}", "diagonal" if down and right else along, "", value, False
    group = "residual of surfaces from a quadric in 7x7"
    for name, value in zip(("p10", "median", "p90"), m.spatial.rough_mm, strict=True):
        yield group, name, "mm", value, True
    pattern = m.pattern
    yield "fixed pattern", "rows", "mm", pattern.rows_mm, True
    half_step = pattern.alternation_rms_mm
    yield "fixed pattern", "alternation of rows, rms half step", "mm", half_step, True
    yield "fixed pattern", "columns", "mm", pattern.columns_mm, True
    yield "fixed pattern", "rest", "mm", pattern.rest_mm, True
    alike = pattern.rest_correlation
    yield "fixed pattern", "rest, correlation at 1 px along x", "", alike, False
    for k, value in enumerate(pattern.alternation_mm):
        name = f"half step of odd rows, {k + 1}/{len(pattern.alternation_mm)} from the top"
        yield "fixed pattern", name, "mm", value, False
    yield from _light_lines(m.light)
    on_right = m.silhouettes.shadow_side == "right"
    lit, dark = m.silhouettes.left, m.silhouettes.right
    for name, side in zip(("lit", "shadow"), (lit, dark) if on_right else (dark, lit), strict=True):
        group = f"silhouettes, {name} side"
        yield group, "width of the gap, median", "px", side.width_px, True
        yield group, "width of the gap, mean", "px", side.width_mean_px, True
        yield group, "invalid pixels of it, median", "px", side.invalid_px, True
        yield group, "invalid share of 8 px outside", "%", 100 * side.band_invalid, True
        yield group, "behind the background, share of 8 px", "%", 100 * side.band_behind, True
        if name == "shadow":
            yield group, "width over S: slope", "mm", side.slope_mm, True
            yield group, "width over S: offset", "px", side.offset_px, False
    for inner, outer, share in m.invalid:
        name = f"{inner:.0f} to {outer:.0f} px"
        yield "pixels without depth", name, "%", 100 * share, True


def _light_lines(light: Light | None) -> Iterator[_Line]:
    nan = math.nan
    for words, law in (
        ("static pairs", light.temporal if light else None),
        ("residuals in 7x7", light.spatial if light else None),
    ):
        group = f"noise over infrared, {words}: sigma^2 = a^2 + (b / IR)^2"
        yield group, "a", "mm", law.floor_mm if law else nan, True
        yield group, "b", "mm counts", law.slope_mm if law else nan, True
    group, unit = "IR r^2 / cos of the brightest surfaces", "counts m^2"
    yield group, "median over the distances", unit, light.overall if light else nan, True
    for k, (near, far) in enumerate(pairwise(DISTANCES_M)):
        value = light.brightness[k][2] if light else nan
        yield group, f"{near:g} to {far:g} m", unit, value, True
    for k, (inner, outer) in enumerate(pairwise(RINGS_PX)):
        name = f"{inner:.0f} to {outer:.0f} px, relative to the centre"
        yield group, name, "", light.rings[k][2] if light else nan, True
    saturated = 100 * light.saturated if light else nan
    yield "infrared", "saturated pixels", "%", saturated, False


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
