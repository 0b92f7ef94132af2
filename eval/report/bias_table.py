"""The bias of methods over distance: a table, and all bins as CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from glsim.eval.metrics.prediction import FLYING_MM
from glsim.eval.report.document import Document, TextTable
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.bias import BIAS_BIN_MM, ENOUGH_PIXELS, largest_bias
from glsim.eval.scoring.run import write_csv

BIAS_TITLE: Final = "Bias over distance [mm]"
BIAS_NOTE: Final = (
    f"Mean of prediction - truth per {BIAS_BIN_MM} mm of the truth's depth, over interior pixels "
    f"where method and input have depth, without errors beyond {FLYING_MM:.0f} mm. Columns: lower "
    f"edge of the bin, m; bins of fewer than {ENOUGH_PIXELS} pixels are left out "
    "(bias_by_distance.csv has all, with intervals)."
)


def bias_document(summary: ScoreSummary) -> Document | None:
    """Return the table of the bias of each method by distance; None without large enough bins."""
    by_method = {
        method: {b.from_mm: b for b in summary.bias_by_distance(method) if b.is_enough}
        for method in summary.methods
    }
    edges = sorted({edge for bins in by_method.values() for edge in bins})
    if not edges:
        return None
    head = ["method", "largest ↓", *(f"{edge / 1000:.1f}" for edge in edges)]
    largest = {method: largest_bias(bins.values()) for method, bins in by_method.items()}
    sizes = {m: f"{abs(one.mean_mm):.2f}" for m, one in largest.items() if one is not None}
    best = min(sizes.values(), key=float)
    rows = []
    for method, bins in by_method.items():
        size = sizes.get(method, "n/a")
        means = [f"{bins[edge].mean_mm:+.2f}" if edge in bins else "n/a" for edge in edges]
        rows.append([f"`{method}`", f"**{size}**" if size == best else size, *means])
    return Document(BIAS_TITLE, [BIAS_NOTE, TextTable(head, rows)])


def write_bias_csv(path: Path, summary: ScoreSummary) -> None:
    """Write bias_by_distance.csv: one line per method and bin of distance."""
    fields = ("method", "from_mm", "to_mm", "bias_mm", "low_95", "high_95", "pixels", "subjects")
    rows = (
        dict(
            zip(
                fields,
                (
                    method, b.from_mm, b.from_mm + BIAS_BIN_MM, b.mean_mm, b.low_mm, b.high_mm,
                    b.pixels, b.subjects,
                ),
                strict=True,
            )
        )
        for method in summary.methods
        for b in summary.bias_by_distance(method)
    )  # fmt: skip
    write_csv(path, fields, rows)
