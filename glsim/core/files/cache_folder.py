"""The cache folder of a machine, for data computed or downloaded once."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """Return $GLSIM_CACHE, else $XDG_CACHE_HOME/glsim, else ~/.cache/glsim."""
    if own := os.environ.get("GLSIM_CACHE"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glsim"
