"""``glsim sensors``: list the sensors."""

from __future__ import annotations

from rich.table import Table

from glsim.cli.common import print_table

EXAMPLES = """
[bold]Examples[/bold]

glsim sensors

glsim render face.obj --sensor my_sensor.toml
"""


def sensors() -> None:
    """List the sensors, shipped and of installed packages, with their noise stages.

    Stages in brackets are switched off.
    """
    from glsim.sensors.sensor import load_sensor, sensor_names

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
