"""Reference of the settings and of training recipes, from their pydantic models.

autodoc-pydantic documents models as Python classes: it shows neither TOML tables nor distributions.
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from glsim.settings import presets, schema
from glsim.settings.distribution import Distribution
from glsim.settings.presets import preset_names, preset_title
from glsim.settings.schema import POSE_LIMITS, SCENE_LIMITS, VARIATION_LIMITS, Settings
from glsim.settings.source_settings import SourceSettings, source_kinds, source_table
from glsim.train.recipe import Recipe
from scripts.reference.markdown import block, code, plain, table

#: Ranges of numbers or distributions, which the models check themselves: table -> key -> range.
_LIMITS = {"pose": POSE_LIMITS, "variation": VARIATION_LIMITS, "scene": SCENE_LIMITS}

_INTRODUCTION = """\
# Settings

Settings come from a TOML file (`--config`), from `--set NAME=VALUE` and from options; the tables
below are read from the code that checks them. *Number or distribution* means a number, or one of

    { uniform = [LOW, HIGH] }
    { loguniform = [LOW, HIGH] }
    { normal = [MEAN, DEVIATION] }
    { choice = [A, B, C] }

with `per = "frame"` (the default), `"sequence"` or `"subject"`. A normal distribution is cut at
three deviations. The manifest records what was drawn. An unknown key is an error that names
similar keys.

"""


def pages() -> dict[str, str]:
    """Return page name -> Markdown."""
    parts = [_INTRODUCTION, "## Layout\n\n"]
    layout = Path(schema.__file__).with_name("layout.toml").read_text(encoding="utf-8")
    parts += [block(layout, "toml"), *_tables(Settings, "")]
    parts.append("## Presets\n\n`--preset NAME` starts from one of these files.\n\n")
    for name in preset_names():
        text = (Path(presets.__file__).parent / f"{name}.toml").read_text(encoding="utf-8")
        parts.append(f"### `{name}`\n\n{plain(preset_title(name))}\n\n" + block(text, "toml"))
    recipe = [
        "# Training recipes\n\nA recipe is a TOML file with these tables. [Training a denoiser]"
        "(../howto/training.md) shows how they are used, and lists the shipped recipes.\n\n",
        *_tables(Recipe, ""),
    ]
    return {"settings": "".join(parts), "recipes": "".join(recipe)}


def setting_names(model: type[BaseModel] = Settings, prefix: str = "") -> list[str]:
    """Return all keys of a model and of the models in it, with dots."""
    names = []
    for name, field in model.model_fields.items():
        inner = _inner_model(field.annotation)
        names += [prefix + name] if inner is None else setting_names(inner, f"{prefix}{name}.")
    return names


def _tables(model: type[BaseModel], place: str) -> Iterator[str]:
    """Yield the heading and table of a model, then those of the models in it."""
    own = {n: f for n, f in model.model_fields.items() if _inner_model(f.annotation) is None}
    heading = f"`[{place}]`" if place else "Top level"
    yield f"## {heading}\n\n" + _summary(model) + _keys(own, place)
    for kind in source_kinds() if model is SourceSettings else ():
        keys = source_table(kind).model_fields
        keys = {name: field for name, field in keys.items() if name not in own}
        yield f'### `kind = "{kind}"`\n\n' + _summary(source_table(kind))
        yield _keys(keys, place) if keys else ""
    for name, field in model.model_fields.items():
        inner = _inner_model(field.annotation)
        if inner is not None:
            yield from _tables(inner, f"{place}.{name}" if place else name)


def _summary(model: type[BaseModel]) -> str:
    return plain((model.__doc__ or "").split("\n")[0]) + "\n\n"


def _keys(fields: Mapping[str, FieldInfo], place: str) -> str:
    """Return the table of some keys of a model."""
    rows = [
        [code(name), plain(_type_text(field.annotation)), code(_default(field)),
         plain(_range(field, place, name)), plain(field.description or "")]
        for name, field in fields.items()
    ]  # fmt: skip
    return table(["key", "type", "default", "range", "meaning"], rows)


def _inner_model(annotation: Any) -> type[BaseModel] | None:
    """Return the model of a table or of an array of tables; None for other keys."""
    while get_origin(annotation) in (tuple, Annotated):
        annotation = get_args(annotation)[0]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return None if annotation is Distribution else annotation
    return None


def _type_text(annotation: Any) -> str:
    if annotation is Distribution:
        return "number or distribution"
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type_text(arguments[0])
    if origin is Literal:
        return ", ".join(map(str, arguments))
    if origin in (Union, types.UnionType):
        return " or ".join(_type_text(a) for a in arguments if a is not type(None))
    if origin is tuple:
        if arguments[-1] is Ellipsis:
            return f"list of {_type_text(arguments[0])}"
        return f"{len(arguments)} times {_type_text(arguments[0])}"
    if origin is dict:
        return "table"
    names = {"str": "text", "int": "whole number", "float": "number", "bool": "true or false"}
    name = getattr(annotation, "__name__", str(annotation))
    return names.get(name, {"Path": "path", "PosixPath": "path"}.get(name, name))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return ""
    value = field.get_default(call_default_factory=True)
    if isinstance(value, Distribution):
        fields = value.model_dump(exclude_none=True, exclude_defaults=True)
        if value.is_constant:
            return f"{value.constant:g}"
        return ", ".join(f"{kind} {list(v)}" for kind, v in fields.items())
    if value is None or value == {}:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return str(list(value)) if isinstance(value, tuple) else str(value)


def _range(field: FieldInfo, place: str, name: str) -> str:
    """Return the limits of a key as text."""
    if limits := _LIMITS.get(place, {}).get(name):
        return f"{_number(limits[0])} to {_number(limits[1])}"
    low = high = ""
    for rule in field.metadata:
        low = f"from {_number(rule.ge)}" if getattr(rule, "ge", None) is not None else low
        low = f"above {_number(rule.gt)}" if getattr(rule, "gt", None) is not None else low
        high = f"to {_number(rule.le)}" if getattr(rule, "le", None) is not None else high
        high = f"below {_number(rule.lt)}" if getattr(rule, "lt", None) is not None else high
    return f"{low} {high}".strip()


def _number(value: float) -> str:
    """Return a limit as text; a large power of two as a power."""
    if value > 2**24 and value == 2 ** (int(value).bit_length() - 1):
        return f"2^{int(value).bit_length() - 1}"
    return f"{value:g}"
