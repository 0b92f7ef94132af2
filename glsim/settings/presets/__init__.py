"""Presets: complete settings for common data sets, as TOML files beside this module.

A file has the tables of a settings file, and ``title``, a line that ``--help`` prints.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from glsim.core.errors import ConfigError, did_you_mean

_FOLDER = Path(__file__).parent


def preset_names() -> list[str]:
    """Return the names of the shipped presets, sorted."""
    return sorted(file.stem for file in _FOLDER.glob("*.toml"))


def preset_title(name: str) -> str:
    """Return the one-line description of a preset. Raises ConfigError for an unknown name."""
    return str(_read(name)["title"])


def read_preset(name: str) -> dict[str, Any]:
    """Return the settings of a preset as nested dicts. Raises ConfigError for an unknown name."""
    tree = _read(name)
    del tree["title"]
    return tree


def _read(name: str) -> dict[str, Any]:
    names = preset_names()
    if name not in names:
        raise ConfigError(f"no such preset {name!r} ({did_you_mean(name, names)})")
    return tomllib.loads((_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
