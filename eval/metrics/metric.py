"""Type of a metric of one frame: name, unit, better direction, definition and function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from glsim.eval.metrics.scored_map import ScoredMap

Direction = Literal["lower", "higher", "neither"]
MetricGroup = Literal["paper", "validity", "depth", "normals", "time"]
#: Group of metrics -> title of its table, in the order of the columns of rows.csv.
GROUPS: Final[dict[MetricGroup, str]] = {
    "paper": "The paper's metrics: all pixels, holes are depth 0",
    "validity": "Which pixels have depth",
    "depth": "Surface",
    "normals": "Surface",
    "time": "Surface",
}
#: Column of rows.csv -> its name in tables.
_TITLES: Final = {
    "mse_mm2": "MSE", "psnr_db": "PSNR", "mse_flips_pct": "share of flips in MSE",
    "ssim_paper": "SSIM, paper", "ssim_standard": "SSIM", "ssim_16bit": "SSIM, 16 bits",
    "iou": "IoU", "flips_px": "wrong validity",
    "flying_px": "flying pixels", "both_rmse_mm": "RMSE", "input_interior_rmse_mm": "RMSE inside",
    "both_edge_rmse_mm": "RMSE at edges", "input_rmse_mm": "RMSE, input's pixels",
    "input_bias_mm": "bias", "filled_rmse_mm": "RMSE, filled pixels",
    "relief_kept_pct": "relief kept", "systematic_mm2": "systematic error",
    "normal_mean_deg": "normals", "normal_good_pct": "normals within 10°", "time_ms": "time",
}  # fmt: skip


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
        title = _TITLES.get(self.name, self.name)
        return f"{title} [{self.unit}]" if self.unit != "1" else title

    @property
    def arrow(self) -> str:
        """Arrow in the better direction, for tables; "" if neither direction is better."""
        return {"lower": "↓", "higher": "↑", "neither": ""}[self.better]
