"""Checkpoints: plain dictionaries of tensors, numbers and strings, read without running any code.

    best.pt   recipe, model, data, progress and validation at the best validation
    last.pt   the same, and the state to resume from: optimiser, average, rng, scaler

``export_safetensors`` writes the content of best.pt as a safetensors file, which ``load`` reads
too. Writing is atomic (a temporary file is renamed): a file is complete, or still the previous one.
"""

from __future__ import annotations

import io
import warnings
import zipfile
from pathlib import Path
from typing import Any, Final

import torch

from glsim.denoise.safetensors_file import SUFFIX, read_safetensors, safetensors_bytes
from glsim.errors import DatasetError, TrainError
from glsim.files.atomic import write_atomic
from glsim.files.regular import read_regular

FORMAT: Final = "glsim-checkpoint"
VERSION: Final = 1
BEST: Final = "best.pt"
LAST: Final = "last.pt"
#: Largest file, bytes: eight times Restormer (26 million weights) with Adam's two moments, an
#: average and the weights themselves in float32.
MAX_BYTES: Final = 1 << 32
_KEYS: Final = ("recipe", "model", "data", "progress", "validation")
_FOREIGN: Final = "is cut short, or is no checkpoint of glsim train (code in a file is not run)"


def save(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint. Raises TrainError if writing fails; the previous file then remains."""
    write(path, {"format": FORMAT, "version": VERSION, **content})


def write(path: Path, content: dict[str, Any]) -> None:
    """Write any dictionary of tensors, numbers and strings atomically. Raises as ``save``."""
    buffer = io.BytesIO()
    torch.save(content, buffer)
    try:
        write_atomic(buffer.getvalue(), path)
    except DatasetError as error:
        kept = "the one before it is whole" if path.is_file() else "there is none before it"
        reason = getattr(error.__cause__, "strerror", None) or error
        raise TrainError(
            f"cannot write {path}: {reason}: {kept}: make room, then go on with --resume"
        ) from error


def export_safetensors(path: Path, out: Path) -> None:
    """Write the weights and the recipe of a checkpoint (best.pt, last.pt) as a safetensors file.

    Raises TrainError for a foreign or damaged checkpoint.
    """
    content = load(path)
    kept = {name: content[name] for name in ("format", "version", *_KEYS)}
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(safetensors_bytes(kept), out)


def load(path: Path) -> dict[str, Any]:
    """Read a checkpoint to CPU memory. Raises TrainError for a foreign or damaged file.

    The file is a zip archive of tensors, uncompressed, so that it cannot be larger in memory than
    on the disk; every CRC32 in it is compared, since PyTorch compares none. Or it is a safetensors
    file by its name. Tensors of weights are finite and no larger than their file.
    """
    try:
        data = read_regular(path, MAX_BYTES)
    except FileNotFoundError:
        raise TrainError(f"{path}: no such checkpoint") from None
    except OSError as error:
        raise TrainError(f"{path}: cannot be read: {error.strerror or error}") from None
    read = read_safetensors if path.suffix == SUFFIX else _from_archive
    content = read(path, data)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise TrainError(f"{path}: is no checkpoint of glsim train: train one, or name another")
    if content.get("version") != VERSION:
        raise TrainError(
            f"{path}: is a checkpoint of version {content.get('version')!r:.20}, this glsim reads "
            f"{VERSION}: use the glsim that wrote it, or train again"
        )
    for key in _KEYS:
        if not isinstance(content.get(key), dict):
            raise TrainError(f"{path}: is damaged: has no {key!r}: name another checkpoint")
    for key in ("model", "average"):
        _check_weights(path, content.get(key) or {}, len(data))
    return content


def _from_archive(path: Path, data: bytes) -> Any:
    """Read the archive that ``torch.save`` wrote. Raises TrainError if it is no sound one."""
    _check_archive(path, data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about pickles not of torch, refused below
            return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception:  # PyTorch's reader raises exceptions of any type
        raise TrainError(f"{path}: {_FOREIGN}") from None


def _check_archive(path: Path, data: bytes) -> None:
    """Raise TrainError for a file that is no zip archive, or a damaged or compressed one."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if any(info.compress_type != zipfile.ZIP_STORED for info in archive.infolist()):
                raise TrainError(f"{path}: is compressed, which no checkpoint of glsim train is")
            if sum(info.file_size for info in archive.infolist()) > len(data):
                raise TrainError(f"{path}: {_FOREIGN}")
            broken = archive.testzip()
    except TrainError:
        raise
    except Exception:  # zipfile raises exceptions of several types
        raise TrainError(f"{path}: {_FOREIGN}") from None
    if broken is not None:
        raise TrainError(
            f"{path}: is damaged: the CRC32 of {broken!a:.80} differs: copy it again, or "
            "name another checkpoint"
        )


def _check_weights(path: Path, weights: Any, file_bytes: int) -> None:
    """Raise TrainError for weights that are no finite tensors, or larger than their file."""
    if not isinstance(weights, dict):
        raise TrainError(f"{path}: is damaged: its weights are no table of tensors")
    for name, value in weights.items():
        if not isinstance(value, torch.Tensor):
            continue  # an average holds further values
        if value.numel() > file_bytes or value.layout != torch.strided:  # one value, repeated
            raise TrainError(f"{path}: is damaged: {name!a:.80} is larger than the file")
        if value.is_floating_point() and not bool(value.isfinite().all()):
            raise TrainError(
                f"{path}: {name!a:.80} holds NaN or infinity: the training diverged or the "
                "file is damaged: name another checkpoint"
            )
