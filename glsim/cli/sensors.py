"""``glsim sensors``: list the sensors, or print the file of one."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from glsim.cli.common import print_table
from glsim.cli.completion import sensor_words
from glsim.errors import ConfigError
from glsim.files.atomic import write_atomic

EXAMPLES = """
[bold]Examples[/bold]

glsim sensors

glsim sensors kinect-v2

glsim sensors kinect-v2 -o my_sensor.toml

glsim render face.obj --sensor my_sensor.toml
"""


def sensors(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Print the file of this sensor, or copy it with -o.", autocompletion=sensor_words
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="New .toml file for the copy.")
    ] = None,
) -> None:
    """List the sensors, shipped and of installed packages, with their noise stages.

    Stages in brackets are switched off.
    """
    from glsim.sensors.sensor import load_sensor, sensor_file, sensor_names

    if name is not None:
        _copy(sensor_file(name), out)
        return
    if out is not None:
        raise ConfigError(f"-o {out}: name the sensor to copy, as in glsim sensors kinect-v2 -o")

    table = Table("sensor", "image", "focal px", "baseline", "description", "stages", box=None)
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
    print_table(table)


def _copy(source: Path, out: Path | None) -> None:
    """Print a sensor's file, or write it to a new one. Raises ConfigError, DatasetError."""
    from glsim.settings.tables import read_toml

    read_toml(source)  # refuses what is no readable TOML file
    text = source.read_text(encoding="utf-8")
    if out is None:
        sys.stdout.write(text)
        return
    if out.suffix != ".toml":
        raise ConfigError(f"-o {out}: give a name that ends in .toml")
    if out.exists():
        raise ConfigError(f"-o {out}: is there already: choose another name, or remove it")
    write_atomic(text.encode(), out)
