"""Noise stages: their declaration, their settings, and the values sampled for a frame.

A stage is a GLSL file, or a Python function "file.py:function" or "package.module:function". Python
stages run on arrays, after the shaders:

    @array_stage(min_area_px=("int", 20, 1, 100000, "px", "smallest island that is kept"))
    def despeckle(view, layers, p):
        ...
        return {"depth": depth, "reason": reason}

If the function reads neighbouring pixels, the first argument of ``array_stage`` is their largest
distance, pixels, as a function of p. ``glsim.noise.registry`` finds stages by name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from glsim.core.array_types import Floats
from glsim.core.errors import ConfigError, ShaderError, did_you_mean
from glsim.gl.declarations import Parameter, slider_of
from glsim.gl.shader_source import ShaderSource
from glsim.noise.frame_context import FrameContext, Layers
from glsim.settings.distribution import Distribution, ScopeSeeds, constant

#: A stage on arrays: (view of the frame, its layers, the parameters' values) -> the layers that it
#: writes, by name.
ArrayFunction = Callable[[FrameContext, Layers, Mapping[str, float]], Mapping[str, Floats]]
#: Distance, pixels, at which a stage on arrays reads neighbours: a function of the parameters.
Reach = Callable[[Mapping[str, float]], int]
#: The parameter of every stage that switches it off: ``--set axial.enabled=false``.
ENABLED = "enabled"
#: Pattern of the names of stages, which occur in names of parameters and files, and in the tuner.
_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
_ENABLED = Parameter(ENABLED, "bool", 1.0, 0.0, 1.0, "1", "whether the stage runs", Path(), 0)
#: One frame's parameter values: stage name -> parameter -> value.
StageValues = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class StageSpec:
    """The declaration of a stage with either a GLSL ``source`` or a ``function`` on arrays.

    Args:
        title: one line for tables.
        reach_px: distance, pixels, at which ``function`` reads neighbours.
        array_reads: layers that ``function`` reads besides the layers of a Frame.
    """

    name: str
    title: str
    parameters: Mapping[str, Parameter]
    file: str
    source: ShaderSource | None = None
    function: ArrayFunction | None = None
    reach_px: Reach = lambda _: 0
    array_reads: tuple[str, ...] = ()


@dataclass(frozen=True)
class Stage:
    """A stage of a chain: its unique name, its declaration, and parameter -> distribution."""

    name: str
    spec: StageSpec
    settings: Mapping[str, Distribution]


def array_stage(
    reach_px: Reach = lambda _: 0,
    reads: tuple[str, ...] = ("normal", "albedo", "lit"),
    /,
    **parameters: tuple[str, float, float, float, str, str]
    | tuple[str, float, float, float, str, str, str],
) -> Callable[[ArrayFunction], ArrayFunction]:
    """Declare a function as a stage; a parameter is name=(type, default, low, high, unit, help).

    An optional seventh word configures the slider, as in GLSL after the semicolon: "0, 2000",
    "log", "step 2".

    Args:
        reach_px: distance, pixels, of the neighbours it reads: the margin of drawn crops.
        reads: layers that the function reads besides clean, depth, reason and infrared. A
            layer that the chain lacks is left out.
    """

    def mark(function: ArrayFunction) -> ArrayFunction:
        code = function.__code__
        declared = {
            name: array_parameter(name, spec, Path(code.co_filename), code.co_firstlineno)
            for name, spec in parameters.items()
        }
        function.stage_parameters = declared  # type: ignore[attr-defined]
        function.stage_reach_px = reach_px  # type: ignore[attr-defined]
        function.stage_reads = reads  # type: ignore[attr-defined]
        return function

    return mark


def array_parameter(name: str, spec: Sequence[Any], file: Path, line: int) -> Parameter:
    """Make the parameter of a stage on arrays that is declared in a line of a file.

    ``spec`` is type, default, low, high, unit, help, and optionally the slider's configuration.
    Raises ShaderError, TypeError or ValueError for other values.
    """
    kind, default, low, high, unit, help, *slider = spec
    default, low, high = float(default), float(low), float(high)
    (of_slider,) = slider or (None,)
    shown = slider_of(of_slider, low, high, f"{file}:{line}: parameter {name!r}")
    return Parameter(name, str(kind), default, low, high, str(unit), str(help), file, line, *shown)


def make_stage(
    name: str, spec: StageSpec, settings: Mapping[str, Distribution], where: str,
    elsewhere: Iterable[str] = (),
) -> Stage:  # fmt: skip
    """Check the settings of a stage and add defaults. Raises ConfigError, which names ``where``.

    ``elsewhere``: names of other stages' parameters, STAGE.PARAMETER, to propose for unknown ones.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"{where}: {name!r:.80} is no name of a stage: take letters, digits, _ and -, with "
            'name = "..."'
        )
    if ENABLED in spec.parameters:
        raise ShaderError(f"{spec.file}: the parameter name {ENABLED!r} is taken")
    known = [*spec.parameters, ENABLED]
    for key, setting in settings.items():
        if key not in known:
            raise ConfigError(
                f"{where}: no such parameter {key!r} of stage {name!r} "
                f"({did_you_mean(key, known, elsewhere=elsewhere)})"
            )
        parameter = spec.parameters.get(key, _ENABLED)
        for value in setting.bounds():
            whole = round(value) if parameter.type != "float" and not setting.is_constant else value
            if problem := parameter.problem(whole):
                raise ConfigError(f"{where}: {name}.{key}: {problem} ({parameter.help})")
    defaults = {key: constant(parameter.default) for key, parameter in spec.parameters.items()}
    return Stage(name, spec, {ENABLED: constant(1.0), **defaults, **settings})


def sample_values(
    stages: Sequence[Stage], seeds: ScopeSeeds
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Sample all stages' values of a frame: those not constant, and all. Raises ConfigError."""
    sampled: dict[str, float] = {}
    values: dict[str, dict[str, float]] = {stage.name: {} for stage in stages}
    for stage in stages:
        for name, setting in stage.settings.items():
            key = f"{stage.name}.{name}"
            value = setting.sample(seeds, key)
            parameter = stage.spec.parameters.get(name, _ENABLED)
            if parameter.type != "float":
                value = float(round(value))
            if problem := parameter.problem(value):
                raise ConfigError(f"{key}: {problem}")
            values[stage.name][name] = value
            if not setting.is_constant:
                sampled[key] = value
    return sampled, values
