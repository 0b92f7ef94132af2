"""Caches of face models: folders of arrays that all processes of a machine map."""

from __future__ import annotations

import logging
import shutil
import tempfile
import time
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

Arrays = Mapping[str, np.ndarray[Any, Any]]

_WORDS: Final = "words.npz"
_STALE_S: Final = 3600.0  # a cache is written in seconds
_LOG = logging.getLogger(__name__)


def write_cache(cache: Path, arrays: Arrays, words: Mapping[str, Any], content: str) -> None:
    """Write a cache, a folder, atomically; one that is there is replaced as damaged.

    Args:
        cache: the folder.
        arrays: name -> array, one file each.
        words: name -> text, number, or list of them.
        content: what is cached, for the warning that is logged if it cannot be written.
    """
    temporary = ""
    try:
        cache.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(cache)
        temporary = tempfile.mkdtemp(prefix=f".{cache.name}-", dir=cache.parent)
        for name, array in arrays.items():
            np.save(Path(temporary) / f"{name}.npy", array)
        np.savez(Path(temporary) / _WORDS, names=[*arrays], checksum=_checksum(arrays), **words)
        if cache.exists():
            shutil.rmtree(cache, ignore_errors=True)  # damaged
        try:
            Path(temporary).rename(cache)
        except OSError:  # another process was faster
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        _LOG.warning("%s: %s cannot be cached there (%s)", cache, content, error.strerror or error)


def read_cache(cache: Path) -> tuple[Arrays, dict[str, Any]] | None:
    """Map the arrays of a cache and read its words; None without a cache or for a damaged one."""
    if not cache.is_dir():
        return None
    try:
        with (cache / _WORDS).open("rb") as file, np.load(file) as stored:
            words = {name: value.tolist() for name, value in stored.items()}
        names = words.pop("names")
        arrays: Arrays = {n: np.load(cache / f"{n}.npy", mmap_mode="r") for n in names}
        if _checksum(arrays) != words.pop("checksum"):
            raise ValueError("the content does not match its checksum")
        return arrays, words
    except Exception as error:  # damaged bytes raise errors of any type
        _LOG.warning("%s: damaged (%s), rebuilding it", cache, error)
        return None


def _checksum(arrays: Arrays) -> int:
    total = 0
    for array in arrays.values():
        total = zlib.crc32(np.ascontiguousarray(array).data, total)
    return total


def _remove_stale(cache: Path) -> None:
    """Remove what processes left that were killed while they wrote a cache of this source."""
    source = cache.name.split("-")[0]
    for path in cache.parent.glob(f".{source}-*"):
        with suppress(OSError):  # another process may remove it at the same time
            if time.time() - path.stat().st_mtime > _STALE_S:
                shutil.rmtree(path, ignore_errors=True)
