"""Run the validation sheet of a sensor."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import moderngl

from glsim.gl.context import open_context
from glsim.plugins import load_plugin, plugin_names, shipped_objects
from glsim.sensors.sensor import Sensor
from glsim.validate.captures import Captures
from glsim.validate.report import (
    Check,
    CheckFunction,
    Measurement,
    ValidationReport,
    match_measurements,
)
from glsim.validate.virtual_camera import VirtualCamera

#: Sensors with a sheet of their own -> device or authors of its checks. Other sensors, unless a
#: plug-in has checks of them, are checked as the first.
_TITLES: Final = {
    "kinect-v2": "Kinect V2",
    "kinect-v1": "Kinect V1",
    "kinect-v2-paper": "Kendrick et al.",
    "azure-kinect": "Azure Kinect",
    "realsense-d435": "RealSense D4xx",
    "truedepth": "TrueDepth",
    "kinect-v1-pattern": "Kinect V1, real frames",
}


@dataclass(frozen=True)
class ValidationSheet:
    """Checks and the functions that measure them.

    Args:
        title: device or authors of the checks.
    """

    title: str
    checks: tuple[Check, ...]
    functions: tuple[CheckFunction, ...]


@cache
def sheets() -> dict[str, ValidationSheet]:
    """Return the sheets by name of the sensor: the checks of glsim and of other packages."""
    functions = shipped_objects("validate/checks", _is_check)
    functions += [load_plugin("checks", name, _is_check) for name in plugin_names("checks")]
    names = dict.fromkeys([*_TITLES, *(function.sheet for function in functions)])
    return {name: _sheet(name, [f for f in functions if f.sheet == name]) for name in names}


def _sheet(name: str, functions: Sequence[Any]) -> ValidationSheet:
    checks = sorted((c for f in functions for c in f.checks), key=lambda c: _order(c.number))
    return ValidationSheet(_TITLES.get(name, name), tuple(checks), tuple(functions))


def _is_check(value: Any) -> bool:
    return callable(value) and isinstance(getattr(value, "checks", None), tuple)


def _order(number: str) -> tuple[str, int, str]:
    """Return a key that sorts 2 before 10 before A1."""
    letters = number.rstrip("0123456789")
    return letters, int(number[len(letters) :] or 0), number


def sensor_sheet(name: str) -> ValidationSheet:
    """Return the sheet of a sensor by name: its own, or the Kinect V2's."""
    return sheets().get(name, sheets()["kinect-v2"])


def sheet_of(sensor: Sensor) -> ValidationSheet:
    """Return the sheet of a sensor: its own, or that of the cameras that measure as it does."""
    if sensor.name not in sheets() and sensor.rig.imagers_m:
        alike = "realsense-d435" if len(sensor.rig.imagers_m) > 1 else "kinect-v1-pattern"
        return sensor_sheet(alike)
    return sensor_sheet(sensor.name)


def validate_sensor(
    sensor: str,
    *,
    seed: int = 0,
    frames: int = 64,
    backend: str | None = None,
    context: moderngl.Context | None = None,
) -> ValidationReport:
    """Run all checks of a sensor: a shipped name or a .toml file.

    A sensor without a sheet of its own is checked as a D435 if it has two imagers, as
    kinect-v1-pattern if it has one, and otherwise as a Kinect V2.

    Raises what simulate raises.

    Args:
        frames: number of frames of each wall; more make the numbers more precise.
    """
    own_context = open_context(backend) if context is None else None
    used_context = context or own_context
    assert used_context is not None
    try:
        return run_checks(Captures(VirtualCamera(sensor, used_context, seed, frames)))
    finally:
        if own_context is not None:
            own_context.release()


def run_checks(captures: Captures) -> ValidationReport:
    """Run the sheet of the sensor of these captures."""
    started = time.perf_counter()
    camera = captures.camera
    sheet = sheet_of(camera.sensor)
    measurements: dict[str, Measurement] = {}
    for function in sheet.functions:
        measurements |= function(captures)
    return ValidationReport(
        camera.name,
        camera.sensor.title,
        sheet.title,
        camera.seed,
        camera.frames,
        time.perf_counter() - started,
        match_measurements(sheet.checks, measurements),
    )
