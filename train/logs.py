"""Logs of a run: metrics.csv, TensorBoard's events, JSON files and sample images."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from lightning_fabric.loggers.tensorboard import TensorBoardLogger
from numpy.typing import NDArray
from torch import Tensor

from glsim.core.camera import Intrinsics
from glsim.core.files.atomic import write_atomic
from glsim.core.files.png import write_picture
from glsim.data.preview import difference, shaded

METRICS_FILE: Final = "metrics.csv"
RUN_FILE: Final = "run.json"
#: Focal length for the shading of samples, px: Kinect V2's factory calibration.
_FOCAL_PX: Final = 365.0
_GAP_PX: Final = 4


class RunLogs:
    """metrics.csv and TensorBoard's events in a folder.

    A resumed run drops the rows after its checkpoint and logs them again. Each row rewrites
    metrics.csv, so that the file is whole at any moment.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        """steps: steps done at the checkpoint."""
        self._file = folder / METRICS_FILE
        logged = _csv_rows(self._file)
        self._rows = [row for row in logged if int(row["step"]) <= steps]
        if len(self._rows) < len(logged):
            self._save()
        self._board = TensorBoardLogger(
            folder, name="", version="tensorboard", purge_step=steps + 1, default_hp_metric=False
        )

    def write(self, figures: Mapping[str, float], steps: int) -> None:
        """Write a row of figures to disk."""
        self._rows.append({name: str(value) for name, value in figures.items()})
        self._rows[-1]["step"] = str(steps)
        self._save()
        self._board.log_metrics(dict(figures), steps)

    def _save(self) -> None:
        text = io.StringIO()
        writer = csv.DictWriter(text, sorted({"step"}.union(*self._rows)), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows)
        write_atomic(text.getvalue().encode(), self._file)

    def close(self) -> None:
        """Close TensorBoard's log."""
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
    """Write a picture with a row per frame: noisy, denoised and clean surface, and the error.

    Args:
        path: the PNG file.
        frames: (noisy_mm, denoised_mm, clean_mm) of each frame, (1, H, W), 0 = no depth. The error
            is denoised minus clean; blue is nearer.
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
    return np.asarray(image_mm[0].float().cpu().numpy() / np.float32(1000), np.float32)
