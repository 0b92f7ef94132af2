"""Compare networks with the input, the best filter and the goals, cell by cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from glsim.eval.scoring.bias import BiasBin, bias_by_distance, largest_bias
from glsim.eval.scoring.grid_search import SURFACE
from glsim.eval.scoring.statistics import ratio_interval
from glsim.eval.transfer.cells import NOISY, CellScores, pool
from glsim.eval.transfer.study import Goals, SensorFamily


@dataclass(frozen=True)
class Figure:
    """A figure of the tables; ``against`` is the other side of its goal."""

    metric: str
    title: str
    unit: str
    against: Literal["filter", "input"]


FIGURES: Final = (
    Figure(SURFACE, "interior RMSE", "mm", "filter"),
    Figure("normal_mean_deg", "normals", "°", "filter"),
    Figure("flips_px", "flips", "px", "input"),
    Figure("flying_px", "flying pixels", "px", "input"),
)


@dataclass(frozen=True, eq=False)
class CellResult:
    """The scores of a cell in one scene: of the input, the filters and the network.

    ``left_out`` names what the network was not trained on.
    """

    network: str
    left_out: str
    sensor: SensorFamily
    source: str
    scene: str
    scores: CellScores


@dataclass(frozen=True)
class Ratio:
    """A ratio of two means with its 95 % interval over people."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class NetworkComparison:
    """One figure of a network on a cell, or on several pooled cells.

    Attributes:
        network: its name.
        left_out: what it was not trained on.
        sensor: name of the sensor.
        source: of faces; "" if pooled.
        scene: its name; "" if pooled.
        figure: what is compared.
        noisy: mean of the input.
        filter: the best filter by this figure.
        settings: of the filter, one per data set.
        filter_mean: mean of the filter.
        network_mean: mean of the network.
        to_filter: network over filter.
        to_input: network over input.
        goal: largest ratio that meets the goal.
        people: number of scored people.

    """

    network: str
    left_out: str
    sensor: str
    source: str
    scene: str
    figure: Figure
    noisy: float
    filter: str
    settings: tuple[str, ...]
    filter_mean: float
    network_mean: float
    to_filter: Ratio
    to_input: Ratio
    goal: float
    people: int

    @property
    def judged(self) -> Ratio:
        """The ratio that the goal is about."""
        return self.to_filter if self.figure.against == "filter" else self.to_input

    @property
    def verdict(self) -> bool | None:
        """Whether the goal is met; None for an undefined mean."""
        other = self.filter_mean if self.figure.against == "filter" else self.noisy
        if math.isnan(self.network_mean) or math.isnan(other):
            return None
        return self.network_mean <= self.goal * other

    @property
    def sure(self) -> bool:
        """Whether the interval of the ratio does not hold the goal."""
        judged = self.judged
        return not judged.low <= self.goal <= judged.high

    @property
    def verdict_text(self) -> str:
        """The verdict, pass or fail, with a question mark unless it is sure."""
        if self.verdict is None:
            return "n/a"
        text = "pass" if self.verdict else "fail"
        text += "" if self.sure else "?"
        return text if self.verdict else f"**{text}**"


@dataclass(frozen=True)
class BiasComparison:
    """Bias over distance, over all faces and scenes, of a network, the input and the best filter.

    ``bins`` maps the roles "noisy", "filter" and "network" to bins.
    """

    network: str
    left_out: str
    sensor: str
    filter: str
    bins: dict[str, list[BiasBin]]

    @property
    def largest_mm(self) -> float:
        """The network's largest |bias| in a bin with enough pixels; NaN without such bins."""
        return math.nan if self._largest is None else abs(self._largest.mean_mm)

    @property
    def input_there_mm(self) -> float:
        """The input's |bias| in the bin of ``largest_mm``."""
        place = None if self._largest is None else self._largest.from_mm
        there = [b for b in self.bins[NOISY] if b.from_mm == place]
        return abs(there[0].mean_mm) if there else math.nan

    @property
    def _largest(self) -> BiasBin | None:
        return largest_bias(self.bins["network"])


def compare(results: Sequence[CellResult], goals: Goals) -> list[NetworkComparison]:
    """Compare the network of each result by each of FIGURES."""
    return [_comparison(result, figure, goals) for figure in FIGURES for result in results]


def pool_by_sensor(results: Sequence[CellResult]) -> list[CellResult]:
    """Join the results of a network under a sensor over all faces and scenes."""
    groups: dict[tuple[str, str, str], list[CellResult]] = {}
    for result in results:
        key = (result.network, result.left_out, result.sensor.name)
        groups.setdefault(key, []).append(result)
    return [
        replace(
            members[0],
            source="",
            scene="",
            scores=pool([(member.source, member.scores) for member in members]),
        )
        for members in groups.values()
    ]


def compare_bias(pooled: Sequence[CellResult]) -> list[BiasComparison]:
    """Compare the bias over distance. pooled: see ``pool_by_sensor``."""
    compared = []
    for result in pooled:
        best = result.scores.best_filter(SURFACE)
        roles = {NOISY: NOISY, "filter": best.name, "network": result.network}
        bins = {
            role: bias_by_distance(result.scores.methods[name].bias) for role, name in roles.items()
        }
        compared.append(
            BiasComparison(result.network, result.left_out, result.sensor.name, best.name, bins)
        )
    return compared


def goal_of(figure: Figure, sensor: SensorFamily, goals: Goals) -> float:
    """Return the largest ratio that meets the goal of a figure."""
    if figure.metric == "flips_px":
        return goals.flips_ratio
    if figure.metric == "flying_px":
        return goals.flying_ratio
    return goals.tof_ratio if sensor.tof else goals.other_ratio


def _comparison(result: CellResult, figure: Figure, goals: Goals) -> NetworkComparison:
    metric, scores = figure.metric, result.scores
    best, noisy = scores.best_filter(metric), scores.methods[NOISY]
    network = scores.methods[result.network].values(metric)
    return NetworkComparison(
        network=result.network,
        left_out=result.left_out,
        sensor=result.sensor.name,
        source=result.source,
        scene=result.scene,
        figure=figure,
        noisy=noisy.mean(metric),
        filter=best.name,
        settings=tuple(best.settings),
        filter_mean=best.mean(metric),
        network_mean=network.mean,
        to_filter=Ratio(*ratio_interval(network, best.values(metric))),
        to_input=Ratio(*ratio_interval(network, noisy.values(metric))),
        goal=goal_of(figure, result.sensor, goals),
        people=len(best.people),
    )
