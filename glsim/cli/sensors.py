"""``glsim sensors``: list the sensors, or print a sensor file."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from glsim.cli.common import (
    SENSORS,
    JsonOption,
    check_new,
    make_console,
    print_json,
    print_table,
    print_written,
)
from glsim.core.errors import ConfigError
from glsim.core.files.atomic import write_atomic
from glsim.core.units import MM_PER_M

if TYPE_CHECKING:
    from glsim.sensors.sensor import Sensor

#: Columns of a terminal below which the table would break its lines: a line per sensor instead.
_WIDE = 140


def sensors(
    name: Annotated[str | None, typer.Argument(autocompletion=SENSORS)] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    as_json: JsonOption = False,
) -> None:
    """List the shipped sensors and sensors of installed packages; print or copy one.

    Args:
        name: Print the file of this sensor, or copy it with -o.
        out: New .toml file for the copy. Default: print it.
    """
    from glsim.bench.real_frames import told_apart
    from glsim.core.plugins import each_usable
    from glsim.sensors.sensor import load_sensor, sensor_file, sensor_names

    if name is not None:
        if as_json:
            raise ConfigError(f"--json lists the sensors; the file of {name} is TOML")
        _copy(sensor_file(name), out)
        return
    if out is not None:
        raise ConfigError(f"-o {out}: name the sensor to copy, as in glsim sensors kinect-v2 -o")

    usable = each_usable(sensor_names(), load_sensor)
    if as_json:
        print_json([_described(sensor) for _, sensor in usable])
        return
    shown = make_console()
    if shown.is_terminal and shown.width < _WIDE:
        for name, sensor in usable:
            line = f"{name:<28} {sensor.title}"
            typer.echo(line if len(line) < shown.width else f"{line[: shown.width - 2]}…")
        return
    told = "told from real frames, AUC, logistic / boosted"
    table = Table("sensor", "image", "focal px", "baseline", "description", told, box=None)
    for name, sensor in usable:
        image = sensor.rig.intrinsics
        size, focal = f"{image.width}x{image.height}", f"{image.fx:g}"
        baseline = f"{sensor.rig.baseline_m * MM_PER_M:g} mm" if sensor.rig.emitters else "none"
        table.add_row(name, size, focal, baseline, sensor.title, told_apart(sensor))
    print_table(table)


def _described(sensor: Sensor) -> dict[str, Any]:
    """Return the content of the table as JSON values with units in their names."""
    image = sensor.rig.intrinsics
    off = {s.name for s in sensor.stages if s.settings["enabled"].bounds() == (0.0, 0.0)}
    return {
        "name": sensor.name,
        "title": sensor.title,
        "width_px": image.width,
        "height_px": image.height,
        "fx_px": image.fx,
        "fy_px": image.fy,
        "baseline_mm": sensor.rig.baseline_m * MM_PER_M if sensor.rig.emitters else None,
        "stages": [{"name": s.name, "enabled": s.name not in off} for s in sensor.stages],
    }


def _copy(source: Path, out: Path | None) -> None:
    """Print a sensor's file, or copy it to a new file. Raises ConfigError, DatasetError."""
    from glsim.settings.toml_tables import read_toml

    read_toml(source)  # raises ConfigError if it is no readable TOML file
    text = source.read_text(encoding="utf-8")
    if out is None:
        sys.stdout.write(text)
        return
    check_new(out)
    # A copy will be changed: it must not pass for the shipped sensor, nor be checked as that.
    text = re.sub(r'^title = "', f'title = "copy of {source.stem}: ', text, flags=re.MULTILINE)
    text = re.sub(r'^(sheet = ".+)', r"# \1", text, flags=re.MULTILINE)
    write_atomic(text.encode(), out)
    print_written([out])
