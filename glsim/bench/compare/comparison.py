"""Comparison of two sets of frames: the measures and tables of ``glsim compare``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from itertools import pairwise, product
from typing import Any

import numpy as np

from glsim.bench.compare.classifier import TellingFeature, Verdict, tell_apart
from glsim.bench.compare.patches import KINDS, Patches, edge_patches, surface_patches
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError, counted, pip_install
from glsim.core.files.atomic import without_nan
from glsim.core.files.markdown import markdown_table
from glsim.measures.correlation import LAGS
from glsim.measures.depth_noise import (
    DISTANCES_M,
    RADII_PX,
    SpatialNoise,
    TemporalNoise,
    measure_spatial,
    measure_temporal,
)
from glsim.measures.light import Light, measure_light
from glsim.measures.pattern import FixedPattern, measure_pattern
from glsim.measures.silhouettes import Silhouettes, measure_silhouettes
from glsim.measures.stacks import ratio
from glsim.measures.static import static_pairs, view_numbers
from glsim.measures.validity import measure_invalid, measure_isolated

#: Lowest AUC that a replay can reach (regression / trees): simulated frames of a sensor, compared
#: with their replay through the same sensor.
_FLOORS = {"planes": (0.51, 0.51), "curved": (0.59, 0.57), "silhouettes, shadow side": (0.60, 0.61)}


@dataclass(frozen=True)
class Measurements:
    """All measures of one set.

    ``taken`` says how many frames of how many; ``size`` is (width, height), px; ``light`` is None
    without infrared; ``isolated`` are the shares of single holes and of single depths.
    """

    title: str
    frames: int
    taken: str
    size: tuple[int, int]
    temporal: TemporalNoise
    spatial: SpatialNoise
    pattern: FixedPattern
    light: Light | None
    silhouettes: Silhouettes
    invalid: tuple[tuple[float, float, float], ...]
    isolated: tuple[float, float]

    def shown(self) -> str:
        """Say which frames were measured."""
        pairs = counted(self.temporal.pairs, "static pair")
        return f"{self.taken} of {self.size[0]}x{self.size[1]} px with {pairs}"


@dataclass(frozen=True)
class Row:
    """A table row: a measure of both sets, and its change: second / first or second - first."""

    group: str
    name: str
    unit: str
    first: float
    second: float
    as_ratio: bool = True

    @property
    def change(self) -> float:
        """The ratio or the difference; NaN if either value is unknown."""
        return ratio(self.second, self.first) if self.as_ratio else self.second - self.first


@dataclass(frozen=True, eq=False)
class Comparison:
    """Measures of two sets, and the classifier's verdict on each kind of patches."""

    first: Measurements
    second: Measurements
    verdicts: dict[str, Verdict]
    replayed: bool = False

    @property
    def told(self) -> float:
        """Mean AUC of the regression on planes and curved surfaces; 1 if there are too few."""
        aucs = [v.auc for kind, v in self.verdicts.items() if kind in KINDS[:2]]
        known = [auc for auc in aucs if math.isfinite(auc)]
        return sum(known) / len(known) if known else 1.0

    @property
    def rows(self) -> list[Row]:
        """Lines of the table with a value in at least one set."""
        first, second = lines_of(self.first), lines_of(self.second)
        rows = [
            Row(*key[:3], first.get(key, math.nan), second.get(key, math.nan), key[3])
            for key in (first if self.first.light else second)
        ]
        return [r for r in rows if math.isfinite(r.first) or math.isfinite(r.second)]

    def summary(self) -> list[str]:
        """Say how well trees tell the sets apart, by what, and what to do."""
        known = {kind: v for kind, v in self.verdicts.items() if math.isfinite(v.boosted_auc)}
        if not known:
            return ["No patches are classified: the sets are compared by the measures alone."]
        aucs, tells = [], []
        for kind, v in known.items():
            floor = _FLOORS.get(kind, (0.5, 0.5))[1]
            aucs.append(f"{kind} {v.boosted_auc:.2f} +- {v.boosted_auc_error:.2f} (floor {floor})")
            if v.boosted_auc > floor + 2 * v.boosted_auc_error:
                tells.append(f"{kind} by {', '.join(_told(t) for t in v.telling[:1])}")
        do = "nothing: what is left is told from a sensor's own frames as well"
        if tells:
            do = "fit a sensor to the first set (glsim fit), or change the stage (glsim tune)"
            if not self.replayed:
                do += "; scenes that differ, too: glsim compare REAL --replay SENSOR"
        return [
            f"**Told apart**, AUC (0.5 = not at all): {'; '.join(aucs)}.",
            f"**By what**, median first / second: {'; '.join(tells) or 'nothing'}.",
            f"**To do**: {do}.",
        ]

    def as_markdown(self) -> str:
        """Return the summary, the table of measures, and the classifier's if there is one."""
        a, b = self.first, self.second
        head = ["measure", "unit", f"first: {a.title}", f"second: {b.title}", "second / first"]
        lines = [
            f"# {a.title} against {b.title}",
            "",
            *(f"- {line}" for line in self.summary()),
            "",
            f"{a.shown()}; {b.shown()}. The last column is the ratio, or the difference where it "
            "has a sign.",
            "",
        ]
        group = ""
        table: list[list[str]] = []
        for row in self.rows:
            if row.group != group:
                table.append([f"**{row.group}**", "", "", "", ""])
                group = row.group
            sign = "" if row.as_ratio else "+"
            change = f"{row.change:{sign}.2f}" if math.isfinite(row.change) else ""
            table.append([row.name, row.unit, _number(row.first), _number(row.second), change])
        lines += markdown_table(head, table)
        verdicts = []
        for kind, v in self.verdicts.items():
            tells = "; ".join(f"{_told(t)} (alone {t.auc:.2f})" for t in v.telling)
            aucs = [
                f"{auc:.2f} +- {error:.2f}" if math.isfinite(auc) else "too few patches"
                for auc, error in ((v.auc, v.auc_error), (v.boosted_auc, v.boosted_auc_error))
            ]
            floor = " / ".join(f"{auc:.2f}" for auc in _FLOORS.get(kind, ())) or "-"
            verdicts.append([kind, *aucs, floor, str(v.patches), tells])
        if verdicts:
            lines += [
                "",
                "AUC of a logistic regression and of boosted trees on patches, +- the standard "
                "error; 0.5 = indistinguishable; floor: of a sensor's own frames, replayed. "
                "Features whose medians differ most come first. Silhouettes have depth on both "
                "sides: heads before nothing have few (scene.wall_mm sets a wall).",
                "",
            ]
            head = ["patches", "AUC", "boosted", "floor", "of each"]
            lines += markdown_table([*head, "what tells, median first / second"], verdicts)
        return "\n".join(lines) + "\n"

    def as_json(self) -> dict[str, Any]:
        """Return all measures and verdicts as JSON values; None for unknown measures."""
        tree: dict[str, Any] = {
            "first": asdict(self.first),
            "second": asdict(self.second),
            "rows": [asdict(row) | {"change": row.change} for row in self.rows],
            "classifier": {kind: asdict(v) for kind, v in self.verdicts.items()},
        }
        return {key: without_nan(value) for key, value in tree.items()}


