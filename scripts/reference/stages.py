"""Reference of the noise stages, from the declarations in their GLSL and Python files."""

from __future__ import annotations

import inspect
import re
from itertools import takewhile
from pathlib import Path

import glsim
from glsim.noise.registry import shipped_stages
from glsim.noise.stage import StageSpec
from glsim.sensors.sensor import load_sensor, sensor_names
from scripts.reference.markdown import block, code, plain, table

_INTRODUCTION = """\
# Noise stages

A sensor is a chain of stages. A stage is a GLSL file (or a Python function) whose declarations
are its interface: the tables below are read from them. `glsim stages NAME` prints the same. Set a
parameter with `--set STAGE.PARAMETER=VALUE`, to a number or a distribution; every stage also has
`enabled`.

"""


def pages() -> dict[str, str]:
    """Return page name -> Markdown: one page with an overview and a section per shipped stage."""
    users = _users()
    specs = shipped_stages()
    rows = [
        [f"[`{spec.name}`](#{spec.name})", plain(_summary(spec)), _names(users[spec.name])]
        for spec in specs.values()
    ]
    overview = _INTRODUCTION + table(["stage", "what it does", "used by"], rows)
    return {"stages": overview + "".join(_section(s, users[s.name]) for s in specs.values())}


def header_text(source: str) -> str:
    """Return the comment at the top of a GLSL file as Markdown; indented lines are formulas."""
    lines = takewhile(lambda line: line.startswith("//"), source.splitlines()[1:])
    text = [line.removeprefix("//") for line in lines if not line.startswith("//@")]
    paragraphs: list[str] = []
    for formula, part in _runs(text):
        body = "\n".join(line.strip() for line in part)
        paragraphs.append(block(body) if formula else plain(body) + "\n\n")
    return "".join(paragraphs)


def _runs(lines: list[str]) -> list[tuple[bool, list[str]]]:
    """Group lines into runs of indented lines (formulas) and other lines."""
    groups: list[tuple[bool, list[str]]] = []
    for line in lines:
        formula = line.startswith("   ")
        if not groups or groups[-1][0] != formula:
            groups.append((formula, []))
        groups[-1][1].append(line)
    return groups


def _section(spec: StageSpec, users: list[str]) -> str:
    path = Path(spec.file).relative_to(Path(glsim.__file__).parents[1])
    parts = [f"## `{spec.name}`\n\n"]
    if spec.function is not None:
        parts.append(plain(inspect.getdoc(spec.function) or spec.title) + "\n\n")
    else:
        header = header_text(Path(spec.file).read_text(encoding="utf-8"))
        header = header.removeprefix(f"{plain(spec.name)}: ")
        parts.append(header[:1].upper() + header[1:])
    facts = [f"- Used by: {_names(users) or 'no shipped sensor'}"]
    if spec.source is not None:
        layers = ", ".join(
            code(layer.name) + (f" (size {layer.scale} of the frame's)" if layer.scale != 1 else "")
            for layer in spec.source.writes
        )
        facts += [f"- Reads: {_names(spec.source.reads)}", f"- Writes: {layers}"]
    facts.append(f"- Source: [`{path}`](../../{path})")
    parts.append("\n".join(facts) + "\n\n")
    rows = [
        [code(p.name), p.type, f"{p.default:g}", _range(p.type, p.low, p.high), _unit(p.unit),
         plain(p.help)]
        for p in spec.parameters.values()
    ]  # fmt: skip
    if rows:
        head = ["parameter", "type", "default", "range", "unit", "meaning"]
        parts.append(table(head, rows))
    return "".join(parts)


def _summary(spec: StageSpec) -> str:
    """Return the title without the name before it."""
    return re.sub(rf"^{spec.name}:\s*", "", spec.title)


def _users() -> dict[str, list[str]]:
    users: dict[str, list[str]] = {name: [] for name in shipped_stages()}
    for name in sensor_names():
        for stage in load_sensor(name).stages:
            if name not in users[stage.spec.name]:
                users[stage.spec.name].append(name)
    return users


def _names(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(map(code, names))


def _range(kind: str, low: float, high: float) -> str:
    return "" if kind == "bool" else f"{low:g} to {high:g}"


def _unit(unit: str) -> str:
    return "" if unit == "1" else plain(unit)
