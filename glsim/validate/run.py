"""Runs the sheet that belongs to a sensor."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import moderngl

from glsim.gl.context import open_context
from glsim.validate import depth, edges, heads, phases, structured, walls
from glsim.validate.bench import Bench
from glsim.validate.lab import Lab
from glsim.validate.report import Check, Measured, Report, complete
from glsim.validate.sheet_structured import KINECT_V1, KINECT_V2_PAPER
from glsim.validate.sheet_v2 import ANTI_CHECKS, CHECKS

Examination = Callable[[Lab], dict[str, Measured]]

_V2: tuple[Examination, ...] = (
    walls.noise_level,
    walls.tilt,
    walls.albedo,
    walls.amplitude,
    walls.correlations,
    walls.radial,
    walls.pattern,
    walls.exponent,
    walls.skin,
    phases.phases,
    edges.mixed,
    edges.silhouette,
    edges.shadows,
    depth.quantisation,
    depth.validity,
    depth.ranges,
    depth.wiggle,
    depth.unwrapping,
    depth.offsets,
    heads.heads,
)

_V1: tuple[Examination, ...] = (
    structured.v1_noise,
    structured.v1_steps,
    structured.v1_shadow,
    structured.v1_range,
)

_PAPER: tuple[Examination, ...] = (
    structured.paper_noise,
    structured.paper_window,
    structured.paper_geometry,
)


@dataclass(frozen=True)
class Sheet:
    """Checks and what measures them. title: whose they are."""

    title: str
    checks: tuple[Check, ...]
    examinations: tuple[Examination, ...]


_KINECT_V2 = Sheet("Kinect V2", (*CHECKS, *ANTI_CHECKS), _V2)

#: Sensors with a sheet of their own, by name of their file; all others have the Kinect V2's.
SHEETS: dict[str, Sheet] = {
    "kinect-v1": Sheet("Kinect V1", KINECT_V1, _V1),
    "kinect-v2-paper": Sheet("Kendrick et al.", KINECT_V2_PAPER, _PAPER),
}


def validate(
    sensor: str,
    *,
    seed: int = 0,
    frames: int = 64,
    backend: str | None = None,
    context: moderngl.Context | None = None,
) -> Report:
    """Run all checks of a sensor, a shipped one or a file; the Kinect V2's, if it has no sheet.

    frames: of each wall; more make the numbers surer, not different. Raises what simulate raises.
    """
    own_context = open_context(backend) if context is None else None
    drawn_in = context or own_context
    assert drawn_in is not None
    try:
        return examine(Lab(Bench(sensor, drawn_in, seed, frames)))
    finally:
        if own_context is not None:
            own_context.release()


def examine(lab: Lab) -> Report:
    """Run the sheet of a lab's sensor."""
    started = time.perf_counter()
    sheet = SHEETS.get(lab.bench.sensor.name, _KINECT_V2)
    found: dict[str, Measured] = {}
    for examination in sheet.examinations:
        found |= examination(lab)
    seconds = time.perf_counter() - started
    bench = lab.bench
    return Report(
        bench.name,
        bench.sensor.title,
        sheet.title,
        bench.seed,
        bench.frames,
        seconds,
        complete(sheet.checks, found),
    )