#: Measures of one set: (group, name, unit, whether two sets are compared by ratio) -> value.
_Lines = dict[tuple[str, str, str, bool], float]


def lines_of(m: Measurements) -> _Lines:
    """Return all measures of a set as lines of the table, in a fixed order."""
    lines: _Lines = {}

    def add(group: str, name: str, unit: str, value: float, as_ratio: bool = True) -> None:
        lines[group, name, unit, as_ratio] = value

    for group, noise, of in (
        ("temporal sigma", m.temporal, "temporal noise"),
        ("spatial sigma (residual of a quadric in 7x7, rms)", m.spatial, "the residual"),
    ):
        sigmas = {(c.distance_m, c.radius_px): c.value for c in noise.cells}
        for (near, far), (inner, outer) in product(pairwise(DISTANCES_M), pairwise(RADII_PX)):
            name = f"{near:g} to {far:g} m, {inner:.0f} to {outer:.0f} px"
            add(group, name, "mm", sigmas.get(((near, far), (inner, outer)), math.nan))
        for (down, right), value in zip(LAGS, noise.correlation, strict=True):
            along = f"{max(down, right)} px along {'xy'[down > 0]}"
            name = "diagonal" if down and right else along
            add(f"correlation of {of}", name, "", value, False)
    group = "residual of surfaces from a quadric in 7x7"
    for name, value in zip(("p10", "median", "p90"), m.spatial.rough_mm, strict=True):
        add(group, name, "mm", value)
    group, pattern = "fixed pattern", m.pattern
    add(group, "rows", "mm", pattern.rows_mm)
    add(group, "alternation of rows, rms half step", "mm", pattern.alternation_rms_mm)
    add(group, "columns", "mm", pattern.columns_mm)
    add(group, "rest", "mm", pattern.rest_mm)
    add(group, "rest, correlation at 1 px along x", "", pattern.rest_correlation, False)
    for k, value in enumerate(pattern.alternation_mm):
        name = f"half step of odd rows, {k + 1}/{len(pattern.alternation_mm)} from the top"
        add(group, name, "mm", value, False)
    lines |= _light_lines(m.light) if m.light else {}
    lines |= _silhouette_lines(m.silhouettes)
    for inner, outer, share in m.invalid:
        add("pixels without depth", f"{inner:.0f} to {outer:.0f} px", "%", 100 * share)
    for name, share in zip(("single holes", "single depths"), m.isolated, strict=True):
        add("pixels unlike their eight neighbours", name, "%", 100 * share)
    return lines


