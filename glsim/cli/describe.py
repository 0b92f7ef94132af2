"""``glsim sensors``, ``glsim stages``, ``glsim info``: what there is."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from glsim.cli.common import Debug, Quiet, Verbose
from glsim.errors import ConfigError, DeviceError

SENSORS_EXAMPLES = """
[bold]Examples[/bold]

glsim sensors

glsim render face.obj --sensor my_sensor.toml
"""
STAGES_EXAMPLES = """
[bold]Examples[/bold]

glsim stages

glsim stages axial

glsim stages my_noise.glsl
"""
INFO_EXAMPLES = """
[bold]Examples[/bold]

glsim info

GLSIM_BACKEND=osmesa glsim info
"""


def _print(table: Table) -> None:
    # Piped output keeps its full width, so that nothing is cut for grep.
    out = Console(highlight=False)
    (out if out.is_terminal else Console(width=200, highlight=False)).print(table)


def sensors(quiet: Quiet = False, verbose: Verbose = False, debug: Debug = False) -> None:
    """List the sensors that come with glsim, with their noise stages."""
    from glsim.sensor import load_sensor, sensor_names

    table = Table("sensor", "image", "focal px", "baseline", "what it is", "stages", box=None)
    for name in sensor_names():
        sensor = load_sensor(name)
        image = sensor.rig.intrinsics
        off = {s.name for s in sensor.stages if s.settings["enabled"].bounds() == (0.0, 0.0)}
        table.add_row(
            name,
            f"{image.width}x{image.height}",
            f"{image.fx:g}",
            f"{sensor.rig.baseline_m * 1000:g} mm" if sensor.rig.emitters else "none",
            sensor.title,
            ", ".join(f"({s.name})" if s.name in off else s.name for s in sensor.stages),
        )
    _print(table)


def stages(
    name: Annotated[
        str | None, typer.Argument(help="A shipped stage, a .glsl file, or file.py:function.")
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """List the noise stages and their parameters, read from the GLSL itself."""
    from glsim.noise.stage import find, shipped

    if name is None:
        table = Table("stage", "parameter", "type", "default", "range", "unit", box=None)
        for spec in shipped().values():
            for number, p in enumerate(spec.parameters.values()):
                bounds = "" if p.type == "bool" else f"{p.low:g} to {p.high:g}"
                first = spec.name if number == 0 else ""
                table.add_row(first, p.name, p.type, f"{p.default:g}", bounds, _unit(p.unit))
            if not spec.parameters:
                table.add_row(spec.name, "(none)")
        _print(table)
        return
    spec = find(name)
    out = Console(highlight=False)
    out.print(f"[bold]{spec.title}[/bold]")
    out.print(f"file: {spec.file}", soft_wrap=True)
    if spec.source is not None:
        out.print(f"reads: {', '.join(spec.source.reads)}")
        out.print(f"writes: {', '.join(layer.name for layer in spec.source.writes)}")
    table = Table("parameter", "type", "default", "range", "unit", "help", "declared at", box=None)
    for p in spec.parameters.values():
        bounds = "" if p.type == "bool" else f"{p.low:g} to {p.high:g}"
        where = f"{p.file}:{p.line}"
        table.add_row(p.name, p.type, f"{p.default:g}", bounds, _unit(p.unit), p.help, where)
    table.add_row("enabled", "bool", "1", "", "", "0 leaves the stage out", "every stage has it")
    _print(table)


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def info(quiet: Quiet = False, verbose: Verbose = False, debug: Debug = False) -> None:
    """Show the OpenGL back ends, their drivers, and what to install where one is missing."""
    from importlib.metadata import version

    import glsim.gl.context as gl

    chosen = gl.chosen_backend()
    table = Table("backend", "state", "renderer", "version", "vendor", box=None)
    working = []
    for backend in gl.BACKENDS:
        try:
            context = gl.open_context(backend)
        except DeviceError as error:
            table.add_row(backend, "missing", f"install: {gl.INSTALL_HINT[backend]}", str(error))
            continue
        driver = gl.describe(context)
        context.release()
        working.append(backend)
        state = "used" if backend == (chosen or working[0]) else "works"
        table.add_row(backend, state, driver["renderer"], driver["version"], driver["vendor"])
    out = Console(highlight=False)
    packages = ("glsim", "moderngl", "numpy", "opencv-contrib-python-headless", "trimesh")
    out.print(", ".join(f"{package} {version(package)}" for package in packages), soft_wrap=True)
    _print(table)
    for number, device in enumerate(gl.egl_devices()):
        out.print(f"EGL device {number}: {device}", soft_wrap=True)
    if not working:
        raise DeviceError("no OpenGL back end works: install one of the packages above")
    if chosen is not None and chosen not in working:
        raise ConfigError(f"GLSIM_BACKEND={chosen} does not work here; these do: {working}")
