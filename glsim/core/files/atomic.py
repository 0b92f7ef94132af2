"""Atomic file writing with checksums, and JSON in a fixed form.

A file is written under a temporary name and then renamed: a file with its final name is complete.
Data and name are flushed to the disk, unless ``sync`` is false: the images of a data set are
flushed together, once per chunk (``glsim.core.files.flush``). The size and CRC32 of every file are
recorded, and compared when a run is resumed.
"""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from isal import isal_zlib

from glsim.core.errors import DatasetError
from glsim.core.files.flush import flush_all, flush_folder
from glsim.core.files.regular import MOST_HELD, open_regular, read_regular

#: Advice on common file system errors.
_ADVICE = {
    errno.ENOSPC: "free some space and run the same command again, it continues",
    errno.EDQUOT: "free some space and run the same command again, it continues",
    errno.EACCES: "check the permissions or choose another folder",
    errno.EPERM: "check the permissions or choose another folder",
    errno.EROFS: "the file system is read-only, choose another folder",
    errno.EMFILE: "raise the limit of open files (ulimit -n)",
    errno.ENOTDIR: "a file stands in its path: choose another folder",
    errno.ENOENT: "no file can be made there: choose another folder",
    errno.ENAMETOOLONG: "choose a shorter name",
}
_BLOCK_BYTES = 1 << 20
#: Largest number of objects, lists and their entries in JSON, which take up to 64 bytes each.
_MOST_ENTRIES = 1 << 20

#: Names of temporary files beside their target, and of folders: PREFIX + random digits + SUFFIX.
_PREFIX, _SUFFIX = ".glsim-", ".tmp"
#: A temporary file or folder of this age, seconds, is removed: no file takes a day to write.
_STALE_S = 86_400.0


def _to_plain_value(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not a JSON value")


_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False, default=_to_plain_value).encode


def to_json(value: object, where: str) -> str:
    """Encode a value, NumPy types included, as a line of JSON. Raises DatasetError for NaN."""
    try:
        return _encode(value)
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{where}: cannot be written as JSON: {error}") from None


def parse_json(data: bytes, where: object) -> dict[str, Any]:
    """Parse a JSON object. Raises DatasetError, with ``where`` in front, for other bytes."""
    if sum(map(data.count, (b"{", b"[", b","))) > _MOST_ENTRIES:
        raise DatasetError(f"{where}: is damaged: more than {_MOST_ENTRIES} entries")
    try:
        value = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{where}: is damaged: {error}") from None
    if not isinstance(value, dict):
        raise DatasetError(f"{where}: is damaged: no JSON object")
    return value


