"""What a run leaves for people: metrics.csv, TensorBoard's events, run.json and sample images."""

from __future__ import annotations

import csv
import json
import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from lightning_fabric.loggers import CSVLogger, TensorBoardLogger
from numpy.typing import NDArray
from torch import Tensor

from glsim.camera import Intrinsics
from glsim.dataset.files import write_bytes
from glsim.preview import difference, shaded

METRICS: Final = "metrics.csv"
RUN: Final = "run.json"
#: Samples are lit as the Kinect V2 (365 px, as its factory calibration says) would see them.
_FOCAL_PX: Final = 365.0
_GAP: Final = 4


class Logs:
    """metrics.csv and TensorBoard's events in a folder; rows of later steps are dropped.

    A run that was killed has logged steps that its checkpoint does not know: they come again.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        """steps: where the training goes on."""
        kept = [row for row in _rows(folder / METRICS) if int(row["step"]) <= steps]
        with warnings.catch_warnings():  # that metrics.csv is written anew: so it shall
            warnings.filterwarnings("ignore", message="Experiment logs directory")
            self._csv = CSVLogger(folder, name="", version="")
            _ = self._csv.experiment  # made at the first use
            for row in kept:
                self._csv.log_metrics({k: v for k, v in row.items() if v}, int(row["step"]))
        self._csv.save()
        self._board = TensorBoardLogger(
            folder, name="", version="tensorboard", purge_step=steps + 1, default_hp_metric=False
        )

    def write(self, figures: Mapping[str, float], steps: int) -> None:
        """A row; on disk when this returns."""
        self._csv.log_metrics(dict(figures), steps)
        self._csv.save()
        self._board.log_metrics(dict(figures), steps)

    def close(self) -> None:
        """Nothing comes any more."""
        self._csv.finalize("success")
        self._board.finalize("success")


def _rows(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """An object for people and programs; no NaN. Raises DatasetError if the disk refuses."""
    text = json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"
    write_bytes(text.encode(), path)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(part) for key, part in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_samples(path: Path, frames: Sequence[tuple[Tensor, Tensor, Tensor]]) -> None:
    """A row a frame: noisy, denoised and clean, shaded; denoised minus clean, blue nearer.

    frames: (noisy_mm, denoised_mm, clean_mm), each (1, H, W), 0 = no depth.
    """
    rows = [_row(*(_metres(image) for image in frame)) for frame in frames]
    picture = np.vstack([np.pad(row, ((0, _GAP), (0, 0), (0, 0))) for row in rows])
    write_bytes(cv2.imencode(".png", picture)[1].tobytes(), path)


def _row(
    noisy_m: NDArray[np.float32], denoised_m: NDArray[np.float32], clean_m: NDArray[np.float32]
) -> NDArray[np.uint8]:
    height, width = clean_m.shape
    camera = Intrinsics(width, height, _FOCAL_PX, _FOCAL_PX, width / 2, height / 2)
    cells = [shaded(depth, camera) for depth in (noisy_m, denoised_m, clean_m)]
    cells.append(difference(clean_m, denoised_m))
    return np.hstack([np.pad(cell, ((0, 0), (0, _GAP), (0, 0))) for cell in cells])


def _metres(image_mm: Tensor) -> NDArray[np.float32]:
    image: NDArray[np.float32] = image_mm[0].float().cpu().numpy() / np.float32(1000)
    return image
