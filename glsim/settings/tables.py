"""TOML tables as nested dicts: reading, assignments, merging and validation by a pydantic model.

Settings (``schema``), sensors, recipes and plans each have a model of their own.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from glsim.errors import ConfigError
from glsim.files.regular import read_regular
from glsim.settings.problems import first_problem

#: Largest TOML file, bytes; those that glsim ships have 4,000.
_MAX_BYTES = 1 << 20

_Model = TypeVar("_Model", bound=BaseModel)


class TomlTable(BaseModel):
    """The base of models of TOML tables: values are frozen, unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def read_toml(file: Path) -> dict[str, Any]:
    """Read a TOML file as nested dicts. Raises ConfigError with the file's name."""
    try:
        return tomllib.loads(read_regular(file, _MAX_BYTES).decode())
    except FileNotFoundError:
        raise ConfigError(f"{file}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror or error}") from None
    except RecursionError:
        raise ConfigError(f"{file}: is nested too deeply") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{file}: line {line} is no UTF-8 text: save the file as UTF-8") from None
    except ValueError as error:  # no TOML, a number of thousands of digits
        raise ConfigError(f"{file}: {' '.join(str(error).split())[:200]}") from None


def split_assignment(text: str, example: str) -> tuple[list[str], Any]:
    """Split ``"a.b=2.5"`` into (["a", "b"], 2.5). Values are TOML; a bare word is a string.

    Raises ConfigError, which shows ``example``, if ``text`` is not "name=value".
    """
    name, equals, value = text.partition("=")
    path = [part.strip() for part in name.split(".")]
    if not equals or not value.strip() or not all(path):
        raise ConfigError(f"--set {text}: write name=value, e.g. {example}")
    try:
        return path, tomllib.loads(f"value = {value}")["value"]
    except RecursionError:
        raise ConfigError(f"--set {name}: its value is nested too deeply") from None
    except ValueError:
        return path, value.strip()


def assign(tree: dict[str, Any], path: list[str], value: Any, text: str) -> None:
    """Set the value at ``path`` in nested dicts. Raises ConfigError with ``text`` if it cannot."""
    node: Any = tree
    for part in path[:-1]:
        if isinstance(node, dict):
            node = node.setdefault(part, {})
    if not isinstance(node, dict):
        raise ConfigError(f"--set {text}: {'.'.join(path[:-1])} is not a single table")
    node[path[-1]] = value


def merge_tables(tree: dict[str, Any], overrides: Mapping[str, Any]) -> None:
    """Merge ``overrides`` into nested dicts, in place: tables merge, other values replace."""
    for key, value in overrides.items():
        if isinstance(value, Mapping) and isinstance(tree.get(key), dict):
            merge_tables(tree[key], value)
        else:
            tree[key] = dict(value) if isinstance(value, Mapping) else value


def parse_table(
    model: type[_Model],
    tree: Mapping[str, Any],
    where: str,
    places: Mapping[tuple[str, ...], str] | None = None,
) -> _Model:
    """Build a ``model`` from nested dicts. Raises ConfigError: the first problem, in one line.

    Args:
        where: the place of the settings, such as a file.
        places: path of a setting -> another place, for settings that come from an option.
    """
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        path, text = first_problem(model, error)
        path = [part for part in path if not part.isdigit()]  # positions in lists
        for given, place in (places or {}).items():
            length = min(len(given), len(path))
            if length and tuple(path[:length]) == given[:length]:
                where = place
        raise ConfigError(f"{where}: {text}") from None
