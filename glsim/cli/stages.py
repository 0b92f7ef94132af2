"""``glsim stages``: list the noise stages and their parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from glsim.cli.common import STAGES, JsonOption, make_console, print_json, print_table
from glsim.core.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from glsim.gl.shader_source import ShaderSource
    from glsim.noise.stage import StageSpec


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

        _check_names(spec.source)
        with borrowed_context(None) as context:
            link(context, spec.source)
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


def _check_names(source: ShaderSource) -> None:
    """Raise ConfigError for a uniform or a layer that a shader reads and glsim does not know."""
    from glsim.core.plugins import each_usable
    from glsim.noise.chain import check_uniforms
    from glsim.noise.layer_names import FINE_LAYERS, IMAGE_CONSTANTS, IMAGER_LAYERS, INITIAL_LAYERS
    from glsim.noise.registry import find_stage, stage_names

    check_uniforms(source)
    known = {*INITIAL_LAYERS, *FINE_LAYERS, *IMAGE_CONSTANTS, *IMAGER_LAYERS}
    for _, stage in each_usable(stage_names(), find_stage):
        known |= {layer.name for layer in stage.source.writes} if stage.source else set()
    for name in sorted({*source.reads} - known):
        raise ConfigError(
            f"{source.file}: reads the layer {name!r}, which no stage of glsim writes "
            f"({did_you_mean(name, known)}); with a stage of yours that does, try the sensor"
        )


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
