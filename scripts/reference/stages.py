"""Reference of the noise stages, from the declarations in their GLSL and Python files."""

from __future__ import annotations

import ast
import inspect
import re
from itertools import takewhile
from pathlib import Path

from glsim.noise.registry import shipped_stages
from glsim.noise.stage import StageSpec
from glsim.sensors.sensor import load_sensor, sensor_names
from scripts.reference.markdown import block, code, plain, table, toctree

_INTRODUCTION = """\
# Noise stages

A sensor is a chain of stages. A stage is a GLSL file (or a Python function) whose declarations
are its interface: the tables below are read from them. `glsim stages NAME` prints the same. Set a
parameter with `--set STAGE.PARAMETER=VALUE`, to a number or a distribution; every stage also has
`enabled`.

"""


def pages() -> dict[str, str]:
    """Return page name -> Markdown: an overview, and one page per shipped stage."""
    users = _users()
    specs = shipped_stages()
    rows = [
        [f"[`{spec.name}`](stages/{spec.name}.md)", plain(_summary(spec)), _names(users[spec.name])]
        for spec in specs.values()
    ]
    overview = _INTRODUCTION + table(["stage", "what it does", "used by"], rows)
    overview += toctree(f"stages/{name}" for name in specs)
    return {"stages": overview} | {
        f"stages/{spec.name}": _page(spec, users[spec.name]) for spec in specs.values()
    }


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


def _page(spec: StageSpec, users: list[str]) -> str:
    text = Path(spec.file).read_text(encoding="utf-8")
    language = "python" if spec.function else "glsl"
    parts = [f"# `{spec.name}`\n\n"]
    if spec.function is not None:
        parts.append(plain(inspect.getdoc(spec.function) or spec.title) + "\n\n")
        text = _function_text(text, spec.name)
    else:
        header = header_text(text).removeprefix(f"{plain(spec.name)}: ")
        parts.append(header[:1].upper() + header[1:])
    facts = [f"- Used by: {_names(users) or 'no shipped sensor'}"]
    if spec.source is not None:
        layers = ", ".join(
            code(layer.name) + (f" (size {layer.scale} of the frame's)" if layer.scale != 1 else "")
            for layer in spec.source.writes
        )
        facts += [f"- Reads: {_names(spec.source.reads)}", f"- Writes: {layers}"]
        folder = Path(spec.file).parent.name
        facts.append(f"- File: `shaders/{folder}/{spec.name}.glsl`")
    parts.append("\n".join(facts) + "\n\n## Parameters\n\n")
    rows = [
        [code(p.name), p.type, f"{p.default:g}", _range(p.type, p.low, p.high), _unit(p.unit),
         plain(p.help)]
        for p in spec.parameters.values()
    ]  # fmt: skip
    rows.append(["`enabled`", "bool", "1", "", "", "0 switches the stage off"])
    parts.append(table(["parameter", "type", "default", "range", "unit", "meaning"], rows))
    parts.append("## Source\n\n" + block(text, language))
    return "".join(parts)


def _summary(spec: StageSpec) -> str:
    """Return the title without the name before it."""
    return re.sub(rf"^{spec.name}:\s*", "", spec.title)


def _function_text(module: str, name: str) -> str:
    """Return the source of a function of a module, with its decorators."""
    for node in ast.parse(module).body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            return "\n".join(module.splitlines()[first - 1 : node.end_lineno])
    raise LookupError(name)


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
