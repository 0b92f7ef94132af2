"""Preparation of a run before its first step: device, folder and checkpoint to resume."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import torch
from lightning_fabric import Fabric

from glsim.core.errors import ConfigError, TrainError
from glsim.core.files.atomic import file_checksum, wrap_write_errors
from glsim.core.files.lock import locked
from glsim.denoise.registry import NETWORKS, ONNX_SUFFIX, shipped_file
from glsim.networks import checkpoint
from glsim.settings.toml_tables import parse_table
from glsim.train.recipe import Recipe, TrainingSettings
from glsim.train.state import WeightsOf

LOCK_FILE: Final = ".lock"

#: Linux's names of processor features for bfloat16: Intel and AMD (AVX-512, AMX), ARM.
_BFLOAT16: Final = {"avx512_bf16", "amx_bf16", "bf16"}
_CPU_INFO: Final = Path("/proc/cpuinfo")

log = logging.getLogger(__name__)
logging.getLogger("lightning_fabric").setLevel(logging.WARNING)  # it repeats the recipe


def computes_bfloat16() -> bool:
    """Return whether the GPU (or else the CPU) has bfloat16 instructions.

    Without them, PyTorch converts to float32 and back: on a processor with AVX2, two steps of
    ``face`` took 26.4 CPU s in bf16-mixed and 9.7 s in 32-true (measured, PyTorch 2.13).
    """
    if torch.cuda.is_available():
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    with suppress(OSError):
        return not _BFLOAT16.isdisjoint(_CPU_INFO.read_text(errors="replace").split())
    return False


def with_precision(recipe: Recipe, begun: Path | None) -> Recipe:
    """Return the recipe with a definite precision in place of "auto".

    ``begun`` is recipe.json of a resumed training, whose precision stays; None: a new training.
    """
    if recipe.training.precision != "auto":
        return recipe
    chosen = "bf16-mixed" if computes_bfloat16() else "32-true"
    with suppress(OSError, ValueError, KeyError, TypeError):  # a new training, or a damaged file
        if begun is not None:
            chosen = json.loads(begun.read_text(encoding="utf-8"))["training"]["precision"]
    training = recipe.training.model_copy(update={"precision": chosen})
    return recipe.model_copy(update={"training": training})


def arithmetic(fabric: Fabric) -> dict[str, Any]:
    """Return the facts besides recipe and data on which the rounding of a training depends.

    An example is the number of threads, since each thread adds up a part of a sum.
    """
    on_gpu = fabric.device.type == "cuda"
    return {
        "device": torch.cuda.get_device_name(fabric.device) if on_gpu else "cpu",
        "threads": torch.get_num_threads(),
        "instructions": torch.backends.cpu.get_cpu_capability(),
        "torch": str(torch.__version__),
    }


def continue_arithmetic(begun: Mapping[str, Any], fabric: Fabric, where: object) -> None:
    """Restore the number of threads of a resumed training; warn of other differences."""
    torch.set_num_threads(int(begun["threads"]))
    now = arithmetic(fabric)
    if others := [f"{n} {begun.get(n)}, not {now[n]}" for n in now if begun.get(n) != now[n]]:
        log.warning(
            "%s: was computed with %s: the weights will differ in their last bits from those of "
            "a training that was not interrupted",
            where,
            ", ".join(others),
        )


def make_fabric(settings: TrainingSettings) -> Fabric:
    """Create the Fabric of device and precision. Raises ConfigError if the machine lacks them."""
    on_gpu = torch.cuda.is_available()
    if settings.precision == "auto":
        raise ValueError("auto is no precision: see with_precision")
    if settings.precision == "16-mixed" and not on_gpu:
        raise ConfigError("training.precision = '16-mixed' needs a GPU: set bf16-mixed or 32-true")
    # 32-true excludes TF32, cuDNN's default: ten bits, steps of half a millimetre at 900 mm.
    torch.backends.cudnn.allow_tf32 = settings.precision != "32-true"
    with warnings.catch_warnings():
        # Lightning's advice to start with srun wherever that command exists.
        warnings.filterwarnings("ignore", message=".*srun")
        accelerator = "cuda" if on_gpu else "cpu"
        return Fabric(accelerator=accelerator, devices=1, precision=settings.precision)


def read_start(start: str, model: Mapping[str, Any]) -> tuple[WeightsOf, dict[str, Any]]:
    """Read initial weights from a checkpoint, an ONNX file, or a shipped network by name.

    Returns the weights, and name and CRC32 of the file, for run.json and checkpoints. Raises
    TrainError for a missing or damaged file, and for an ONNX file of another network.
    """
    path = Path(start)
    if not path.exists() and start not in NETWORKS:
        raise TrainError(
            f"{start}: no such checkpoint: give a best.pt, an ONNX file of glsim export, or the "
            f"name of a shipped network ({', '.join(NETWORKS)})"
        )
    path = path if path.exists() else shipped_file(start)
    checksum = file_checksum(path)
    crc32 = None if checksum is None else f"{checksum['crc32']:08x}"
    if path.suffix == ONNX_SUFFIX:
        from glsim.train.onnx_export import weights_of_onnx  # loads the exporter

        values = weights_of_onnx(path, model)
    else:
        values = checkpoint.load(path)["model"]
    return WeightsOf(str(path), values), {"file": start, "crc32": crc32}


@contextmanager
def locked_run(folder: Path) -> Iterator[None]:
    """Create a run's folder and hold its lock. Raises TrainError if it is locked already."""
    with wrap_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    advice = "wait until it ends, or name another folder (-o)"
    busy = TrainError(f"{folder}: another training is writing here: {advice}")
    with locked(folder / LOCK_FILE, busy):
        yield


def last_checkpoint(
    folder: Path, recipe: Recipe, fingerprint: dict[str, Any]
) -> dict[str, Any] | None:
    """Load the checkpoint to resume from; None if the folder has none yet.

    Raises TrainError if it is damaged, of another recipe (limits may differ) or of other data.
    """
    path = folder / checkpoint.LAST
    if not path.exists():
        return None
    last: dict[str, Any] = checkpoint.load(path)
    difference = parse_table(Recipe, last["recipe"], str(path)).difference(recipe)
    if difference is not None:
        raise TrainError(
            f"{path}: is of another recipe: its {difference}: give its recipe and no other "
            "values, or name another folder (-o)"
        )
    data: dict[str, Any] = last["data"]
    names = sorted(n for n in data.keys() | fingerprint if data.get(n) != fingerprint.get(n))
    if names:
        raise TrainError(
            f"{path}: was trained on other data ({', '.join(names)} differ): give that data set, "
            "or name another folder (-o)"
        )
    return last
