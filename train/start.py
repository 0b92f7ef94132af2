"""What is settled before the first step: devices, and whether a folder may be trained in."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any, Final

import torch
from lightning_fabric import Fabric
from lightning_fabric.utilities.exceptions import MisconfigurationException

from glsim.errors import ConfigError, TrainError
from glsim.toml import validate
from glsim.train import checkpoint
from glsim.train.recipe import Recipe, TrainingSettings

RECIPE: Final = "recipe.json"

logging.getLogger("lightning_fabric").setLevel(logging.WARNING)  # what the recipe says anyway


def make_fabric(settings: TrainingSettings) -> Fabric:
    """Devices and precision. Raises ConfigError for what this machine cannot do."""
    on_gpu = torch.cuda.is_available()
    if settings.precision == "16-mixed" and not on_gpu:
        raise ConfigError("training.precision = '16-mixed' needs a GPU: set bf16-mixed or 32-true")
    # 32-true means it: TF32, cuDNN's default, has ten bits, steps of half a millimetre at 900 mm.
    torch.backends.cudnn.allow_tf32 = settings.precision != "32-true"
    try:
        return Fabric(
            accelerator="cuda" if on_gpu else "cpu",
            devices=settings.devices if on_gpu else 1,
            precision=settings.precision,
        )
    except MisconfigurationException as error:
        raise ConfigError(f"training.devices = {settings.devices}: {error}") from None


def check_unused(folder: Path) -> None:
    """Raises TrainError if a training has been started in the folder."""
    if (folder / RECIPE).exists():
        raise TrainError(
            f"{folder}: holds a training: go on with --resume, or name another folder (-o)"
        )


def last_checkpoint(
    folder: Path, recipe: Recipe, fingerprint: dict[str, Any]
) -> dict[str, Any] | None:
    """Where a training goes on; None if the folder has no checkpoint yet.

    Raises TrainError if it is damaged, or of another recipe (its limits may differ) or other data.
    """
    path = folder / checkpoint.LAST
    if not path.exists():
        return None
    last: dict[str, Any] = checkpoint.load(path)
    difference = validate(Recipe, last["recipe"], str(path)).difference(recipe)
    if difference is not None:
        raise TrainError(
            f"{path}: is of another recipe: its {difference}: go on with that one, or name another "
            "folder (-o)"
        )
    data: dict[str, Any] = last["data"]
    names = sorted(n for n in data.keys() | fingerprint if data.get(n) != fingerprint.get(n))
    if names:
        raise TrainError(
            f"{path}: was trained on other data ({', '.join(names)} differ): give the data set "
            "that it was trained on, or name another folder (-o)"
        )
    return last
