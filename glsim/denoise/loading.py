"""Load denoisers that are not filters: Python callables, network files, the shipped network."""

from __future__ import annotations

import functools
import importlib
import importlib.resources
import sys
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable
from pathlib import Path
from types import ModuleType
from typing import Any

from glsim.denoise import shipped
from glsim.denoise.inputs import MAX_NEIGHBOURS
from glsim.denoise.interface import Method, parameter
from glsim.depth_protocol import check_protocol
from glsim.errors import CPU_TORCH, DenoiserError
from glsim.plugins import announce_code

#: Package of the shipped networks, one file each; docs/model_card.md describes them.
_SHIPPED_PACKAGE: ModuleType | str = shipped
#: Suffix of networks that run without PyTorch; other suffixes (.pt, .safetensors) need it.
ONNX_SUFFIX = ".onnx"


def from_callable(module: str, name: str, parameters: dict[str, str], label: str) -> Method:
    """Load ``module:name`` with parameters as keyword arguments, as numbers where possible.

    Modules in the current folder are found too. A class is instantiated. An instance or function
    with the attribute ``before`` or ``after`` gets its neighbours in time. Raises DenoiserError if
    it cannot be imported or made.
    """
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    announce_code(module)
    try:
        function: Any = getattr(importlib.import_module(module), name)
    except AttributeError:
        raise DenoiserError(f"{label}: module {module} has no {name!r}") from None
    except Exception as error:
        raise DenoiserError(f"{label}: cannot import {module}: {error}") from error
    keywords = {key: _number(value) for key, value in parameters.items()}
    try:
        if isinstance(function, type):
            function = function(**keywords)
        elif keywords:
            function = functools.partial(function, **keywords)
    except Exception as error:
        raise DenoiserError(f"{label}: cannot make {name}: {error}") from error
    method = as_method(label, function, _version(getattr(sys.modules[module], "__file__", None)))
    return replace(method, own_code=True)


@dataclass(frozen=True)
class NetworkOptions:
    """Parameters of a trained network on the command line."""

    min_probability: float = parameter(
        0.0,
        0.0,
        0.999,
        "keep a pixel if P(depth on the chosen surface) exceeds this; 0: see --composite",
        former_names=("sure",),
    )
    before: int = parameter(
        MAX_NEIGHBOURS,
        0,
        MAX_NEIGHBOURS,
        "networks of video: use at most this many earlier frames",
    )
    keep_clean: int | None = parameter(
        None,
        0,
        1,
        "1: a frame whose noise rounding and the form of surfaces explain comes back unchanged; "
        "0: every frame is denoised; default: as the network was trained, 0 for face-stereo",
    )


def from_file(path: Path, label: str, options: NetworkOptions = NetworkOptions()) -> Method:
    """Load a network from an ONNX file, or from a checkpoint, which needs PyTorch.

    Raises DenoiserError without the file or PyTorch, or for a damaged file.
    """
    if not path.exists():
        raise DenoiserError(
            f"{path}: no such file: give the best.pt of a run of glsim train, or an ONNX file of "
            "glsim export"
        )
    if path.suffix == ONNX_SUFFIX:
        from glsim.denoise.onnx_file import load_onnx

        network = load_onnx(path, options.min_probability)
    else:
        try:
            from glsim.denoise.inference import load_network
        except ImportError as error:
            raise DenoiserError(
                f"{label}: checkpoints need PyTorch: pip install 'glsim[train]' ({CPU_TORCH}), or "
                f"export it where PyTorch is (glsim export {path} -o network.onnx) ({error})"
            ) from None
        network = load_network(path, options.min_probability)
    from glsim.denoise.network import VideoDenoiser

    if isinstance(network, VideoDenoiser):
        network.before = min(network.before, options.before)
    if options.keep_clean is not None:
        network.keep_clean = bool(options.keep_clean)
    return as_method(label, network, f"{_version(path)} {options}")


def from_shipped(name: str, label: str, options: NetworkOptions) -> Method:
    """Load a network shipped with glsim. Raises DenoiserError without its file."""
    if is_shipped(name):
        with shipped_file(name) as path:
            return from_file(path, label, options)
    raise DenoiserError(
        f"{label}: this installation has no {name}{ONNX_SUFFIX}, the weights of the shipped "
        "network: install glsim again, or choose a network or filter with -d (glsim eval --list)"
    )


def shipped_file(name: str) -> AbstractContextManager[Path]:
    """Return a context whose value is the file of a shipped network's weights."""
    return importlib.resources.as_file(_shipped_folder() / f"{name}{ONNX_SUFFIX}")


def is_shipped(name: str) -> bool:
    """Return whether this installation has the weights of a network."""
    try:
        return (_shipped_folder() / f"{name}{ONNX_SUFFIX}").is_file()
    except (ImportError, FileNotFoundError):
        return False


def _shipped_folder() -> Traversable:
    return importlib.resources.files(_SHIPPED_PACKAGE)


def as_method(label: str, function: Any, version: str = "") -> Method:
    """Wrap a callable of either protocol. Raises DenoiserError if it cannot be called."""
    if not callable(function):
        raise DenoiserError(f"{label}: is no function of (noisy_mm, valid)")
    before, after = (int(getattr(function, name, 0)) for name in ("before", "after"))
    temporal = hasattr(function, "before") or hasattr(function, "after")
    infrared = bool(getattr(function, "infrared", False))
    protocol = check_protocol(getattr(function, "protocol", None), f"{label}: protocol")
    return Method(label, function, before, after, temporal, version, infrared, protocol)


def _version(file: Path | str | None) -> str:
    """Return a text that changes with the file; "" without a file."""
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