def without_nan(value: Any) -> Any:
    """Replace NaN and infinity by None in JSON values; tuples become lists."""
    if isinstance(value, dict):
        return {str(key): without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def json_text(content: object) -> bytes:
    """Encode a JSON value for people, NaN as null; other values raise TypeError."""
    return (json.dumps(without_nan(content), indent=1, allow_nan=False) + "\n").encode()


def read_json(path: Path) -> dict[str, Any]:
    """Read a file of up to 67 MB with one JSON object. Raises DatasetError for other files."""
    try:
        return parse_json(read_regular(path, MOST_HELD), path)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None


def cannot_write(path: Path, error: OSError) -> DatasetError:
    """Make the DatasetError of a failed write: path, cause and advice in one line."""
    advice = _ADVICE.get(error.errno or 0, "what is complete is kept")
    return DatasetError(f"cannot write {path}: {error.strerror or error}: {advice}")


def check_can_write(file: Path) -> None:
    """Raise DatasetError before the work if a file cannot be written; its folder may not exist."""
    if _is_device(file):
        return
    with wrap_write_errors(file):
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        folder = next(parent for parent in file.absolute().parents if os.path.lexists(parent))
        if not folder.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        if not os.access(
            folder, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids
        ):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


@contextmanager
def wrap_write_errors(path: Path) -> Iterator[None]:
    """Turn each OSError in the block into a DatasetError that names ``path``."""
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from error


@contextmanager
def wrap_read_errors(path: Path) -> Iterator[None]:
    """Turn each OSError in the block into a DatasetError about the data-set file ``path``."""
    try:
        yield
    except FileNotFoundError:
        raise missing(path) from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None


def missing(where: object) -> DatasetError:
    """Make the error of a missing file of a data set."""
    return DatasetError(
        f"{where}: is missing: run glsim generate again with the same settings to restore it"
    )


class AtomicFile:
    """A file that gets its name only when it is complete; it counts its size and CRC32.

    Use it as a context manager: a normal exit renames the file to ``path``, an error removes it. A
    device, such as /dev/stdout, is written directly.

    Args:
        temporary: path of the unfinished file, on the same file system; it must not exist. By
            default a random name beside ``path``: the folder is created, and temporary files that
            killed processes left there are removed.
        sync: whether data and name are flushed to the disk, which takes a few milliseconds.
    """

    def __init__(self, path: Path, temporary: Path | None = None, *, sync: bool = True) -> None:
        self.path = path
        self.size = 0
        self.crc32 = 0
        self._sync = sync
        self._temporary: Path | None = None
        with wrap_write_errors(path):
            if _is_device(path):
                self._file: IO[bytes] = path.open("wb")
                return
            if temporary is None:
                if not path.parent.is_dir():
                    path.parent.mkdir(parents=True, exist_ok=True)
                    flush_folder(path.parent.parent)
                _remove_stale(path.parent)
                temporary = path.with_name(_temporary_name())
            self._file = _create(temporary)
            self._temporary = temporary

    def write(self, data: bytes) -> int:
        """Append bytes, and return their number."""
        with wrap_write_errors(self.path):
            self._file.write(data)
        self.crc32 = isal_zlib.crc32(data, self.crc32)
        self.size += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written so far (``tarfile`` needs it)."""
        return self.size

    @property
    def checksum(self) -> dict[str, int]:
        """The size and CRC32 of the written bytes: {"size": bytes, "crc32": CRC32}."""
        return {"size": self.size, "crc32": self.crc32}

    def __enter__(self) -> AtomicFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        complete = False
        try:
            with wrap_write_errors(self.path):
                try:
                    if kind is None and self._sync and self._temporary is not None:
                        self._file.flush()
                        os.fsync(self._file.fileno())
                finally:
                    self._file.close()
                if kind is None and self._temporary is not None:
                    self._temporary.replace(self.path)
                    complete = True
                    if self._sync:
                        flush_folder(self.path.parent)
        finally:
            if not complete and self._temporary is not None:
                self._temporary.unlink(missing_ok=True)


def write_atomic(data: bytes, path: Path, *, sync: bool = True) -> dict[str, int]:
    """Write a complete file or none; return its size and CRC32. Raises DatasetError."""
    with AtomicFile(path, sync=sync) as file:
        file.write(data)
    return file.checksum


def flush_outputs(folder: Path) -> None:
    """Flush to disk all files of a folder that were written with ``sync=False``."""
    if folder.is_dir():
        with wrap_write_errors(folder):
            flush_all(folder)


def _is_device(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _create(temporary: Path) -> IO[bytes]:
    return temporary.open("xb")


def _temporary_name() -> str:
    return f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}"


@contextmanager
def temporary_folder(inside: Path | None = None) -> Iterator[Path]:
    """Make a temporary folder for a block, by default in the system's; delete it afterwards.

    Temporary folders of killed processes beside it are removed. Raises DatasetError on failure.
    """
    with wrap_write_errors(inside or Path(os.environ.get("TMPDIR", "/tmp"))):
        parent = Path(tempfile.gettempdir()) if inside is None else inside
        _remove_stale(parent)
        folder = parent / _temporary_name()
        folder.mkdir(mode=0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@lru_cache(maxsize=4096)
def _remove_stale(folder: Path) -> None:
    """Remove, once per process, the user's temporary files that killed processes left."""
    for path in folder.glob(f"{_PREFIX}*{_SUFFIX}"):
        with suppress(OSError):  # deleted meanwhile, or another user's
            status = path.lstat()
            ours = getattr(os, "geteuid", lambda: 0)()  # on Windows all files have owner 0
            if time.time() - status.st_mtime < _STALE_S or status.st_uid != ours:
                continue
            if stat.S_ISDIR(status.st_mode):
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()


def checksum(data: bytes) -> dict[str, int]:
    """Compute the size and CRC32 of bytes in memory."""
    return {"size": len(data), "crc32": isal_zlib.crc32(data)}


def file_checksum(path: Path) -> dict[str, int] | None:
    """Compute the size and CRC32 of a regular file; None if it cannot be read."""
    size = crc32 = 0
    try:
        with open_regular(path) as file:
            while block := file.read(_BLOCK_BYTES):
                crc32 = isal_zlib.crc32(block, crc32)
                size += len(block)
    except OSError:
        return None
    return {"size": size, "crc32": crc32}
