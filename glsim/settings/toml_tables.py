"""TOML tables as nested dicts: read, assign, merge, and validate them by a pydantic model.

Settings (``schema``), sensors, recipes and plans each have their own model.
"""

from __future__ import annotations

import errno
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from glsim.core.errors import ConfigError, UnknownSettingError, did_you_mean
from glsim.core.files.regular import read_regular
from glsim.core.units import M_PER_MM, MM_PER_M

#: Largest TOML file, bytes; shipped files have about 4,000.
_MAX_BYTES = 1 << 18

_BACKSLASH = (
    "a backslash in double quotes starts a special character; write a path in single quotes: "
    "'C:\\scans'"
)

_Model = TypeVar("_Model", bound=BaseModel)


class TomlTable(BaseModel):
    """The base class of pydantic models of TOML tables: frozen values, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def read_toml(file: Path) -> dict[str, Any]:
    """Read a TOML file as nested dicts. Raises ConfigError that names the file."""
    try:
        text = read_regular(file, _MAX_BYTES).decode("utf-8-sig")
        for number, written in enumerate(text.splitlines(), 1):
            if re.match(r'[^#"]*"[A-Za-z]:\\(?!\\)', written):
                raise ConfigError(f"{file}: line {number}: {_BACKSLASH}")
        return tomllib.loads(text)
    except OSError as error:
        known = {errno.ENOENT: "no such file", errno.EISDIR: "is a folder: give a .toml file"}
        reason = known.get(error.errno or 0) or error.strerror or error
        raise ConfigError(f"{file}: {reason}") from None
    except RecursionError:
        raise ConfigError(f"{file}: is nested too deeply") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{file}: line {line} is no UTF-8 text: save the file as UTF-8") from None
    except ValueError as error:  # not TOML, or a number of thousands of digits
        reason = " ".join(str(error).split())[:200]
        place = re.search(r"at line (\d+)", reason)
        if place and re.search(r'"[^"]*\\', text.splitlines()[int(place[1]) - 1]):
            reason = f"line {place[1]}: {_BACKSLASH}"
        if text.lstrip().startswith("{"):
            reason = "is JSON, not TOML, which has lines such as seed = 3"
        raise ConfigError(f"{file}: {reason}") from None


def split_assignment(text: str, example: str) -> tuple[list[str], Any]:
    """Split ``"a.b=2.5"`` into (["a", "b"], 2.5); a value that is not TOML is a string.

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
    """Set the value at ``path`` in nested dicts. Raises ConfigError if a part is not a table."""
    node: Any = tree
    for part in path[:-1]:
        if isinstance(node, dict):
            node = node.setdefault(part, {})
    if not isinstance(node, dict):
        raise ConfigError(f"--set {text}: {'.'.join(path[:-1])} is not a single table")
    node[path[-1]] = value


#: Kinds of distributions of a number, see ``glsim.settings.distribution``.
KINDS = ("constant", "uniform", "loguniform", "normal", "choice")


def merge_tables(tree: dict[str, Any], overrides: Mapping[str, Any]) -> None:
    """Merge ``overrides`` into nested dicts in place; dicts merge, other values replace.

    A distribution keeps its ``per`` where another kind replaces it.
    """
    for key, value in overrides.items():
        if isinstance(value, Mapping) and isinstance(tree.get(key), dict):
            if not value.keys().isdisjoint(KINDS):
                tree[key] = {k: v for k, v in tree[key].items() if k not in KINDS}
            merge_tables(tree[key], value)
        else:
            tree[key] = dict(value) if isinstance(value, Mapping) else value


def parse_table(
    model: type[_Model],
    tree: Mapping[str, Any],
    where: str,
    places: Mapping[tuple[str, ...], str] | None = None,
) -> _Model:
    """Build a ``model`` from nested dicts. Raises ConfigError with the first problem, in one line.

    ``places``: path of a setting -> a more exact place, such as an option.
    """
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        path, text = first_problem(model, error)
        path = [part for part in path if not part.isdigit()]  # without positions in lists
        for at, place in (places or {}).items():
            length = min(len(at), len(path))
            if length and tuple(path[:length]) == at[:length]:
                where = place
        if text.startswith(_NO_SETTING):
            raise UnknownSettingError(f"{where}: {text}", path[-1]) from None
        raise ConfigError(f"{where}: {text}") from None


