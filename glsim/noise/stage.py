"""What a noise stage is, and where stages are found.

A stage is a GLSL file, shipped (by its name) or the user's (by its path), or a Python function
"file.py:function" or "package.module:function" that runs after the shaders, on arrays:

    @array_stage(min_area_px=("int", 20, 1, 100000, "px", "smallest island that is kept"))
    def despeckle(view, layers, p):
        ...
        return {"depth": depth, "reason": reason}

One that looks at other pixels than its own says how far, as the first argument: a function of p.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.distribution import Distribution, constant
from glsim.errors import ConfigError, ShaderError, did_you_mean
from glsim.gl.source import SHADER_ROOT, Parameter, ShaderSource, load_source
from glsim.noise.view import Layers, StageView

#: A stage on arrays: the frame's view, its layers and the parameters' values to written layers.
ArrayFunction = Callable[
    [StageView, Layers, Mapping[str, float]], Mapping[str, NDArray[np.float32]]
]

#: How far around a pixel a stage on arrays looks, pixels, by its parameters' values.
Reach = Callable[[Mapping[str, float]], int]

#: Where the shipped stages are, below shaders/.
STAGE_FOLDERS = ("noise", "tof")

#: Every stage can be switched off by this name: ``--set axial.enabled=false``.
ENABLED = "enabled"
_ENABLED = Parameter(ENABLED, "bool", 1.0, 0.0, 1.0, "1", "whether the stage runs", Path(), 0)


def _own_pixel(_: Mapping[str, float]) -> int:
    return 0


@dataclass(frozen=True)
class StageSpec:
    """A kind of stage. Exactly one of ``source`` (GLSL) and ``function`` (arrays) is set.

    reach_px: of a stage on arrays.
    """

    name: str
    title: str
    parameters: Mapping[str, Parameter]
    file: str
    source: ShaderSource | None = None
    function: ArrayFunction | None = None
    reach_px: Reach = _own_pixel


@dataclass(frozen=True)
class Stage:
    """A stage in a chain, under a name of its own, with its settings."""

    name: str
    spec: StageSpec
    settings: Mapping[str, Distribution]

    def draw(self, draw: Callable[[Distribution, str], float]) -> dict[str, float]:
        """The values of all parameters for one frame, and of ``enabled``. Raises ConfigError."""
        values = {}
        for name, setting in self.settings.items():
            value = draw(setting, f"{self.name}.{name}")
            parameter = self.spec.parameters.get(name, _ENABLED)
            if parameter.type != "float":
                value = float(round(value))
            if problem := parameter.problem(value):
                raise ConfigError(f"{self.name}.{name}: {problem}")
            values[name] = value
        return values


def array_stage(
    reach_px: Reach = _own_pixel,
    /,
    **parameters: tuple[str, float, float, float, str, str],
) -> Callable[[ArrayFunction], ArrayFunction]:
    """Mark a function as a stage: name=(type, default, low, high, unit, help) a parameter.

    reach_px: how far around a pixel it looks, so that a crop is drawn with as much around it.
    """

    def mark(function: ArrayFunction) -> ArrayFunction:
        code = function.__code__
        declared = {
            name: Parameter(name, *spec, Path(code.co_filename), code.co_firstlineno)
            for name, spec in parameters.items()
        }
        function.stage_parameters = declared  # type: ignore[attr-defined]
        function.stage_reach_px = reach_px  # type: ignore[attr-defined]
        return function

    return mark


@lru_cache(maxsize=1)
def shipped() -> dict[str, StageSpec]:
    """The stages that come with glsim, by name. Text only; needs no GL."""
    from glsim.noise import array_stages

    files = [f for folder in STAGE_FOLDERS for f in sorted((SHADER_ROOT / folder).glob("*.glsl"))]
    specs = [_shader_spec(file.stem, file) for file in files]
    specs += [
        _array_spec(name, getattr(array_stages, name), array_stages.__file__ or "")
        for name in array_stages.__all__
    ]
    return {spec.name: spec for spec in specs}


def find(use: str, beside: Path | None = None) -> StageSpec:
    """The stage that ``use`` names: shipped, a .glsl file, or "module:function".

    beside: the folder that relative paths start from (default: the working directory).
    Raises ConfigError or ShaderError.
    """
    if use in shipped():
        return shipped()[use]
    if ":" in use and not use.endswith(".glsl"):
        return _python_spec(use, beside)
    if use.endswith(".glsl"):
        file = (beside / use) if beside is not None and not Path(use).is_absolute() else Path(use)
        return _shader_spec(file.stem, file)
    raise ConfigError(
        f"no such stage {use!r} ({did_you_mean(use, shipped())}; "
        "your own: a path that ends in .glsl, or file.py:function)"
    )


def make_stage(
    name: str, spec: StageSpec, settings: Mapping[str, Distribution], where: str
) -> Stage:
    """Check settings against the declarations and fill in defaults. Raises ConfigError."""
    if ENABLED in spec.parameters:
        raise ShaderError(f"{spec.file}: the parameter name {ENABLED!r} is taken")
    known = [*spec.parameters, ENABLED]
    for key, setting in settings.items():
        if key not in known:
            raise ConfigError(
                f"{where}: no such parameter {key!r} of stage {name!r} ({did_you_mean(key, known)})"
            )
        parameter = spec.parameters.get(key, _ENABLED)
        for value in setting.bounds():
            whole = round(value) if parameter.type != "float" and not setting.is_constant else value
            if problem := parameter.problem(whole):
                raise ConfigError(f"{where}: {name}.{key}: {problem} ({parameter.help})")
    filled = {key: constant(parameter.default) for key, parameter in spec.parameters.items()}
    return Stage(name, spec, {ENABLED: constant(1.0), **filled, **settings})


def _shader_spec(name: str, file: Path) -> StageSpec:
    source = load_source(file)
    if not source.writes:
        raise ShaderError(f"{file}: the stage writes no layer: declare e.g. 'out float depth;'")
    if len({layer.scale for layer in source.writes}) > 1:
        raise ShaderError(f"{file}: all layers that a stage writes must have the same size")
    return StageSpec(name, source.title, source.parameters, str(file), source=source)


def _array_spec(name: str, function: Any, file: str) -> StageSpec:
    parameters = getattr(function, "stage_parameters", None)
    if parameters is None:
        raise ConfigError(f"{file}: {name} is not a stage: decorate it with @array_stage(...)")
    title = (function.__doc__ or name).strip().splitlines()[0]
    return StageSpec(
        name, f"{name}: {title}", parameters, file,
        function=function, reach_px=function.stage_reach_px,
    )  # fmt: skip


def _python_spec(use: str, beside: Path | None) -> StageSpec:
    target, _, name = use.rpartition(":")
    try:
        module = _load_file(target, beside) if target.endswith(".py") else _load_module(target)
    except Exception as error:  # the user's code may raise anything
        raise ConfigError(f"stage {use!r}: {target} cannot be imported: {error}") from error
    function = getattr(module, name, None)
    if function is None:
        raise ConfigError(f"stage {use!r}: {target} has no {name!r}")
    return _array_spec(name, function, target)


def _load_module(name: str) -> ModuleType:
    return importlib.import_module(name)


def _load_file(target: str, beside: Path | None) -> ModuleType:
    path = Path(target) if beside is None or Path(target).is_absolute() else beside / target
    spec = importlib.util.spec_from_file_location(f"glsim_user_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError("not a Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
