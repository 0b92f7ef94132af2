"""The settings of a [[source]] of faces; each kind of source declares its own table.

A kind is a file in glsim/faces/sources, or an entry point "glsim.sources" of another package.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final, TypeGuard

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from glsim.core.plugins import load_plugin, module_names, plugin_names, shipped_module
from glsim.settings.toml_tables import TomlTable

_GROUP: Final = "sources"
_FOLDER: Final = "faces/sources"
#: Settings of mesh files, which data sets record for every kind of source.
_RECORDED: Final = {"unit": "auto", "axes": "auto"}
#: Settings that come first in the header of a data set; the kind's own settings follow them.
_FIRST: Final = (
    "kind", "root", "subjects", "frames_per_subject", "frames_per_sequence", "frames_per_second",
    "unit", "axes",
)  # fmt: skip
_LAST: Final = ("weight", "count")


class SourceSettings(TomlTable):
    """The settings of a source of faces, a generator or a folder of meshes."""

    #: Whether the source generates as many people and frames as the settings ask for.
    endless: ClassVar[bool] = False

    kind: str = Field("procedural", description="where faces come from")
    root: Path | None = Field(None, description="folder of the meshes or of the face model")
    subjects: int | None = Field(None, ge=1, description="number of people; default: all")
    frames_per_subject: int | None = Field(None, ge=1, description="per person; default: all")
    weight: float | None = Field(None, gt=0, lt=1e9, description="share relative to other sources")
    count: int | None = Field(None, ge=1, description="number of images from this source")

    def room_problem(self) -> str:
        """Return why people of this source cannot stand in a room, or ""."""
        return ""

    @model_validator(mode="before")
    @classmethod
    def _refuse_options_of_others(cls, table: Any) -> Any:
        """Drop unset options of other kinds of sources; refuse options that are set."""
        if not isinstance(table, Mapping):
            return table
        kept = dict(table)
        for name in table.keys() - cls.model_fields.keys():
            if kept[name] is None or kept[name] == _RECORDED.get(name):
                del kept[name]
                continue
            if kinds := [k for k in shipped_kinds() if name in source_table(k).model_fields]:
                kind = table.get("kind", cls.model_fields["kind"].default)
                raise ValueError(f"{name}: {kind} has no such option ({', '.join(kinds)})")
            unknown = PydanticCustomError("extra_forbidden", "", {"known": [*cls.model_fields]})
            details: InitErrorDetails = {"type": unknown, "loc": (name,), "input": table[name]}
            raise ValidationError.from_exception_data(cls.__name__, [details])
        return kept

    @model_validator(mode="after")
    def _check_share(self) -> SourceSettings:
        if self.weight is not None and self.count is not None:
            raise ValueError("give a source a weight or a count, not both")
        return self

    @model_serializer(mode="wrap")
    def _in_recorded_order(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        given = _RECORDED | handler(self)
        own = [name for name in given if name not in _FIRST + _LAST]
        return {name: given[name] for name in (*_FIRST, *own, *_LAST) if name in given}


def shipped_kinds() -> list[str]:
    """Return the shipped kinds of sources, sorted, without importing them."""
    return [name.replace("_", "-") for name in module_names(_FOLDER)]


def source_kinds() -> list[str]:
    """Return the kinds of sources of glsim and of plug-ins, sorted, without importing them."""
    shipped = shipped_kinds()
    return sorted([*shipped, *plugin_names(_GROUP, shipped)])


def source_table(kind: str) -> type[SourceSettings]:
    """Import the settings class of a kind of source. Raises ConfigError for a broken plug-in."""
    if kind in shipped_kinds():
        module = shipped_module(_FOLDER, kind.replace("-", "_"))
        own = (value for value in vars(module).values() if _is_table(value))
        return next(table for table in own if table.__module__ == module.__name__)
    loaded: type[SourceSettings] = load_plugin(_GROUP, kind, _is_table)
    return loaded


def _is_table(value: object) -> TypeGuard[type[SourceSettings]]:
    return isinstance(value, type) and issubclass(value, SourceSettings)


@cache
def generates(kind: str) -> bool:
    """Return whether this kind of source generates faces instead of reading them from files."""
    return kind in source_kinds() and source_table(kind).endless


def parse_source(table: Mapping[str, Any]) -> SourceSettings:
    """Validate a [[source]] table by the class of its kind. Raises pydantic's ValidationError."""
    kind = table.get("kind", SourceSettings.model_fields["kind"].default)
    if kind not in shipped_kinds() and kind not in source_kinds():
        expected = ", ".join(map(repr, source_kinds()))
        raise ValidationError.from_exception_data(
            "SourceSettings",
            [
                {"type": "literal_error", "loc": ("kind",), "input": kind,
                 "ctx": {"expected": expected}}
            ],
        )  # fmt: skip
    return source_table(str(kind)).model_validate(table)
