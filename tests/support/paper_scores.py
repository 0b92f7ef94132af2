"""Fake scores of a reproduction of the paper, without trainings: the files of its report."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.metrics.scored_map import psnr_db
from glsim.eval.paper.ours_beside_printed import JUDGED, case_folder
from glsim.eval.paper.paper_tables import PAPER_COLUMNS
from tests.support.checkpoint_stand_in import write_run


def write_table(path: Path, mse: Mapping[str, float]) -> Path:
    """Write a table.csv of glsim eval with the PSNR of the MSE, and an SSIM that falls with it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["method", "metric", "mean", "frames"])
        for name, value_mm2 in mse.items():
            for metric in PAPER_COLUMNS:
                scores = value_mm2, psnr_db(value_mm2), 1 - value_mm2 / 1e6
                writer.writerow([name, metric, scores[[*PAPER_COLUMNS].index(metric)], 50])
    return path


def write_filters(root: Path, mask: str, seed: int, protocol: str, mse: dict[str, float]) -> Path:
    """Write the scores of the filters on a data set; a filter without a given MSE has 1 mm²."""
    path = root / "filters" / mask / str(seed) / protocol / "table.csv"
    return write_table(path, {name: mse.get(name, 1.0) for name in (*PAPER_FILTERS, "face")})


def write_networks(
    root: Path, noisy_mm2: float, rows: Mapping[str, Sequence[float]], ended: str = "patience"
) -> Path:
    """Write the scores of trained networks of the judged case (row -> MSE of each seed)."""
    place, mse = case_folder(root, *JUDGED), {"noisy": noisy_mm2}
    for row, values in rows.items():
        for seed, value_mm2 in enumerate(values):
            write_run(place / "runs" / f"{row}-{seed}", 0.1, row=row, seed=seed, ended=ended)
            mse[f"{row}-{seed}"] = value_mm2
    return write_table(place / "table.csv", mse)
