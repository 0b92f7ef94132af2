"""The time of a training step on this machine, measured by a few steps on synthetic maps."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import torch
from lightning_fabric import Fabric
from torch.utils.data import Subset, TensorDataset

from glsim.train.data.pairs import Batch
from glsim.train.loop import StepStatus, fit
from glsim.train.recipe import Recipe

#: Steps that are timed, after the first, which also sets up memory and kernels.
_TIMED_STEPS: Final = 2
#: Depth of the synthetic maps and its deviation, mm: a face at the paper's distance.
_DEPTH_MM: Final = (900.0, 5.0)


class _SyntheticBatches:
    """The same batch of flat maps with noise at every step; a ``BatchSource``."""

    def __init__(self, recipe: Recipe) -> None:
        self.fingerprint: dict[str, Any] = {}
        side = recipe.data.crop or 128
        generator = torch.Generator().manual_seed(0)
        clean_mm = torch.full((recipe.training.batch, 1, side, side), _DEPTH_MM[0])
        noisy_mm = clean_mm + _DEPTH_MM[1] * torch.randn(clean_mm.shape, generator=generator)
        self._batch = (noisy_mm, clean_mm)
        pairs: Any = TensorDataset(noisy_mm, clean_mm)
        self.validation: Subset[Batch] = Subset(pairs, [0])

    def prepare(self, fabric: Fabric) -> int:
        """Move the batch to the device; return the number of batches per epoch."""
        noisy_mm, clean_mm = (fabric.to_device(part) for part in self._batch)
        self._batch = (noisy_mm, clean_mm)
        return 2 + _TIMED_STEPS

    def batches(self, epoch: int, skip: int) -> Iterator[Batch]:
        """Yield the batches of an epoch without the first ``skip``."""
        for _ in range(skip, 2 + _TIMED_STEPS):
            yield self._batch


def device_name() -> str:
    """Return the name of the device that trains here."""
    return torch.cuda.get_device_name() if torch.cuda.is_available() else "the processor"


def seconds_per_step(recipe: Recipe) -> float:
    """Measure the median time of a step of a recipe, without reading data and validation, s.

    Args:
        recipe: of a network with one noisy map as input; its limits are replaced.

    Raises:
        ConfigError, TrainError: as ``glsim.train.loop.fit`` does.
    """
    limits = {
        **{"max_steps": 2 + _TIMED_STEPS, "max_epochs": None, "max_minutes": None},
        **{"patience": None, "validate_every": 2 + _TIMED_STEPS, "validate_unit": "steps"},
    }
    measured = recipe.model_copy(update={"training": recipe.training.model_copy(update=limits)})
    ends: list[float] = []

    def on_step(status: StepStatus) -> None:
        if status.validation is None:  # the last step ends with a validation
            ends.append(time.monotonic())

    source = _SyntheticBatches(measured)
    with TemporaryDirectory() as folder:
        fit(measured, source, Path(folder) / "run", on_step=on_step)
    return statistics.median(after - before for before, after in pairwise(ends))
