"""Write the logs of a training: metrics.csv, events for TensorBoard, sample images."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from lightning_fabric.loggers.tensorboard import TensorBoardLogger
from torch import Tensor

from glsim.core.camera import Intrinsics
from glsim.core.files.atomic import write_atomic
from glsim.core.files.png import write_picture
from glsim.core.files.regular import read_csv
from glsim.core.units import to_metres
from glsim.data.contact_sheet import difference, shaded

METRICS_FILE: Final = "metrics.csv"
RUN_FILE: Final = "run.json"
#: Focal length for the shading of samples, px: Kinect V2's factory calibration.
_FOCAL_PX: Final = 365.0
_GAP_PX: Final = 4


class RunLogs:
    """Writer of metrics.csv and TensorBoard events in a run folder.

    A resumed run drops the rows after its checkpoint. Each row rewrites metrics.csv atomically.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        """Open the logs; ``steps`` is the number of steps done at the checkpoint."""
        self._file = folder / METRICS_FILE
        logged: list[dict[str, str]] = read_csv(self._file) if self._file.is_file() else []
        self._rows = [row for row in logged if int(row["step"]) <= steps]
        if len(self._rows) < len(logged):
            self._save()
        self._board = TensorBoardLogger(
            folder, name="", version="tensorboard", purge_step=steps + 1, default_hp_metric=False
        )

    def write(self, figures: Mapping[str, float], steps: int) -> None:
        """Write a row of metrics to disk."""
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


def write_samples(path: Path, frames: Sequence[tuple[Tensor, Tensor, Tensor]]) -> None:
    """Write a picture with a row per frame: noisy, denoised and clean surface, and error map.

    ``frames``: (noisy_mm, denoised_mm, clean_mm) of each, (1, H, W), 0 = no depth. Blue is nearer.
    """
    rows = []
    for frame in frames:
        noisy_m, denoised_m, clean_m = (
            np.asarray(to_metres(depth_mm[0].float().cpu().numpy()), np.float32)
            for depth_mm in frame
        )
        height, width = clean_m.shape
        camera = Intrinsics(width, height, _FOCAL_PX, _FOCAL_PX, width / 2, height / 2)
        cells = [shaded(depth, camera) for depth in (noisy_m, denoised_m, clean_m)]
        cells.append(difference(clean_m, denoised_m))
        rows.append(np.hstack([np.pad(c, ((0, _GAP_PX), (0, _GAP_PX), (0, 0))) for c in cells]))
    write_picture(np.vstack(rows), path)
