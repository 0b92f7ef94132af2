"""The list of all metrics: name, unit, better direction, definition.

Data sets with face regions also have a copy of some metrics per region: see ``regions``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from glsim.eval.metrics.ssim import PRESETS
from glsim.geometry.edges import BAND_PX

#: A depth with a larger error, mm, is a flying pixel.
FLYING_MM: Final = 50.0
#: The MAX of the paper's PSNR, mm.
PSNR_MAX_MM: Final = 8000.0
#: A normal with a smaller error, degrees, counts as good.
NORMAL_DEG: Final = 10.0

Direction = Literal["lower", "higher", "neither"]
MetricGroup = Literal["paper", "validity", "depth", "normals", "regions", "time"]


@dataclass(frozen=True)
class Metric:
    """A column of rows.csv. ``help`` is its definition in one line; ``block`` groups metrics."""

    name: str
    unit: str
    better: Direction
    block: MetricGroup
    help: str

    @property
    def heading(self) -> str:
        """Name and unit, for tables."""
        return f"{self.name} [{self.unit}]" if self.unit != "1" else self.name

    @property
    def arrow(self) -> str:
        """Arrow in the better direction, for tables; "" if neither is better."""
        return {"lower": "↓", "higher": "↑", "neither": ""}[self.better]


#: Base sets of pixels: key -> definition.
SETS: Final = {
    "both": "prediction and clean valid",
    "input": "input and clean valid, the same pixels for every method; where the method has no "
    "depth its input's stands in",
}
#: Parts of a base set: key -> (suffix of the column name, definition).
PARTS: Final = {
    "all": ("", ""),
    "interior": ("_interior", f", more than {BAND_PX} px from an edge of the clean map"),
    "edge": ("_edge", f", at most {BAND_PX} px from an edge of the clean map"),
}
#: Statistics of the error prediction - clean over a set: key -> (direction, definition).
STATISTICS: Final[dict[str, tuple[Direction, str]]] = {
    "rmse": ("lower", "root mean square error"),
    "mae": ("lower", "mean absolute error"),
    "median": ("lower", "median absolute error"),
    "p95": ("lower", "95th percentile of the absolute error"),
    "bias": ("neither", "mean error, positive is too far"),
}


def _depth_metrics() -> list[Metric]:
    sets = [
        (f"{base}{suffix}", definition + where)
        for base, definition in SETS.items()
        for suffix, where in PARTS.values()
    ]
    sets.append(("filled", "prediction and clean valid, input not"))
    return [
        Metric(f"{name}_{key}_mm", "mm", better, "depth", f"{words} where {definition}")
        for name, definition in sets
        for key, (better, words) in STATISTICS.items()
    ]


METRICS: Final[dict[str, Metric]] = {
    metric.name: metric
    for metric in (
        Metric("mse_mm2", "mm²", "lower", "paper", "mean squared error over all pixels, holes = 0"),
        Metric(
            "psnr_db",
            "dB",
            "higher",
            "paper",
            f"10 log10({PSNR_MAX_MM:.0f}² / MSE) of the frame; undefined for MSE 0",
        ),
        Metric(
            "mse_flips_pct",
            "%",
            "neither",
            "paper",
            "share of the squared error that is in pixels valid in one of both only",
        ),
        *(
            Metric(f"ssim_{name}", "1", "higher", "paper", f"structural similarity, {preset}")
            for name, preset in PRESETS.items()
        ),
        Metric("iou", "1", "higher", "validity", "valid in both / valid in either"),
        Metric("precision", "1", "higher", "validity", "share of the predicted pixels that exist"),
        Metric("recall", "1", "higher", "validity", "share of the clean pixels that are predicted"),
        Metric("flips_px", "px", "lower", "validity", "pixels valid in one of both only"),
        Metric(
            "flying_px",
            "px",
            "lower",
            "validity",
            f"predicted more than {FLYING_MM:.0f} mm off, or where there is no surface",
        ),
        *_depth_metrics(),
        Metric("normal_mean_deg", "°", "lower", "normals", "mean angle between the normals"),
        Metric("normal_median_deg", "°", "lower", "normals", "median angle between the normals"),
        Metric(
            "normal_good_pct",
            "%",
            "higher",
            "normals",
            f"normals that are less than {NORMAL_DEG:.0f}° off",
        ),
        Metric("time_ms", "ms", "lower", "time", "the denoiser's time for the frame, one core"),
    )
}
