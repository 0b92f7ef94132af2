"""Say what is wrong with a setting in words of glsim: its name, and what it may be."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from glsim.errors import did_you_mean

#: Characters of a given value that are shown.
_SHOWN = 60
_DISTRIBUTION = "give a number, or a distribution such as { uniform = [1, 2] }"
#: Pydantic's names of a setting that there is not: in a model, in a dataclass.
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_TABLE = "is a table: set one of its entries"


def first_problem(model: type[BaseModel], error: ValidationError) -> tuple[list[str], str]:
    """Return the path of the first wrong setting, and one line about it that begins with its name.

    A misspelt name comes before what it leaves missing.
    """
    problems = sorted(error.errors(), key=lambda p: p["type"] not in _UNKNOWN)
    problem = problems[0]
    path = [str(part) for part in problem["loc"] if not _is_internal(str(part))]
    name = ".".join(path)
    if problem["type"] in _UNKNOWN:
        known = problem.get("ctx", {}).get("known") or _fields_at(model, path[:-1])
        return path, f"no such setting {name!r} ({did_you_mean(path[-1], known)})"
    text = _text(dict(problem))
    given = problem.get("input")
    if isinstance(given, str | int | float) and problem["type"] != "literal_error":
        text += f" (got {given!r:.{_SHOWN}})"
    return path, f"{name}: {text}" if name else text


def _is_internal(part: str) -> bool:
    """Whether a part of pydantic's path names a validator, not a setting."""
    return part.startswith(("function-", "tuple[", "lax-or-strict", "is-instance", "literal["))


def _text(problem: dict[str, Any]) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    if kind == "missing":
        return "is missing"
    if kind == "literal_error":
        known = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
        given = str(problem["input"])
        return f"{given!r:.{_SHOWN}} is not one of {', '.join(known)}" + _near(given, known)
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return _DISTRIBUTION if context.get("class_name") == "Distribution" else _TABLE
    if kind in ("tuple_type", "list_type"):
        return "must be a list, such as [1, 2]"
    message = str(problem["msg"]).removeprefix("Value error, ")
    return message.replace("Input should be", "must be")


def _near(name: str, known: list[str]) -> str:
    text = did_you_mean(name, known)
    return f" ({text})" if text.startswith("did you mean") else ""


def _fields_at(model: type[BaseModel], path: list[str]) -> list[str]:
    for part in path:
        field = model.model_fields.get(part)
        if field is None:
            continue
        inner = [field.annotation, *getattr(field.annotation, "__args__", ())]
        models = [a for a in inner if isinstance(a, type) and issubclass(a, BaseModel)]
        if models:
            model = models[0]
        elif is_dataclass(field.annotation):
            return [entry.name for entry in fields(field.annotation)]
    return list(model.model_fields)
