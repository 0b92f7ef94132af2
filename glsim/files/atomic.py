"""Atomic file writing with checksums, and JSON in one fixed form.

A file is written under a temporary name and renamed, so that its own name never stands for half a
file. Files are not synced frame by frame (this would cost more than rendering): after a power cut
a renamed file may be empty. Therefore the size and CRC32 of every file are recorded, and compared
when a run is resumed. Only the few files that describe the whole data set are synced.
"""

from __future__ import annotations

import errno
import json
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np

from glsim.errors import DatasetError

#: Advice on common file system errors.
_ADVICE = {
    errno.ENOSPC: "free some space and run the same command again, it continues",
    errno.EDQUOT: "free some space and run the same command again, it continues",
    errno.EACCES: "check the permissions or choose another folder",
    errno.EPERM: "check the permissions or choose another folder",
    errno.EROFS: "the file system is read-only, choose another folder",
    errno.EMFILE: "raise the limit of open files (ulimit -n)",
}
_BLOCK_BYTES = 1 << 20


def _to_plain_value(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not a JSON value")


_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False, default=_to_plain_value).encode


def to_json(value: object, where: str) -> str:
    """Encode a value as one line of JSON; NumPy numbers and arrays become plain ones.

    where: names the value in error messages. Raises DatasetError for NaN and for other types.
    """
    try:
        return _encode(value)
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{where}: cannot be written as JSON: {error}") from None


def read_json(path: Path) -> dict[str, Any]:
    """Read a file that holds one JSON object. Raises DatasetError for anything else."""
    try:
        value = json.loads(path.read_bytes())
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: is damaged: {error}") from None
    if not isinstance(value, dict):
        raise DatasetError(f"{path}: is damaged: no JSON object")
    return value


def cannot_write(path: Path, error: OSError) -> DatasetError:
    """Return the DatasetError for a failed write: path, cause and advice in one line."""
    advice = _ADVICE.get(error.errno or 0, "what is complete is kept")
    return DatasetError(f"cannot write {path}: {error.strerror or error}: {advice}")


@contextmanager
def wrap_write_errors(path: Path) -> Iterator[None]:
    """Turn every OSError in the block into a DatasetError that names ``path``."""
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from error


@contextmanager
def wrap_read_errors(path: Path) -> Iterator[None]:
    """Turn every OSError in the block into a DatasetError about ``path``, a data-set file."""
    try:
        yield
    except FileNotFoundError:
        raise DatasetError(
            f"{path}: is missing: run glsim generate again with the same settings to restore it"
        ) from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None


class AtomicFile:
    """A file that appears under its name only when it is complete; counts its size and CRC32.

    Use it as a context manager: a normal exit renames the temporary file to ``path``, an error
    removes it. sync: flush the data to the disk before the rename.
    """

    def __init__(self, path: Path, temporary: Path, *, sync: bool = False) -> None:
        self.path = path
        self.size = 0
        self.crc32 = 0
        self._temporary = temporary
        self._sync = sync
        with wrap_write_errors(path):
            self._file: IO[bytes] = temporary.open("wb")

    def write(self, data: bytes) -> int:
        """Append bytes; return their number."""
        with wrap_write_errors(self.path):
            self._file.write(data)
        self.crc32 = zlib.crc32(data, self.crc32)
        self.size += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written so far (``tarfile`` needs it)."""
        return self.size

    @property
    def checksum(self) -> dict[str, int]:
        """The recorded form: {"size": bytes, "crc32": CRC32}."""
        return {"size": self.size, "crc32": self.crc32}

    def __enter__(self) -> AtomicFile:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        complete = False
        try:
            with wrap_write_errors(self.path):
                try:
                    if kind is None and self._sync:
                        self._file.flush()
                        os.fsync(self._file.fileno())
                finally:
                    self._file.close()
                if kind is None:
                    self._temporary.replace(self.path)
                    complete = True
        finally:
            if not complete:
                self._temporary.unlink(missing_ok=True)


def write_atomic(
    data: bytes, path: Path, *, temporary: Path | None = None, sync: bool = False
) -> dict[str, int]:
    """Write a whole file at once: it is complete or absent. Returns its size and CRC32.

    temporary: path for the unfinished file, on the same file system. By default it lies beside
    ``path``, whose folder is then created. sync: flush to the disk. Raises DatasetError.
    """
    if temporary is None:
        with wrap_write_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with AtomicFile(path, temporary, sync=sync) as file:
        file.write(data)
    return file.checksum


def checksum(data: bytes) -> dict[str, int]:
    """Return the size and CRC32 of bytes in memory."""
    return {"size": len(data), "crc32": zlib.crc32(data)}


def file_checksum(path: Path) -> dict[str, int] | None:
    """Return the size and CRC32 of a file on disk; None if it cannot be read."""
    size = crc32 = 0
    try:
        with path.open("rb") as file:
            while block := file.read(_BLOCK_BYTES):
                crc32 = zlib.crc32(block, crc32)
                size += len(block)
    except OSError:
        return None
    return {"size": size, "crc32": crc32}
