"""Parameters of denoisers on the command line, as fields of dataclasses."""

from __future__ import annotations

import dataclasses
from typing import Any

from glsim.core.errors import ConfigError, did_you_mean


def parameter(default: float | None, low: float, high: float, help: str) -> Any:
    """Declare a dataclass field as a command-line parameter in the range [low, high].

    The field's type, int or float, is the parameter's type. A default of None sets no value.
    """
    return dataclasses.field(default=default, metadata={"range": (low, high), "help": help})


def build(kind: type, text: dict[str, str], where: str) -> Any:
    """Make a dataclass whose fields are ``parameter`` from texts of the command line.

    Raises ConfigError for an unknown name, or a value that is no number in range.

    Args:
        text: parameter name -> value as text.
        where: the denoiser as it was given, for messages.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}
    values: dict[str, float] = {}
    for name, written in text.items():
        field = fields.get(name)
        if field is None:
            raise ConfigError(
                f"denoiser {where}: no such parameter {name!r} ({did_you_mean(name, fields)})"
            )
        whole = str(getattr(field.type, "__name__", field.type)).startswith("int")
        try:
            value = int(written) if whole else float(written)
        except ValueError:
            number = "a whole number" if whole else "a number"
            raise ConfigError(f"denoiser {where}: {name} must be {number}") from None
        low, high = field.metadata["range"]
        if not low <= value <= high:
            raise ConfigError(f"denoiser {where}: {name} must lie in [{low:g}, {high:g}]")
        values[name] = value
    return kind(**values)
