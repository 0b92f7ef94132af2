"""Load an object from the user's code, named "module:object" or "file.py:object"."""

from __future__ import annotations

import importlib
import logging
import sys
from functools import lru_cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from glsim.core.errors import ConfigError, one_line

log = logging.getLogger(__name__)


def load_object(target: str, folder: Path | None = None) -> tuple[Any, Path | None]:
    """Import an object from a module or a Python file, and return it with its code's file.

    A warning names the code before it is run. ``target`` is "module:object", where the module may
    be in the working directory, or "file.py:object", where the file is in ``folder``, by default
    the working directory. Raises ConfigError if the code fails or has no such object.
    """
    code, _, name = target.rpartition(":")
    try:
        if code.endswith(".py"):
            module = _import_file((folder or Path()) / code)
        else:
            if (here := str(Path.cwd())) not in sys.path:
                sys.path.append(here)
            _announce(code)
            module = importlib.import_module(code)
        found = getattr(module, name, None)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the user's code may raise anything, or exit
        raise ConfigError(f"{code} cannot be imported: {one_line(error)}") from error
    if found is None:
        raise ConfigError(f"{code} has no {name!r}")
    file = getattr(module, "__file__", None)
    return found, None if file is None else Path(file)


def _import_file(path: Path) -> ModuleType:
    """Run a Python file as a module, each time again, because it may have changed."""
    _announce(str(path))
    spec = spec_from_file_location(f"glsim_user_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError("not a Python file")
    module = sys.modules[spec.name] = module_from_spec(spec)  # data classes search it there
    spec.loader.exec_module(module)
    return module


@lru_cache(maxsize=1000)  # one warning a process, however often the code is loaded
def _announce(target: str) -> None:
    log.warning("runs code of %s: name only files whose author you trust", target)
