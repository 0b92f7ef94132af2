"""Checkpoint files: dictionaries of tensors, numbers and strings, read without running code.

    best.pt   recipe, model, data, progress and validation at the best validation
    last.pt   the same, and the state to resume from: optimiser, average, rng, scaler

``export_safetensors`` writes the content of best.pt as a safetensors file, which ``load`` reads
too: the weights, and in its table under ``glsim`` the rest as JSON. Writing is atomic (a temporary
file is renamed): a file is complete, or still the previous one.
"""

from __future__ import annotations

import io
import json
import warnings
import zipfile
from pathlib import Path
from typing import IO, Any, Final

import torch

from glsim.core.errors import DatasetError, GlsimError, TrainError, require_package
from glsim.core.files.atomic import write_atomic
from glsim.core.files.regular import open_regular

FORMAT: Final = "glsim-checkpoint"
VERSION: Final = 1
BEST: Final = "best.pt"
LAST: Final = "last.pt"
SAFETENSORS: Final = ".safetensors"
#: Largest file, bytes: eight checkpoints of Restormer (26 million float32, their average, moments).
MAX_BYTES: Final = 1 << 32
_KEYS: Final = ("recipe", "model", "data", "progress", "validation")
_TABLE: Final = "glsim"
_FOREIGN: Final = "is damaged or cut short, or is no checkpoint of glsim train"


def save(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint. Raises TrainError if writing fails; then the previous file stays."""
    write(path, {"format": FORMAT, "version": VERSION, **content})


def write(path: Path, content: dict[str, Any]) -> None:
    """Write a dictionary of tensors, numbers and strings atomically. Raises TrainError."""
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

    Raises TrainError for a foreign or damaged checkpoint, ConfigError without safetensors.
    """
    content = load(path)
    save_tensors = _safetensors().save
    weights = {name: value.cpu().contiguous().clone() for name, value in content["model"].items()}
    rest = {name: content[name] for name in ("format", "version", *_KEYS) if name != "model"}
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(bytes(save_tensors(weights, {"format": "pt", _TABLE: json.dumps(rest)})), out)


def load(path: Path) -> dict[str, Any]:
    """Read a checkpoint or safetensors file to CPU memory.

    Code in the file is not run. Raises TrainError for a foreign or damaged file, and for weights
    that are not finite.
    """
    read = _from_safetensors if path.suffix == SAFETENSORS else _from_archive
    try:
        with open_regular(path, MAX_BYTES) as file:
            content = read(file)
    except FileNotFoundError:
        raise TrainError(f"{path}: no such checkpoint") from None
    except OSError as error:
        raise TrainError(f"{path}: cannot be read: {error.strerror or error}") from None
    except GlsimError:
        raise
    except Exception:  # PyTorch, zipfile, safetensors and JSON raise exceptions of any type
        raise TrainError(f"{path}: {_FOREIGN}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise TrainError(f"{path}: is no checkpoint of glsim train: train one, or name another")
    if content.get("version") != VERSION:
        raise TrainError(
            f"{path}: is a checkpoint of version {content.get('version')!r:.20}, this glsim reads "
            f"{VERSION}: use the glsim that wrote it, or train again"
        )
    if missing := [key for key in _KEYS if not isinstance(content.get(key), dict)]:
        raise TrainError(f"{path}: is damaged: has no {missing[0]!r}: name another checkpoint")
    _check_finite(path, content["model"])
    return content


def _check_finite(path: Path, weights: dict[str, Any]) -> None:
    for name, value in weights.items():
        if torch.is_tensor(value) and value.is_floating_point() and not value.isfinite().all():
            raise TrainError(
                f"{path}: {name!a:.80} holds NaN or infinity: the training diverged or the "
                "file is damaged: name another checkpoint"
            )


def _from_archive(file: IO[bytes]) -> Any:
    """Read an archive of ``torch.save``; check its CRC32s first, since PyTorch does not."""
    with zipfile.ZipFile(file) as archive:
        if archive.testzip() is not None:
            raise ValueError
    file.seek(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about foreign pickles, which are refused
        return torch.load(file, map_location="cpu", weights_only=True)


def _from_safetensors(file: IO[bytes]) -> Any:
    data = file.read()
    weights = _safetensors().load(data)
    # The reader has checked the header: eight bytes of length, then a JSON table. It returns the
    # header's metadata only for files that it opens itself.
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    return json.loads(header["__metadata__"][_TABLE]) | {"model": weights}


def _safetensors() -> Any:
    require_package("safetensors", f"a {SAFETENSORS} file", "train")
    import safetensors.torch

    return safetensors.torch