#: Number of characters of a wrong value that a message shows.
_SHOWN = 60
_DISTRIBUTION = "give a number, or a distribution such as { uniform = [1, 2] }"
#: Pydantic's error types for an unknown setting: in a model, in a dataclass.
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
#: Parts of pydantic's error paths that name a validator, not a setting, begin with these.
_INTERNAL = ("function-", "tuple[", "lax-or-strict", "is-instance", "literal[")
_NO_SETTING = "no such setting"
_TABLE = "is a table: set one of its entries"


def first_problem(model: type[BaseModel], error: ValidationError) -> tuple[list[str], str]:
    """Return the path of the first problem, misspelt names first, and a one-line message."""
    problem = min(error.errors(), key=lambda p: p["type"] not in _UNKNOWN)
    path = [part for part in map(str, problem["loc"]) if not part.startswith(_INTERNAL)]
    name = ".".join(path).replace("source.0.", "source.")
    if problem["type"] in _UNKNOWN:
        elsewhere = list(dotted_names(model))
        tables = [part for part in path[:-1] if not part.isdigit()]
        known = [n.split(".")[-1] for n in elsewhere if n.split(".")[:-1] == tables]
        known = problem.get("ctx", {}).get("known") or known
        advice = did_you_mean(path[-1], known, name.removesuffix(path[-1]), elsewhere)
        if "stage" in known and ("." in path[-1] or isinstance(problem["input"], Mapping)):
            advice += "; names have no dots: tables nest, those of stages in the table stage"
        return path, f"{_NO_SETTING} {name!r} ({advice})"
    text, value = _text(problem), problem.get("input")
    if isinstance(value, str | int | float) and problem["type"] != "literal_error":
        text += f" (got {value!r:.{_SHOWN}})"
    if isinstance(value, int | float):
        setting = next((part for part in reversed(path) if not part.isdigit()), "")
        bound = problem.get("ctx", {})
        text += meant(setting, value, bound.get("ge", -math.inf), bound.get("le", math.inf))
    return path, f"{name}: {text}" if name else text


def meant(name: str, value: float, least: float, most: float) -> str:
    """Return ": metres meant? 900" if 1000 times a number beyond its limits fits them, or ""."""
    for end, factor, unit in (("_mm", MM_PER_M, "metres"), ("_m", M_PER_MM, "millimetres")):
        if name.endswith(end) and not least <= value <= most and least <= value * factor <= most:
            return f": {unit} meant? {value * factor:g}"
    return ""


def flattened(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested tables, and lists of tables, to {dotted name: value}."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
            value = dict(enumerate(value)) if len(value) > 1 else value[0]  # as --set names it
        name = f"{prefix}{key}"
        flat |= flattened(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return flat


def _text(problem: Mapping[str, Any]) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    if kind == "missing":
        return "is missing"
    if kind == "literal_error":
        known = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
        value = str(problem["input"])
        near = did_you_mean(value, known)
        more = f" ({near})" if near.startswith("did you mean") else ""
        return f"{value!r:.{_SHOWN}} is not one of {', '.join(known)}{more}"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return _DISTRIBUTION if context.get("class_name") == "Distribution" else _TABLE
    if kind in ("tuple_type", "list_type"):
        return "must be a list, such as [1, 2]"
    message = str(problem["msg"]).removeprefix("Value error, ")
    return message.replace("Input should be", "must be")


def dotted_names(table: Any, prefix: str = "") -> Iterator[str]:
    """Yield the names of a model's or dataclass' fields and, after a dot, of the tables in them."""
    if isinstance(table, type) and issubclass(table, BaseModel):
        inner = {name: field.annotation for name, field in table.model_fields.items()}
    elif isinstance(table, type) and is_dataclass(table):
        inner = {field.name: None for field in fields(table)}
    else:  # such as tuple[Model, ...] or Model | None
        for each in get_args(table):
            yield from dotted_names(each, prefix)
        return
    for name, annotation in inner.items():
        yield prefix + name
        yield from dotted_names(annotation, f"{prefix}{name}.")


def toml_value(value: Any) -> str:
    """Write a number, bool, string, list or dict as a TOML value in one line."""
    if isinstance(value, Mapping):
        names = (name if name.isidentifier() else json.dumps(name) for name in value)
        pairs = zip(names, map(toml_value, value.values()), strict=True)
        return "{ " + ", ".join(map(" = ".join, pairs)) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    return json.dumps(value)