def _light_lines(light: Light) -> _Lines:
    lines: _Lines = {}
    for words, law in (("static pairs", light.temporal), ("residuals in 7x7", light.spatial)):
        group = f"noise over infrared, {words}: sigma^2 = a^2 + (b / IR)^2"
        lines[group, "a", "mm", True] = law.floor_mm
        lines[group, "b", "mm counts", True] = law.slope_mm
    group, unit = "IR r^2 / cos of the brightest surfaces", "counts m^2"
    lines[group, "median over the distances", unit, True] = light.overall
    for near, far, value in light.brightness:
        lines[group, f"{near:g} to {far:g} m", unit, True] = value
    for inner, outer, value in light.rings:
        lines[group, f"{inner:.0f} to {outer:.0f} px, relative to the centre", "", True] = value
    lines["infrared", "saturated pixels", "%", False] = 100 * light.saturated
    return lines


def _silhouette_lines(found: Silhouettes) -> _Lines:
    lines: _Lines = {}
    lit, dark = found.lit_and_shadow
    for name, side in (("lit", lit), ("shadow", dark)):
        lines |= {
            (f"silhouettes, {name} side", text, unit, True): value
            for text, unit, value in (
                ("width of the gap, median", "px", side.width_px),
                ("width of the gap, mean", "px", side.width_mean_px),
                ("invalid pixels of it, median", "px", side.invalid_px),
                ("invalid share of 8 px outside", "%", 100 * side.band_invalid),
                ("behind the background, share of 8 px", "%", 100 * side.band_behind),
            )
        }
    lines["silhouettes, shadow side", "width over S: slope", "mm", True] = dark.slope_mm
    lines["silhouettes, shadow side", "width over S: offset", "px", False] = dark.offset_px
    return lines


def _told(feature: TellingFeature) -> str:
    return f"{feature.feature} {_number(feature.first)} / {_number(feature.second)}"


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    size = abs(value)
    digits = 0 if size >= 100 else 1 if size >= 10 else 2
    return f"{value:,.{digits}f}"


def measure(frames: Frames) -> Measurements:
    """Measure noise, pattern, light, silhouettes and holes of one set of depth frames."""
    pairs = static_pairs(frames)
    size = frames.intrinsics.width, frames.intrinsics.height
    return Measurements(
        frames.title, len(frames), frames.note or counted(len(frames), "frame"), size,
        measure_temporal(frames, pairs), measure_spatial(frames), measure_pattern(frames),
        measure_light(frames, pairs), measure_silhouettes(frames), measure_invalid(frames),
        measure_isolated(frames),
    )  # fmt: skip


def compare_sets(
    first: Frames, second: Frames, progress: Callable[[str], None] | None = None
) -> Comparison:
    """Measure both sets and classify their patches; report each step's name to ``progress``.

    Without scikit-learn there are no verdicts. Raises ConfigError if the depths of the sets do not
    overlap: most likely one set has another unit.
    """
    say = progress or (lambda _: None)
    spans = [
        np.nanquantile(np.concatenate([f.measured_mm[::4, ::4].ravel() for f in frames]), (0, 1))
        for frames in (first, second)
    ]
    if spans[0][0] > spans[1][1] or spans[1][0] > spans[0][1]:
        texts = " and ".join(f"{low:.0f} to {high:.0f} mm" for low, high in spans)
        raise ConfigError(
            f"{first.title} and {second.title} have depths of {texts}: nothing can be compared; "
            "give the unit of the files, --depth-unit-mm"
        )
    measured = []
    for frames in (first, second):
        say(f"measuring {frames.title}")
        measured.append(measure(frames))
    verdicts: dict[str, Verdict] = {}
    if find_spec("sklearn") is None:
        say(f"no classifier: it needs scikit-learn: {pip_install('eval')}")
    else:
        say("classifying patches")
        patches: list[dict[str, Patches]] = [
            surface_patches(frames) | edge_patches(frames, m.silhouettes.shadow_side)
            for frames, m in zip((first, second), measured, strict=True)
        ]
        views = [view_numbers(frames) for frames in (first, second)]
        verdicts = {k: tell_apart(patches[0][k], patches[1][k], *views) for k in KINDS}
    return Comparison(measured[0], measured[1], verdicts)
