"""Fake scores of a reproduction of the paper, without trainings: the files of its report."""

import csv
from collections.abc import Mapping
from pathlib import Path

from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.paper.ours_beside_printed import case_folder
from glsim.eval.paper.paper_tables import PAPER_COLUMNS
from tests.support.checkpoint_stand_in import write_run


def write_table(path: Path, mse: Mapping[str, float]) -> Path:
    """Write a table.csv of glsim eval, in which all metrics but MSE are 10."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["method", "metric", "mean", "frames"])
        for name, value_mm2 in mse.items():
            for metric in PAPER_COLUMNS:
                writer.writerow([name, metric, value_mm2 if metric == "mse_mm2" else 10.0, 50])
    return path


def write_filters(root: Path, mask: str, seed: int, protocol: str, mse: dict[str, float]) -> Path:
    """Write the scores of the filters on a data set; a filter without a given MSE has 1 mm²."""
    path = root / "filters" / mask / str(seed) / protocol / "table.csv"
    return write_table(path, {name: mse.get(name, 1.0) for name in (*PAPER_FILTERS, "face")})


def write_networks(
    root: Path, mask: str, protocol: str, noisy_mm2: float, rows: Mapping[str, float], size: str
) -> Path:
    """Write the scores of trained networks (row -> MSE) of one seed, and their table."""
    place = case_folder(root, protocol, mask)
    for row in rows:
        write_run(place / "runs" / f"{row}-0", 0.1, row=row, size=size)
    mse = {f"{row}-0": value for row, value in rows.items()}
    return write_table(place / "table.csv", {"noisy": noisy_mm2, **mse})
