"""Presets: settings files of common data sets, with a ``title`` for ``glsim presets``."""

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
    return str(tomllib.loads(preset_file(name).read_text(encoding="utf-8"))["title"])


def read_preset(name: str) -> dict[str, Any]:
    """Return the settings of a preset as nested dicts. Raises ConfigError for an unknown name."""
    tree = tomllib.loads(preset_file(name).read_text(encoding="utf-8"))
    del tree["title"]
    return tree


def preset_file(name: str) -> Path:
    """Return the TOML file of a preset. Raises ConfigError for an unknown name."""
    names = preset_names()
    if name not in names:
        raise ConfigError(f"no such preset {name!r} ({did_you_mean(name, names)})")
    return _FOLDER / f"{name}.toml"
