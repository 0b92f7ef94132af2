"""Find noise stages by name: shipped stages, plug-ins, GLSL files, and Python functions.

A sensor file that names a Python function decides what code runs on this machine. This code runs
only when frames are made, with a warning that names it, not by ``describe_stage``.
"""

from __future__ import annotations

import ast
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from glsim.core.errors import ConfigError, ShaderError, did_you_mean
from glsim.core.files.regular import read_regular
from glsim.core.plugins import load_plugin, plugin_errors, plugin_file, plugin_names
from glsim.core.user_code import load_object
from glsim.gl.includes import SHADER_ROOT
from glsim.gl.shader_source import load_source, parse_source
from glsim.noise import array_stages, realsense_filters, stereo_matching
from glsim.noise.stage import StageSpec, array_parameter

#: Folders of the shipped shader stages, inside shaders/.
STAGE_FOLDERS = ("noise", "tof", "stereo")

#: The modules of the shipped array stages; ``__all__`` of a module names its stages.
ARRAY_MODULES = (array_stages, realsense_filters, stereo_matching)


@lru_cache(maxsize=1)
def _shipped() -> dict[str, Path | ModuleType]:
    """Return the stages of glsim: name -> GLSL file or Python module."""
    files = [f for folder in STAGE_FOLDERS for f in sorted((SHADER_ROOT / folder).glob("*.glsl"))]
    arrays = {name: module for module in ARRAY_MODULES for name in module.__all__}
    return {file.stem: file for file in files} | arrays


@cache
def shipped_stage(name: str) -> StageSpec | None:
    """Return the shipped stage of this name, or None. It needs no OpenGL."""
    place = _shipped().get(name)
    if isinstance(place, ModuleType):
        return _array_spec(name, getattr(place, name), place.__file__ or "")
    return None if place is None else shader_stage(place)


def shipped_stages() -> dict[str, StageSpec]:
    """Return all shipped stages: name -> stage."""
    return {name: spec for name in _shipped() if (spec := shipped_stage(name)) is not None}


def stage_names() -> list[str]:
    """Return the names of the shipped stages and of installed plug-ins."""
    return [*_shipped(), *plugin_names("stages", _shipped())]


def find_stage(use: str, beside: Path | None = None) -> StageSpec:
    """Return the stage for the word ``use`` of a sensor file. Raises ConfigError, ShaderError.

    ``use`` is the name of a shipped stage or a plug-in, a .glsl file, or "module:function".
    Relative paths start in ``beside``, by default the working directory.
    """
    if (shipped := shipped_stage(use)) is not None:
        return shipped
    if is_code(use):
        return _python_spec(use, beside)
    if use.endswith(".glsl"):
        file = (beside or Path()) / use
        if not file.exists():
            raise ConfigError(f"{file.name}: no such file in {file.absolute().parent}")
        return shader_stage(file)
    if use in plugin_names("stages", _shipped()):
        return _plugin_spec(use)
    raise ConfigError(
        f"no such stage {use!r} ({did_you_mean(use, stage_names())}; "
        "your own: a path that ends in .glsl, or file.py:function)"
    )


def is_code(use: str) -> bool:
    """Return whether the word ``use`` of a sensor file names a Python function; no code is run."""
    return use not in _shipped() and ":" in use and not use.endswith(".glsl")


def describe_stage(use: str) -> StageSpec:
    """Return the same stage as ``find_stage``, read from its text without running a .py file."""
    target, _, name = use.rpartition(":")
    return declared_stage(Path(target), name) if target.endswith(".py") else find_stage(use)


def shader_stage(file: Path, text: str | None = None) -> StageSpec:
    """Make a stage of a GLSL file; ``text`` replaces its content. Raises ShaderError, with line."""
    source = load_source(file) if text is None else parse_source(text, file)
    if not source.writes:
        raise ShaderError(f"{file}: the stage writes no layer: declare e.g. 'out float depth;'")
    if len({layer.scale for layer in source.writes}) > 1:
        raise ShaderError(f"{file}: all layers that a stage writes must have the same size")
    return StageSpec(file.stem, source.title, source.parameters, str(file), source=source)


def _array_spec(name: str, function: Any, file: str) -> StageSpec:
    parameters = getattr(function, "stage_parameters", None)
    if parameters is None:
        raise ConfigError(f"{file}: {name} is not a stage: decorate it with @array_stage(...)")
    title = (function.__doc__ or name).strip().splitlines()[0]
    return StageSpec(
        name, f"{name}: {title}", parameters, file,
        function=function, reach_px=function.stage_reach_px, array_reads=function.stage_reads,
    )  # fmt: skip


def _plugin_spec(name: str) -> StageSpec:
    shader = f"{name}.glsl"

    def valid(found: object) -> bool:
        return hasattr(found, "stage_parameters") or plugin_file(found, shader) is not None

    found = load_plugin("stages", name, valid)
    if (file := plugin_file(found, shader)) is not None:
        return shader_stage(file)
    with plugin_errors("stages", name):
        return _array_spec(name, found, str(found.__module__))


def _python_spec(use: str, beside: Path | None) -> StageSpec:
    try:
        function, _ = load_object(use, beside)
    except ConfigError as error:
        raise ConfigError(f"stage {use!r}: {error}") from error
    target, _, name = use.rpartition(":")
    return _array_spec(name, function, target)


#: Largest file, bytes: a stage is about one page of code.
_MAX_BYTES = 1 << 20


def declared_stage(file: Path, name: str) -> StageSpec:
    """Read the title and the parameters of a Python stage from its file, without running it.

    Raises ConfigError if the file cannot be read, or has no function ``name`` with a decorator
    ``@array_stage(...)`` whose parameters are literal values.
    """
    where = f"stage '{file}:{name}'"
    try:
        tree = ast.parse(read_regular(file, _MAX_BYTES))
    except OSError as error:
        raise ConfigError(f"{where}: {error.strerror or error}") from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ConfigError(f"{where}: is no Python file: {error}") from None
    functions = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name]
    if not functions:
        raise ConfigError(f"{where}: the file has no function {name!r}")
    calls = [d for d in functions[-1].decorator_list if isinstance(d, ast.Call)]
    names = [ast.unparse(call.func).rpartition(".")[2] for call in calls]
    if "array_stage" not in names:
        raise ConfigError(f"{file}: {name} is not a stage: decorate it with @array_stage(...)")
    parameters = {}
    for keyword in calls[names.index("array_stage")].keywords:
        parameter, line = str(keyword.arg), keyword.value.lineno
        try:
            spec = ast.literal_eval(keyword.value)
            parameters[parameter] = array_parameter(parameter, spec, file, line)
        except (ValueError, TypeError):
            raise ConfigError(
                f"{file}:{line}: the parameter {parameter!r} is not written out "
                'as ("float", default, low, high, "unit", "help")'
            ) from None
    title = (ast.get_docstring(functions[-1]) or name).strip().splitlines()[0]
    return StageSpec(name, f"{name}: {title}", parameters, str(file))
