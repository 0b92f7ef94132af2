"""Flush files to the disk, so that a power cut cannot take them back.

The kernel keeps what a program writes in memory for up to half a minute, and writes the names of
files to the disk before their data: after a cut, a renamed file can be there and be empty. What
says that other files are complete must therefore reach the disk after them.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any


def flush_file(path: Path) -> None:
    """Flush the data of a file, or the names in a folder. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def flush_files(files: Iterable[Path], below: Path) -> None:
    """Flush files and their names, up to the folder ``below`` that holds them all, and its own.

    One ``syncfs`` flushes the whole file system where the C library has it (Linux); elsewhere
    every file and folder is flushed. Raises OSError.
    """
    syncfs = _syncfs()
    if syncfs is not None:
        descriptor = os.open(below, os.O_RDONLY | os.O_CLOEXEC)
        try:
            if syncfs(descriptor) != 0:
                number = ctypes.get_errno()
                raise OSError(number, os.strerror(number), str(below))
        finally:
            os.close(descriptor)
        return
    folders = {below.parent, below}
    for path in files:
        flush_file(path)
        folders.update(folder for folder in path.parents if below in folder.parents)
    for folder in sorted(folders, reverse=True):
        flush_file(folder)


@lru_cache(maxsize=1)
def _syncfs() -> Any:
    """Return the C library's ``syncfs``; None where there is none."""
    try:
        function = ctypes.CDLL(None, use_errno=True).syncfs
    except (OSError, AttributeError):
        return None
    function.argtypes, function.restype = [ctypes.c_int], ctypes.c_int
    return function
