"""The folder of the caches of face models, and how a cache is written into it."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

_STALE_S: Final = 3600.0  # a cache is written in seconds
_LOG = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Return $GLSIM_CACHE, else $XDG_CACHE_HOME/glsim, else ~/.cache/glsim."""
    if own := os.environ.get("GLSIM_CACHE"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glsim"


def write_cache_folder(cache: Path, fill: Callable[[Path], None], content: str) -> None:
    """Write a cache, a folder, atomically; one that is there is replaced as damaged.

    Args:
        fill: writes the files into the folder that it is given.
        content: what is cached, for the warning that is logged if the folder cannot be written.
    """
    temporary = ""
    try:
        cache.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(cache)
        temporary = tempfile.mkdtemp(prefix=f".{cache.name}-", dir=cache.parent)
        fill(Path(temporary))
        if cache.exists():
            shutil.rmtree(cache, ignore_errors=True)  # damaged
        try:
            Path(temporary).rename(cache)
        except OSError:  # another process was faster
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        _LOG.warning("%s: %s cannot be cached there (%s)", cache, content, error.strerror or error)


def _remove_stale(cache: Path) -> None:
    """Remove what processes left that were killed while they wrote a cache of this source."""
    source = cache.name.split("-")[0]
    for path in cache.parent.glob(f".{source}-*"):
        with suppress(OSError):  # another process may remove it at the same time
            if time.time() - path.stat().st_mtime > _STALE_S:
                shutil.rmtree(path, ignore_errors=True)
