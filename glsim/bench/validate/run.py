"""Runner of a sensor's validation sheet."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from glsim.bench.real_frames import told_apart
from glsim.bench.validate.captures import Captures
from glsim.bench.validate.report import (
    Band,
    Check,
    CheckFunction,
    CheckResult,
    Measurement,
    ValidationReport,
)
from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.plugins import each_usable, load_plugin, plugin_names, shipped_objects
from glsim.gl.context import borrowed_context
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.settings.toml_tables import read_toml
from glsim.simulation.virtual_camera import VirtualCamera

#: Folder with the checks of each sensor; a file is named after its sensor.
_SHEETS = Path(__file__).parent / "sheets"


@dataclass(frozen=True)
class ValidationSheet:
    """Checks of a sheet, and the functions that measure them.

    Args:
        title: name of the device, or authors of the model, that the checks describe.
        decimated_by: factor by which librealsense decimated the device's frames, and by which the
            simulated frames are decimated before they are measured.
    """

    title: str
    checks: tuple[Check, ...]
    functions: tuple[CheckFunction, ...]
    decimated_by: int = 1


@cache
def sheets() -> dict[str, ValidationSheet]:
    """Return sensor name -> sheet, with the checks of glsim and of other packages."""
    functions = shipped_objects("bench/validate/checks", _is_check)
    plugins = each_usable(plugin_names("checks"), lambda n: load_plugin("checks", n, _is_check))
    functions += [function for _, function in plugins]
    names = [file.stem for file in sorted(_SHEETS.glob("*.toml"))]
    return {
        name: _sheet(name, functions)
        for name in dict.fromkeys([*names, *(function.sheet for function in functions)])
    }


def _sheet(name: str, functions: list[Any]) -> ValidationSheet:
    """Join the checks of a sheet file and the checks that plug-in functions declare."""
    file = _SHEETS / f"{name}.toml"
    tree: dict[str, Any] = read_toml(file) if file.is_file() else {"title": name, "check": []}
    decimated_by = tree.get("decimated_by", 1)
    if "extends" in tree:  # checks of the same number replace those of the extended sheet
        base = _sheet(tree["extends"], functions)
        replaced = {table["number"]: _check(table) for table in tree["check"]}
        checks = [replaced.get(check.number, check) for check in base.checks]
        return ValidationSheet(tree["title"], tuple(checks), base.functions, decimated_by)
    functions = [f for f in functions if f.sheet == name]
    checks = [_check(table) for table in tree["check"]]
    checks += [check for function in functions for check in function.checks]
    return ValidationSheet(tree["title"], tuple(checks), tuple(functions), decimated_by)


def _sheet_of(sensor: Sensor) -> ValidationSheet:
    """Return the sheet of a sensor. Raises ConfigError if there is none."""
    known = sheets()
    if found := known.get(sensor.name, known.get(sensor.sheet)):
        return found
    if other := sensor.sheet:
        raise ConfigError(f"{sensor.file}: no sheet {other!r} ({did_you_mean(other, known)})")
    raise ConfigError(
        f"{sensor.name}: names no published measure: in the file of a camera alike, write sheet = "
        f'"NAME", one of {", ".join(known)}; in a copy of a shipped sensor, remove its #'
    )


def _check(table: dict[str, Any]) -> Check:
    unit = table.get("unit", "")
    bands = tuple(
        Band(key, low, high, *other or (unit,))
        for key, (low, high, *other) in table["bands"].items()
    )
    return Check(table["number"], table["check"], bands, table["source"], table["kind"])


def _is_check(value: Any) -> bool:
    return callable(value) and isinstance(getattr(value, "checks", None), tuple)


def validate_sensor(
    sensor: str, *, seed: int = 0, frames: int = 64, backend: str | None = None
) -> ValidationReport:
    """Run all checks of a sensor, given by a shipped name or a .toml file.

    Raises ConfigError for a sensor without a sheet, and the errors of ``simulate``.
    ``frames`` of each wall are captured; more frames give more precise numbers.
    """
    _sheet_of(load_sensor(sensor))
    with borrowed_context(backend) as context:
        return run_checks(VirtualCamera(sensor, context, seed, frames))


def run_checks(camera: VirtualCamera) -> ValidationReport:
    """Run the sheet that a camera's sensor names, or the sheet of its name.

    Raises ConfigError for a sensor without a sheet, and for a check without measurement.
    """
    started = time.perf_counter()
    sheet = _sheet_of(camera.sensor)
    captures = Captures(camera, sheet.decimated_by)
    measured: dict[str, Measurement] = {}
    for function in sheet.functions:
        measured |= function(captures)
    if missing := [check.number for check in sheet.checks if check.number not in measured]:
        raise ConfigError(f"no measurement for the checks {', '.join(missing)}")
    return ValidationReport(
        camera.name, camera.sensor.title, sheet.title, camera.seed, camera.frames,
        time.perf_counter() - started,
        tuple(CheckResult(check, measured[check.number]) for check in sheet.checks),
        told_apart(camera.sensor),
    )  # fmt: skip
