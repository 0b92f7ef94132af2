"""What a link may name: a person who sends one must not reach files or run code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from glsim.errors import ConfigError
from glsim.sensors.inheritance import RIG_FILES
from glsim.sensors.sensor import sensor_code, sensor_names
from glsim.settings.schema import Settings
from glsim.tune.state import Tuning


def check_link(tuning: Tuning, own_sensor: str, folder: Path) -> None:
    """Raise ConfigError for a link that names a file outside of a folder.

    Args:
        own_sensor: the sensor that the command names, which may lie anywhere.
        folder: where the command was started.
    """
    if tuning.sensor not in (own_sensor, *sensor_names()):
        _check_inside(tuning.sensor, folder)
    for name, value in tuning.values.items():
        if any(key in name for key in RIG_FILES) and isinstance(value, str):
            _check_inside(value, folder)
        elif name == "rig" or name.split(".")[0] in ("source", "output", "sensor"):
            raise ConfigError(f"the link sets {name}, which the page does not change")


def _check_inside(file: str, folder: Path) -> None:
    try:
        inside = (folder / file).resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError):
        inside = False
    if not inside:
        raise ConfigError(
            f"the link names {file!r:.200}, outside of {folder}: start glsim tune with that sensor"
        )


def code_of(tuning: Tuning, base: Settings, own_sensor: str) -> list[str]:
    """Return the Python stages that a tuning's sensor would run; nothing of it is run.

    Those of the sensor that the command names are not listed. Raises ConfigError if its file cannot
    be read.
    """
    if tuning.sensor == own_sensor:
        return []
    changed: dict[str, Any] = {"sensor": tuning.sensor}
    return sensor_code(base.model_copy(update=changed))
