"""Writing files so that a name never stands for half a file, and JSON in one fixed form.

A file is written under a temporary name and renamed. Nothing is synced frame by frame (it would
cost more than rendering): after a power cut a renamed file may be empty, which is why every file's
size and CRC32 are recorded, and compared when a run is resumed. Only the few files that describe
the whole data set are synced.
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

#: What to do about the errors of a file system that people meet.
_ADVICE = {
    errno.ENOSPC: "free some space and run the same command again, it continues",
    errno.EDQUOT: "free some space and run the same command again, it continues",
    errno.EACCES: "check the permissions or choose another folder",
    errno.EPERM: "check the permissions or choose another folder",
    errno.EROFS: "the file system is read-only, choose another folder",
    errno.EMFILE: "raise the limit of open files (ulimit -n)",
}
_BLOCK = 1 << 20


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not a JSON value")


_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False, default=_plain).encode


def to_json(value: object, where: str) -> str:
    """One line of JSON; NumPy numbers become plain ones. DatasetError for NaN and other types."""
    try:
        return _encode(value)
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{where}: cannot be written as JSON: {error}") from None


def read_json(path: Path) -> dict[str, Any]:
    """A file that holds one JSON object. DatasetError if it does not."""
    try:
        value = json.loads(path.read_bytes())
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise DatasetError(f"{path}: is damaged: {error}") from None
    if not isinstance(value, dict):
        raise DatasetError(f"{path}: is damaged: no JSON object")
    return value


def cannot_write(path: Path, error: OSError) -> DatasetError:
    """The one line for an operating system's refusal."""
    advice = _ADVICE.get(error.errno or 0, "what is complete is kept")
    return DatasetError(f"cannot write {path}: {error.strerror or error}: {advice}")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turns every OSError within into a DatasetError about ``path``."""
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from error


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turns every OSError within into a DatasetError about ``path``, a file of a data set."""
    try:
        yield
    except FileNotFoundError:
        raise DatasetError(
            f"{path}: is missing: run glsim generate again with the same settings to restore it"
        ) from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None


class CheckedFile:
    """A file that appears under its name when it is complete; knows its size and CRC32.

    Use as a context manager: leaving it normally renames it into place, by an error removes it.
    sync: force it to the disk before the rename.
    """

    def __init__(self, path: Path, temporary: Path, *, sync: bool = False) -> None:
        self.path = path
        self.size = 0
        self.crc32 = 0
        self._temporary = temporary
        self._sync = sync
        with writing(path):
            self._file: IO[bytes] = temporary.open("wb")

    def write(self, data: bytes) -> int:
        """Appends, and returns the number of bytes."""
        with writing(self.path):
            self._file.write(data)
        self.crc32 = zlib.crc32(data, self.crc32)
        self.size += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes so far (``tarfile`` asks)."""
        return self.size

    @property
    def check(self) -> dict[str, int]:
        """Size in bytes and CRC32 as they are recorded."""
        return {"size": self.size, "crc32": self.crc32}

    def __enter__(self) -> CheckedFile:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        complete = False
        try:
            with writing(self.path):
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


def write_file(path: Path, data: bytes, temporary: Path, *, sync: bool = False) -> dict[str, int]:
    """The whole of a file at once, complete or not at all. Returns its size and CRC32."""
    with CheckedFile(path, temporary, sync=sync) as file:
        file.write(data)
    return file.check


def write_bytes(data: bytes, path: Path) -> None:
    """A file of its own, outside a data set; its folder is made. Raises DatasetError."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, data, path.with_name(f".{path.name}.{os.getpid()}"))


def check_bytes(data: bytes) -> dict[str, int]:
    """Size and CRC32 of bytes in memory."""
    return {"size": len(data), "crc32": zlib.crc32(data)}


def check_of(path: Path) -> dict[str, int] | None:
    """Size and CRC32 of what is on disk; None if there is nothing that can be read."""
    size = crc32 = 0
    try:
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                crc32 = zlib.crc32(block, crc32)
                size += len(block)
    except OSError:
        return None
    return {"size": size, "crc32": crc32}
