"""Logs of a run: metrics.csv, TensorBoard's events, JSON files and sample images."""

from __future__ import annotations

import csv
import json
import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from lightning_fabric.loggers import CSVLogger, TensorBoardLogger
from numpy.typing import NDArray
from torch import Tensor

from glsim.files.atomic import write_atomic
from glsim.files.png import write_picture
from glsim.geometry.camera import Intrinsics
from glsim.preview import difference, shaded

METRICS_FILE: Final = "metrics.csv"
RUN_FILE: Final = "run.json"
#: Focal length for the shading of samples, px: Kinect V2's factory calibration.
_FOCAL_PX: Final = 365.0
_GAP_PX: Final = 4


class RunLogs:
    """metrics.csv and TensorBoard's events in a folder.

    Rows that a killed run logged after its checkpoint are dropped: the resumed run logs them again.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        """steps: steps done at the checkpoint."""
        kept = [row for row in _csv_rows(folder / METRICS_FILE) if int(row["step"]) <= steps]
        with warnings.catch_warnings():  # metrics.csv is overwritten on purpose
            warnings.filterwarnings("ignore", message="Experiment logs directory")
            self._csv = CSVLogger(folder, name="", version="")
            _ = self._csv.experiment  # created by its first use
            for row in kept:
                self._csv.log_metrics({k: v for k, v in row.items() if v}, int(row["step"]))
        self._csv.save()
        self._board = TensorBoardLogger(
            folder, name="", version="tensorboard", purge_step=steps + 1, default_hp_metric=False
        )

    def write(self, figures: Mapping[str, float], steps: int) -> None:
        """Write a row of figures to disk."""
        self._csv.log_metrics(dict(figures), steps)
        self._csv.save()
        self._board.log_metrics(dict(figures), steps)

    def close(self) -> None:
        """Close both logs."""
        self._csv.finalize("success")
        self._board.finalize("success")


def _csv_rows(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object, with null for NaN. Raises DatasetError if writing fails."""
    text = json.dumps(_without_nan(content), indent=1, allow_nan=False) + "\n"
    write_atomic(text.encode(), path)


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_nan(part) for key, part in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_samples(path: Path, frames: Sequence[tuple[Tensor, Tensor, Tensor]]) -> None:
    """Write a PNG with one row per frame: noisy, denoised and clean, shaded; then their difference.

    frames: (noisy_mm, denoised_mm, clean_mm), each (1, H, W), 0 = no depth. The difference is
    denoised minus clean; blue is nearer.
    """
    rows = [_sample_row(*(_metres(image) for image in frame)) for frame in frames]
    picture = np.vstack([np.pad(row, ((0, _GAP_PX), (0, 0), (0, 0))) for row in rows])
    write_picture(picture, path)


def _sample_row(
    noisy_m: NDArray[np.float32], denoised_m: NDArray[np.float32], clean_m: NDArray[np.float32]
) -> NDArray[np.uint8]:
    height, width = clean_m.shape
    camera = Intrinsics(width, height, _FOCAL_PX, _FOCAL_PX, width / 2, height / 2)
    cells = [shaded(depth, camera) for depth in (noisy_m, denoised_m, clean_m)]
    cells.append(difference(clean_m, denoised_m))
    return np.hstack([np.pad(cell, ((0, 0), (0, _GAP_PX), (0, 0))) for cell in cells])


def _metres(image_mm: Tensor) -> NDArray[np.float32]:
    image: NDArray[np.float32] = image_mm[0].float().cpu().numpy() / np.float32(1000)
    return image
