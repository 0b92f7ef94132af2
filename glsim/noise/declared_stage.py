"""Read the declaration of a Python stage from the text of its file, without running the file."""

from __future__ import annotations

import ast
from pathlib import Path

from glsim.errors import ConfigError
from glsim.files.regular import read_regular
from glsim.noise.stage import StageSpec, array_parameter

#: Largest file, bytes: a stage is a page of code.
_MAX_BYTES = 1 << 20


def declared_stage(file: Path, name: str) -> StageSpec:
    """Return a stage without its function: title and parameters, to list them.

    Raises ConfigError if the file cannot be read or has no function ``name`` with a decorator
    ``@array_stage(...)`` whose parameters are written out as plain values.
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
    declared = next((call for call in calls if _is_array_stage(call.func)), None)
    if declared is None:
        raise ConfigError(f"{file}: {name} is not a stage: decorate it with @array_stage(...)")
    parameters = {}
    for keyword in declared.keywords:
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


def _is_array_stage(function: ast.expr) -> bool:
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    return name == "array_stage"
