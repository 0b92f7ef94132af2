"""Slider definitions from declared parameters: range, step, scale and start values."""

from __future__ import annotations

import math
from dataclasses import dataclass

from glsim.gl.declarations import Parameter
from glsim.noise.stage import ENABLED, Stage
from glsim.settings.distribution import Distribution
from glsim.settings.schema import Settings

#: Number of steps of a slider: about one per pixel of its track.
_STEPS = 200
#: A slider shows a declared range up to this multiple of the larger of default and value, unless
#: the parameter's note gives the slider's range: [0, 65535] counts is a limit, not a useful range.
_SPAN = 5.0


@dataclass(frozen=True)
class Control:
    """A value that the user can change with a slider.

    Attributes:
        name: name in ``--set name=value``.
        log_scale: whether the slider's position is the logarithm to base 10.
        off: whether the sensor has no such value until the slider is moved from ``start``.
        own_step: step in the parameter's declaration; 0: none.
    """

    name: str
    label: str
    kind: str
    low: float
    high: float
    least: float
    most: float
    unit: str
    help: str
    start: Distribution
    log_scale: bool = False
    off: bool = False
    own_step: float = 0.0

    @property
    def step(self) -> float:
        """Step of the slider: the declared step, or a round number."""
        if self.own_step:
            return self.own_step
        if self.kind == "int":
            return 1.0
        least, most = (math.log10(v) if self.log_scale else v for v in (self.least, self.most))
        if most <= least:
            return 0.01
        exact = (most - least) / _STEPS
        power = 10.0 ** math.floor(math.log10(exact))
        return float(f"{next(m for m in (1, 2, 5, 10) if m * power >= exact * 0.999) * power:.6g}")

    def position(self, value: float) -> float:
        """Convert a value to a position of the slider."""
        return math.log10(max(value, self.least)) if self.log_scale else value

    def value(self, position: float) -> float:
        """Convert a position of the slider to a value."""
        exact = 10.0**position if self.log_scale else position
        return float(f"{min(max(exact, self.low), self.high):.5g}")


def stage_controls(stage: Stage) -> list[Control]:
    """Return the controls of a stage's parameters, in the order of their declaration."""
    return [
        parameter_control(f"{stage.name}.{name}", parameter, stage.settings[name])
        for name, parameter in stage.spec.parameters.items()
        if name != ENABLED
    ]


def parameter_control(name: str, parameter: Parameter, start: Distribution) -> Control:
    """Return the control of a declared parameter."""
    low, high = parameter.low, parameter.high
    least, most = parameter.slider or _shown(parameter, start)
    return Control(
        name, parameter.name, parameter.type, low, high, least, most,
        "" if parameter.unit == "1" else parameter.unit, parameter.help, start,
        parameter.log_scale and least > 0, own_step=parameter.step,
    )  # fmt: skip


def _shown(parameter: Parameter, start: Distribution) -> tuple[float, float]:
    """Choose the ends of a slider, narrower than a declared range that is far too wide."""
    size = max(abs(parameter.default), *(abs(v) for v in start.bounds()))
    if size == 0 or parameter.type == "bool" or parameter.log_scale:
        return parameter.low, parameter.high
    span = _SPAN * size
    if parameter.type == "float":
        power = 10.0 ** math.floor(math.log10(span))
        span = math.ceil(span / power) * power
    else:
        span = max(math.ceil(span), 8)
    return max(parameter.low, -span), min(parameter.high, span)


def pose_controls(settings: Settings) -> list[Control]:
    """Return the controls of the pose and of the wall behind the face."""
    rows = (
        ("distance_mm", 100.0, 20000.0, 400.0, 4500.0, "mm"),
        ("yaw_deg", -180.0, 180.0, -90.0, 90.0, "deg"),
        ("pitch_deg", -90.0, 90.0, -45.0, 45.0, "deg"),
        ("roll_deg", -180.0, 180.0, -45.0, 45.0, "deg"),
        ("x_mm", -5000.0, 5000.0, -500.0, 500.0, "mm"),
        ("y_mm", -5000.0, 5000.0, -500.0, 500.0, "mm"),
        ("motion", 0.0, 5.0, 0.0, 2.0, ""),
    )
    fields = type(settings.pose).model_fields
    return [
        Control(
            f"pose.{name}", name, "float", low, high, least, most, unit,
            fields[name].description or "", getattr(settings.pose, name),
        )
        for name, low, high, least, most, unit in rows
    ]  # fmt: skip


def wall_control(settings: Settings) -> Control:
    """Return the control of the wall behind the face; it is off if there is no wall."""
    start = settings.scene.wall_mm or Distribution(constant=1500.0)
    return Control(
        "scene.wall_mm", "wall_mm", "float", 100.0, 12000.0, 1000.0, 4500.0, "mm",
        "distance of a wall behind the face", start, off=settings.scene.wall_mm is None,
    )  # fmt: skip
