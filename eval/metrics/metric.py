"""Type of a metric of one frame: name, unit, better direction, definition and function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from glsim.eval.metrics.scored_map import ScoredMap
from glsim.settings.toml_tables import read_toml

Direction = Literal["lower", "higher", "neither"]
MetricGroup = Literal["paper", "validity", "depth", "form"]
#: Descriptions of the shipped metrics, see the file.
DESCRIPTIONS: Final = read_toml(Path(__file__).with_name("metrics.toml"))
#: Group of metrics -> title of its table, in the order of table.md.
GROUPS: Final[dict[MetricGroup, str]] = DESCRIPTIONS["groups"]


@dataclass(frozen=True)
class Metric:
    """A metric of one frame, which is a column of rows.csv.

    Args:
        name: ends with the unit, such as "mse_mm2".
        unit: "1" for shares.
        value: computes the metric of a frame, NaN if undefined. None: ``score`` or its caller does.
        in_table: whether the metric is a column of table.md; table.csv has all metrics.
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
        """Plain name and unit, for tables."""
        title = DESCRIPTIONS["titles"].get(self.name, self.name)
        return f"{title} [{self.unit}]" if self.unit != "1" else title

    @property
    def arrow(self) -> str:
        """Arrow in the better direction, for tables; "" if neither direction is better."""
        return {"lower": "↓", "higher": "↑", "neither": ""}[self.better]
