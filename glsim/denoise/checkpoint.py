"""Checkpoints: plain dictionaries of tensors, numbers and strings, read without running any code.

    best.pt   recipe, model, data, progress and validation at the best validation
    last.pt   the same, and the state to resume from: optimiser, average, rng, scaler

Writing is atomic (a temporary file is renamed): a file is complete, or still the previous one.
"""

from __future__ import annotations

import io
import pickle
import warnings
from pathlib import Path
from typing import Any, Final

import torch

from glsim.errors import DatasetError, TrainError
from glsim.files.atomic import write_atomic

FORMAT: Final = "glsim-checkpoint"
VERSION: Final = 1
BEST: Final = "best.pt"
LAST: Final = "last.pt"
_KEYS: Final = ("recipe", "model", "data", "progress", "validation")


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


def load(path: Path) -> dict[str, Any]:
    """Read a checkpoint to CPU memory. Raises TrainError for a foreign or truncated file."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise TrainError(f"{path}: no such checkpoint") from None
    except OSError as error:
        raise TrainError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about pickles not of torch, refused below
            content = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, ValueError, KeyError, pickle.UnpicklingError):
        raise TrainError(
            f"{path}: is cut short, or is no checkpoint of glsim train (code in a file is not run)"
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise TrainError(f"{path}: is no checkpoint of glsim train: train one, or name another")
    if content.get("version") != VERSION:
        raise TrainError(
            f"{path}: is a checkpoint of version {content.get('version')}, this glsim reads "
            f"{VERSION}: use the glsim that wrote it, or train again"
        )
    for key in _KEYS:
        if key not in content:
            raise TrainError(f"{path}: is damaged: has no {key!r}: name another checkpoint")
    return content
