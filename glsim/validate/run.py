"""Run the validation sheet of a sensor."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import moderngl

from glsim.errors import ConfigError
from glsim.gl.context import open_context
from glsim.validate.captures import Captures
from glsim.validate.checks import depth, edges, faces, phases, structured_light, walls
from glsim.validate.report import Check, Measurement, ValidationReport, match_measurements
from glsim.validate.sheets.kinect_v2 import ANTI_CHECKS, CHECKS
from glsim.validate.sheets.structured_light import KINECT_V1, KINECT_V2_PAPER
from glsim.validate.virtual_camera import VirtualCamera

CheckFunction = Callable[[Captures], dict[str, Measurement]]

_V2: tuple[CheckFunction, ...] = (
    walls.noise_level,
    walls.tilt,
    walls.albedo,
    walls.amplitude,
    walls.correlations,
    walls.radial,
    walls.pattern,
    walls.exponent,
    walls.skin,
    phases.phase_noise,
    edges.mixed_pixels,
    edges.silhouette,
    edges.shadows,
    depth.quantisation,
    depth.validity,
    depth.ranges,
    depth.wiggle,
    depth.unwrapping,
    depth.offsets,
    faces.isolated_faces,
)

_V1: tuple[CheckFunction, ...] = (
    structured_light.v1_noise,
    structured_light.v1_steps,
    structured_light.v1_shadow,
    structured_light.v1_range,
)

_PAPER: tuple[CheckFunction, ...] = (
    structured_light.paper_noise,
    structured_light.paper_window,
    structured_light.paper_geometry,
)


@dataclass(frozen=True)
class ValidationSheet:
    """Checks and the functions that measure them. title: device or authors of the checks."""

    title: str
    checks: tuple[Check, ...]
    functions: tuple[CheckFunction, ...]


_KINECT_V2 = ValidationSheet("Kinect V2", (*CHECKS, *ANTI_CHECKS), _V2)

#: Sensors with a sheet of their own, by name of their file; all others have the Kinect V2's.
SHEETS: dict[str, ValidationSheet] = {
    "kinect-v1": ValidationSheet("Kinect V1", KINECT_V1, _V1),
    "kinect-v2-paper": ValidationSheet("Kendrick et al.", KINECT_V2_PAPER, _PAPER),
}


def sensor_sheet(name: str) -> ValidationSheet:
    """Return the sheet of a sensor by name: its own, or the Kinect V2's."""
    return SHEETS.get(name, _KINECT_V2)


#: Sensors that no published measurement with a source describes, and why.
WITHOUT_SHEET: dict[str, str] = {
    "azure-kinect": "its noise is quoted from memory and its decoder is the Kinect V2's",
}


def validate_sensor(
    sensor: str,
    *,
    seed: int = 0,
    frames: int = 64,
    backend: str | None = None,
    context: moderngl.Context | None = None,
) -> ValidationReport:
    """Run all checks of a sensor: a shipped name or a .toml file.

    A sensor without a sheet of its own is checked as a Kinect V2. frames: number of frames of each
    wall; more make the numbers more precise. Raises what simulate raises, and ConfigError for an
    experimental sensor, which has no sheet.
    """
    own_context = open_context(backend) if context is None else None
    used_context = context or own_context
    assert used_context is not None
    try:
        return run_checks(Captures(VirtualCamera(sensor, used_context, seed, frames)))
    finally:
        if own_context is not None:
            own_context.release()


def check_has_sheet(sensor: str) -> None:
    """Raise ConfigError for an experimental sensor."""
    if sensor in WITHOUT_SHEET:
        raise ConfigError(
            f"{sensor} is experimental and has no validation sheet ({WITHOUT_SHEET[sensor]}): "
            "validate kinect-v2, or a copy of its file to see it measured as a Kinect V2"
        )


def run_checks(captures: Captures) -> ValidationReport:
    """Run the sheet of the sensor of these captures. Raises ConfigError if it has none."""
    started = time.perf_counter()
    camera = captures.camera
    check_has_sheet(camera.name)
    sheet = sensor_sheet(camera.sensor.name)
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
