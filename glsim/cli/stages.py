"""``glsim stages``: list the noise stages and their parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from glsim.cli.common import STAGES, JsonOption, make_console, print_json, print_table

if TYPE_CHECKING:
    from glsim.noise.stage import StageSpec

EXAMPLES = """
glsim stages
glsim stages axial
glsim stages my_noise.glsl
glsim stages tof_light --json
"""


def stages(
    name: Annotated[str | None, typer.Argument(autocompletion=STAGES)] = None,
    as_json: JsonOption = False,
) -> None:
    """List the noise stages, or the parameters of one stage, as declared in its source file.

    A .glsl file is compiled as well.

    Args:
        name: The name of a stage, a .glsl file, or file.py:function.
    """
    from glsim.core.plugins import each_usable
    from glsim.noise.registry import describe_stage, find_stage, stage_names

    if name is None:
        specs = [spec for _, spec in each_usable(stage_names(), find_stage)]
    else:
        specs = [describe_stage(name)]
    if as_json:
        print_json([_described(spec) for spec in specs])
        return
    if name is None:
        table = Table("stage", "what it does", box=None)
        for spec in specs:
            table.add_row(spec.name, spec.title.removeprefix(f"{spec.name}: "))
        print_table(table)
        return
    (spec,) = specs
    if spec.source is not None and name.endswith(".glsl"):
        from glsim.gl.context import borrowed_context
        from glsim.gl.program import link

        with borrowed_context(None) as context:
            link(context, spec.source).release()
    out = make_console()
    out.print(spec.title, style="bold")
    out.print(f"file: {spec.file}", soft_wrap=True)
    if spec.source is not None:
        out.print(f"reads: {', '.join(spec.source.reads)}")
        out.print(f"writes: {', '.join(layer.name for layer in spec.source.writes)}")
    table = Table("parameter", "type", "default", "range", "unit", "help", "declared at", box=None)
    for p in spec.parameters.values():
        bounds = "" if p.type == "bool" else f"{p.low:g} to {p.high:g}"
        where = f"{p.file}:{p.line}"
        unit = "" if p.unit == "1" else p.unit
        table.add_row(p.name, p.type, f"{p.default:g}", bounds, unit, p.help, where)
    table.add_row("enabled", "bool", "1", "", "", "0 switches the stage off", "every stage")
    print_table(table)


def _described(spec: StageSpec) -> dict[str, Any]:
    """Return a stage and its parameters as JSON values."""
    return {
        "name": spec.name,
        "title": spec.title,
        "file": str(spec.file),
        "reads": [] if spec.source is None else list(spec.source.reads),
        "writes": [] if spec.source is None else [layer.name for layer in spec.source.writes],
        "parameters": [
            {"name": p.name, "type": p.type, "default": p.default, "low": p.low, "high": p.high,
             "unit": p.unit, "help": p.help}
            for p in spec.parameters.values()
        ],
    }  # fmt: skip
