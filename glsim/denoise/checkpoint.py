"""Checkpoints: plain dictionaries of tensors, numbers and strings, read without running any code.

    best.pt   recipe, model, data, progress and validation at the best validation
    last.pt   the same, and the state to resume from: optimiser, average, rng, scaler

``export_safetensors`` writes the content of best.pt as a safetensors file, which ``load`` reads
too. Writing is atomic (a temporary file is renamed): a file is complete, or still the previous one.
"""

from __future__ import annotations

import io
import os
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Final

import torch

from glsim.denoise.safetensors_file import SUFFIX, read_safetensors, safetensors_bytes
from glsim.errors import DatasetError, TrainError
from glsim.files.atomic import write_atomic
from glsim.files.regular import open_regular

FORMAT: Final = "glsim-checkpoint"
VERSION: Final = 1
BEST: Final = "best.pt"
LAST: Final = "last.pt"
#: Largest file, bytes: eight times Restormer (26 million weights) with Adam's two moments, an
#: average and the weights themselves in float32.
MAX_BYTES: Final = 1 << 32
#: Largest tensor in a file, bytes: all 250 million weights of the largest network in one, float32.
_MAX_TENSOR_BYTES: Final = 4 * 250_000_000
#: Largest list of an archive's members, and largest of its members that are no tensors, bytes: 16
#: times those of Restormer's last.pt. Each byte of them may take 50 in memory.
_MAX_LIST_BYTES: Final = 1 << 22
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
    file by its name. Sizes that a file states are checked before more than its list of tensors is
    read. Tensors of weights are finite and no larger than their file.
    """
    read = _from_safetensors if path.suffix == SUFFIX else _from_archive
    try:
        with open_regular(path, MAX_BYTES) as file:
            size = os.fstat(file.fileno()).st_size
            content = read(path, file, size)
    except FileNotFoundError:
        raise TrainError(f"{path}: no such checkpoint") from None
    except OSError as error:
        raise TrainError(f"{path}: cannot be read: {error.strerror or error}") from None
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
        _check_weights(path, content.get(key) or {}, size)
    return content


class _BoundedReads(io.RawIOBase):
    """A file whose single reads are bounded: ``zipfile`` reads the list of members in one."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def read(self, size: int = -1) -> bytes:
        """Read as the file does. Raises ValueError for _MAX_LIST_BYTES at once, or more."""
        data = self._file.read(min(size, _MAX_LIST_BYTES) if size >= 0 else _MAX_LIST_BYTES)
        if len(data) == _MAX_LIST_BYTES:
            raise ValueError("a list of members that is too long")
        return data

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Seek as the file does."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the place as the file does."""
        return self._file.tell()

    def seekable(self) -> bool:
        """Return that the file can seek: it is a regular one."""
        return True


def _from_safetensors(path: Path, file: IO[bytes], size: int) -> Any:
    """Read a safetensors file, of which ``glsim export`` writes the weights alone."""
    start = file.read(8)
    if size > _MAX_TENSOR_BYTES + _MAX_LIST_BYTES or not (
        0 < int.from_bytes(start, "little") <= _MAX_LIST_BYTES
    ):
        raise TrainError(f"{path}: is cut short, damaged, or no safetensors file")
    return read_safetensors(path, start + file.read(size))


def _from_archive(path: Path, file: IO[bytes], size: int) -> Any:
    """Read the archive that ``torch.save`` wrote. Raises TrainError if it is no sound one."""
    _check_archive(path, file, size)
    file.seek(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about pickles not of torch, refused below
            return torch.load(file, map_location="cpu", weights_only=True)
    except Exception:  # PyTorch's reader raises exceptions of any type
        raise TrainError(f"{path}: {_FOREIGN}") from None


def _check_archive(path: Path, file: IO[bytes], size: int) -> None:
    """Raise TrainError for a file that is no zip archive, or a damaged or compressed one."""
    try:
        with zipfile.ZipFile(_BoundedReads(file)) as archive:
            _check_members(path, archive.infolist(), size)
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


def _check_members(path: Path, members: Sequence[zipfile.ZipInfo], size: int) -> None:
    """Raise TrainError for members that are larger than any network's, before one is read."""
    if any(member.compress_type != zipfile.ZIP_STORED for member in members):
        raise TrainError(f"{path}: is compressed, which no checkpoint of glsim train is")
    if sum(member.file_size for member in members) > size:
        raise TrainError(f"{path}: {_FOREIGN}")
    for member in members:
        tensor = "/data/" in member.filename
        limit = _MAX_TENSOR_BYTES if tensor else _MAX_LIST_BYTES
        if member.file_size > limit:
            raise TrainError(
                f"{path}: {member.filename!a:.80} has {member.file_size / 1e6:.0f} MB, more than "
                f"the {limit / 1e6:.0f} of any network of glsim train: name another checkpoint"
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
