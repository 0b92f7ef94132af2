"""The cache folder of this machine, for data that were computed or downloaded once."""

from __future__ import annotations

import os
from pathlib import Path

from glsim.core.errors import ConfigError


def cache_folder() -> Path:
    """Return $GLSIM_CACHE, else $XDG_CACHE_HOME/glsim, else ~/.cache/glsim, or ConfigError."""
    if own := os.environ.get("GLSIM_CACHE"):
        return Path(own)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glsim"
    except RuntimeError:
        raise ConfigError(
            "this user has no home folder for a cache: set GLSIM_CACHE to a folder"
        ) from None
