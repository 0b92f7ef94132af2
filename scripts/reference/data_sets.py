"""Reference of the files of a data set, from the schema by which they are read."""

from __future__ import annotations

import json
from textwrap import dedent
from typing import Any

from pydantic import TypeAdapter

from glsim.core.reason import Reason
from glsim.data import disk_format
from glsim.data.record_schema import FrameRecord, HeaderRecord
from glsim.faces.regions import KNOWN_REGIONS
from scripts.reference.markdown import block, code, plain, table

_INTRODUCTION = f"""\
# Format of a data set

Version {disk_format.FORMAT_VERSION}. [A data set on disk](../howto/data_sets.md) explains it.
This page is read from the code that checks each record. Keys that are not listed are kept as they
are: a later version may add some.

"""
#: Record -> (the file, its title).
_RECORDS: tuple[tuple[Any, str, str], ...] = (
    (HeaderRecord, disk_format.HEADER, "the header of the data set"),
    (FrameRecord, disk_format.MANIFEST, "one line per frame"),
)


def pages() -> dict[str, str]:
    """Return page name -> Markdown: one page."""
    layout = dedent((disk_format.__doc__ or "").split("\n\n", 1)[1])
    parts = [_INTRODUCTION, "## Files\n\n", block(layout)]
    for record, file, title in _RECORDS:
        schema = TypeAdapter(record).json_schema()
        parts.append(f"## `{file}`: {title}\n\n")
        parts.append(table(["key", "content", "always there"], _rows(schema, schema, "")))
        parts.append(
            f"### JSON schema of `{file}`\n\n" + block(json.dumps(schema, indent=1), "json")
        )
    parts.append("## Codes of the layer `reason`\n\n")
    rows = [
        [str(r.value), code(r.name), "yes" if r.has_depth else "no", plain(r.help)] for r in Reason
    ]
    parts.append(table(["code", "name", "has depth", "meaning"], rows))
    parts.append(
        "## Regions with a fixed number\n\nA source may add names of its own, with further "
        "numbers; `regions` in `dataset.json` holds the table of a data set.\n\n"
    )
    numbered = [[str(n), plain(name)] for n, name in enumerate(KNOWN_REGIONS, start=1)]
    parts.append(table(["number", "region"], [["0", "none"], *numbered]))
    return {"data_sets": "".join(parts)}


def _rows(schema: dict[str, Any], root: dict[str, Any], prefix: str) -> list[list[str]]:
    """Return a table row for each key, also for keys of inner tables."""
    rows = []
    required = schema.get("required", ())
    for name, value in schema.get("properties", {}).items():
        needed = "yes" if name in required else ""
        resolved = _resolved(value, root)
        rows.append([code(prefix + name), plain(_content(resolved, root)), needed])
        rows += _rows(resolved, root, f"{prefix}{name}.")
        each = resolved.get("additionalProperties")
        if isinstance(each, dict):
            rows += _rows(_resolved(each, root), root, f"{prefix}{name}.*.")
    return rows


def _resolved(value: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    """Return the schema to which a reference points."""
    if "$ref" not in value:
        return value
    found: dict[str, Any] = root["$defs"][value["$ref"].rsplit("/", 1)[1]]
    return found


def _content(value: dict[str, Any], root: dict[str, Any]) -> str:
    """Return the type and the limits of a value as text."""
    if "const" in value:
        return str(value["const"])
    if "enum" in value:
        return ", ".join(map(str, value["enum"]))
    kind = str(value.get("type", "any"))
    if kind == "array":
        items = _content(_resolved(value.get("items", {}), root), root)
        count = value.get("minItems") if value.get("minItems") == value.get("maxItems") else None
        return f"{count} times {items}" if count else f"list of {items}"
    if kind == "object":
        each = value.get("additionalProperties")
        keys = value.get("propertyNames", {}).get("enum")
        if isinstance(each, dict):
            inner = _content(_resolved(each, root), root)
            return f"table of {inner}" + (f" by {', '.join(keys)}" if keys else " by name")
        return "table"
    names = {"string": "text", "integer": "whole number"}
    low = value.get("minimum", value.get("exclusiveMinimum"))
    high = value.get("maximum", value.get("exclusiveMaximum"))
    limits = f", {low:g} to {high:g}" if low is not None and high is not None else ""
    return names.get(kind, kind) + limits
