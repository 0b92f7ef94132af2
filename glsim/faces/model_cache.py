"""Caches of face models on disk, memory-mapped by all processes of a machine."""

from __future__ import annotations

import logging
import shutil
import tempfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.core.files.cache_folder import cache_folder

Arrays = Mapping[str, NDArray[Any]]

_CHECKSUM: Final = "checksum"
_LOG = logging.getLogger(__name__)


def cached_arrays(name: str, build: Callable[[], Arrays]) -> Arrays:
    """Map a cache's arrays read-only; an absent or damaged cache is built and written first.

    ``name`` is a folder in ``cache_folder``; without a cache folder each process builds the arrays.
    """
    try:
        cache = cache_folder() / name
    except ConfigError as error:
        _LOG.warning("a face model is built again for each process: %s", error)
        return build()
    if cache.is_dir():
        try:
            return _read(cache)
        except Exception as error:  # damaged bytes raise errors of any type
            _LOG.warning("%s: damaged (%s), rebuilding it", cache, error)
    else:
        _LOG.info("building a face model (once; kept in %s)", cache)
    arrays = build()
    try:
        cache.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{cache.name}-", dir=cache.parent) as work:
            written = Path(work) / "arrays"
            written.mkdir()
            for name, array in arrays.items():
                np.save(written / f"{name}.npy", array)
            (written / _CHECKSUM).write_text(_checksum(arrays))
            shutil.rmtree(cache, ignore_errors=True)  # damaged
            with suppress(OSError):  # another process was faster
                written.rename(cache)
            return _read(cache)
    except OSError as error:
        _LOG.warning("%s: cannot be cached there (%s)", cache, error.strerror or error)
        return arrays


def _read(cache: Path) -> Arrays:
    arrays = {file.stem: np.load(file, mmap_mode="r") for file in sorted(cache.glob("*.npy"))}
    if _checksum(arrays) != (cache / _CHECKSUM).read_text():
        raise ValueError("the content does not match its checksum")
    return arrays


def _checksum(arrays: Arrays) -> str:
    total = 0
    for name in sorted(arrays):
        flat = np.ascontiguousarray(arrays[name]).reshape(-1)
        total = zlib.crc32(flat.view(np.uint8).data, zlib.crc32(name.encode(), total))
    return f"{total:08x}"
