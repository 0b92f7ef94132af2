"""Type of a metric of one frame: name, unit, better direction, definition and function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from glsim.eval.metrics.scored_map import ScoredMap

Direction = Literal["lower", "higher", "neither"]
MetricGroup = Literal["paper", "validity", "depth", "normals", "time"]
#: Groups of metrics in the order of the columns of rows.csv -> the title of their table.
GROUPS: Final[dict[MetricGroup, str]] = {
    "paper": "The paper's block: all pixels, holes are depth 0",
    "validity": "Validity",
    "depth": "Depth and surface",
    "normals": "Depth and surface",
    "time": "Depth and surface",
}


@dataclass(frozen=True)
class Metric:
    """A metric of one frame, which is a column of rows.csv.

    Args:
        name: ends with the unit, such as "mse_mm2".
        unit: "1" for shares.
        better: the direction of better values.
        group: one of GROUPS.
        help: the definition in one line.
        value: computes the metric of a frame, NaN where it is undefined; None: others compute it.
        in_table: whether it is a column of table.md; table.csv has all metrics.
    """

    name: str
    unit: str
    better: Direction
    group: MetricGroup
    help: str
    value: Callable[[ScoredMap], float] | None = None
    in_table: bool = False

    @property
    def heading(self) -> str:
        """Name and unit, for tables."""
        return f"{self.name} [{self.unit}]" if self.unit != "1" else self.name

    @property
    def arrow(self) -> str:
        """Arrow in the better direction, for tables; "" if neither direction is better."""
        return {"lower": "↓", "higher": "↑", "neither": ""}[self.better]
