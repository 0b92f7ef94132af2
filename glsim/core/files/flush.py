"""Flush files to the disk, so that they survive a power cut.

The kernel keeps written data in memory for up to half a minute, and may write the name of a file to
the disk before its data: after a power cut a renamed file can be empty. A file that says that other
files are complete must therefore be flushed after them.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

#: Windows opens no folder: it writes the names of files itself.
_OPENS_FOLDERS = hasattr(os, "O_DIRECTORY")


def flush_folder(path: Path) -> None:
    """Flush the names in a folder to the disk. Raises OSError."""
    if not _OPENS_FOLDERS:
        return
    with _opened(path) as descriptor:
        os.fsync(descriptor)


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def flush_all(folder: Path) -> None:
    """Flush all files of the file system that holds a folder to the disk. Raises OSError."""
    # One call is cheaper than one per file: a chunk of a data set has a hundred files. Only Linux
    # has this call; on other systems all file systems are flushed.
    if not _OPENS_FOLDERS:
        return
    syncfs = _syncfs()
    if syncfs is None:
        os.sync()
        return
    with _opened(folder) as descriptor:
        if syncfs(descriptor) != 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number), str(folder))


@lru_cache(maxsize=1)
def _syncfs() -> Any:
    """Return the C library's function ``syncfs``; None if the library lacks it."""
    function = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
    if function is not None:
        function.argtypes, function.restype = [ctypes.c_int], ctypes.c_int
    return function
