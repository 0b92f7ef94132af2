"""Denoisers from elsewhere: any Python callable, checkpoints, and the shipped network."""

from __future__ import annotations

import functools
import importlib
import importlib.resources
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from glsim.errors import DenoiserError

from .base import Method, parameter

#: Where checkpoints are opened: ``load_denoiser(path, sure) -> callable`` of the protocol. Reached
#: by name, because ``glsim.eval`` and ``glsim.train`` do not import each other.
_CHECKPOINT_MODULE = "glsim.train.denoiser"
#: Where the shipped network lies; docs/model_card.md says what it is.
_SHIPPED_PACKAGE, _SHIPPED_FILE = "glsim.train.shipped", "face.pt"


def from_callable(module: str, name: str, parameters: dict[str, str], label: str) -> Method:
    """``module:name``, with parameters as keyword arguments (numbers where they read as such).

    The module is looked for in the current folder too. A class is instantiated; an instance or
    function with ``before`` or ``after`` gets its neighbours in time. DenoiserError otherwise.
    """
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        found: Any = getattr(importlib.import_module(module), name)
    except AttributeError:
        raise DenoiserError(f"{label}: module {module} has no {name!r}") from None
    except Exception as error:
        raise DenoiserError(f"{label}: cannot import {module}: {error}") from error
    keywords = {key: _number(value) for key, value in parameters.items()}
    try:
        if isinstance(found, type):
            found = found(**keywords)
        elif keywords:
            found = functools.partial(found, **keywords)
    except Exception as error:
        raise DenoiserError(f"{label}: cannot make {name}: {error}") from error
    return as_method(label, found, _version(getattr(sys.modules[module], "__file__", None)))


@dataclass(frozen=True)
class Network:
    """What one may ask of a trained network."""

    sure: float = parameter(
        0.0, 0.0, 0.999, "keep depth that is more probable than this; 0: see --composite"
    )


def from_checkpoint(path: Path, label: str, asked: Network = Network()) -> Method:
    """A trained model. DenoiserError if the file or ``glsim.train`` is not there."""
    if not path.is_file():
        raise DenoiserError(f"{path}: no such checkpoint: give the best.pt of a run of glsim train")
    try:
        function = importlib.import_module(_CHECKPOINT_MODULE).load_denoiser(path, asked.sure)
    except ImportError as error:
        raise DenoiserError(
            f"{label}: networks need PyTorch: pip install 'glsim[train]', or choose a filter such "
            f"as -d quadric:sigma_px=2.5,cleanup=5 ({error})"
        ) from None
    return as_method(label, function, f"{_version(path)} {asked}")


def from_shipped(label: str, asked: Network) -> Method:
    """The network that comes with glsim. DenoiserError if its weights or PyTorch are not there."""
    try:
        folder = importlib.resources.files(_SHIPPED_PACKAGE)
        with importlib.resources.as_file(folder / _SHIPPED_FILE) as path:
            if path.is_file():
                return from_checkpoint(path, label, asked)
    except (ImportError, FileNotFoundError):
        pass
    raise DenoiserError(
        f"{label}: this installation has no {_SHIPPED_FILE}, the weights of the shipped network: "
        "install glsim again, or give -d and a checkpoint or filter (glsim eval --list)"
    )


def as_method(label: str, function: Any, version: str = "") -> Method:
    """A callable of either protocol. DenoiserError if it cannot be called."""
    if not callable(function):
        raise DenoiserError(f"{label}: is no function of (noisy_mm, valid)")
    before, after = (int(getattr(function, name, 0)) for name in ("before", "after"))
    temporal = hasattr(function, "before") or hasattr(function, "after")
    return Method(label, function, before, after, temporal, version)


def _version(file: Path | str | None) -> str:
    if file is None:
        return ""
    status = Path(file).stat()
    return f"{status.st_size} {status.st_mtime_ns}"


def _number(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
