"""Load denoisers from text: ``median:size=5``, ``module:function``, ``run/best.pt``.

The filters are the dictionaries FILTERS and GRIDS of the modules in the folder filters/.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from glsim.denoise.composites import DEFAULT_COMPOSITE
from glsim.denoise.interface import Method, build
from glsim.denoise.loading import (
    ONNX_SUFFIX,
    NetworkOptions,
    as_method,
    from_callable,
    from_file,
    from_shipped,
    is_shipped,
)
from glsim.denoise.map_denoiser import MapDenoiser
from glsim.errors import ConfigError, did_you_mean
from glsim.plugins import load_plugin, module_names, plugin_names, shipped_module

_FOLDER: Final = "denoise/filters"
_MODULES: Final = [shipped_module(_FOLDER, name) for name in module_names(_FOLDER)]
_FILTERS: Final[dict[str, type]] = {
    name: kind for module in _MODULES for name, kind in getattr(module, "FILTERS", {}).items()
}

#: Name of the shipped network, the default of ``glsim denoise``.
SHIPPED: Final = "face"
#: The networks that glsim ships, in the folder shipped/: name -> help.
NETWORKS: Final = {
    SHIPPED: "The shipped network, for heads and rooms before any depth camera.",
    "face-live": "A smaller network for live streams of heads, in half the time of face.",
    "face-video": "The shipped network that also sees up to four earlier frames.",
    "face-kinect-v2": "Heads before a Kinect V2, either decoder.",
    "face-azure-kinect": "Heads before an Azure Kinect.",
    "face-stereo": "Heads before a RealSense D4xx or TrueDepth.",
}

#: The columns of the paper's table 1, in its order.
PAPER_FILTERS: Final = ("noisy", "adaptive", "median", "nlm", "bilateral")

#: Values that tuning tries: filter -> parameter -> values. Tuning also tries ``cleanup``.
GRIDS: Final[dict[str, dict[str, Sequence[float]]]] = {
    name: grid for module in _MODULES for name, grid in getattr(module, "GRIDS", {}).items()
}
#: Windows of the mask clean-up that tuning tries, px.
CLEANUPS: Final = (3, 5, 7)

_SUFFIXES = (ONNX_SUFFIX, ".pt", ".pth", ".ckpt", ".safetensors")


def denoiser_names() -> list[str]:
    """Return the names of the denoisers: filters, shipped networks, and those of other packages."""
    filters = [*PAPER_FILTERS, *(name for name in _FILTERS if name not in PAPER_FILTERS)]
    networks = [name for name in NETWORKS if name == SHIPPED or is_shipped(name)]
    return [*filters, *networks, *_plugins()]


def describe_denoiser(name: str) -> tuple[str, Mapping[str, tuple[Any, str]]]:
    """Return what a denoiser does, in one line, and parameter -> (default, help)."""
    kind = NetworkOptions if name in NETWORKS else _filter(name)
    parameters = {
        field.name: (field.default, str(field.metadata.get("help", "")))
        for field in (dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ())
    }
    return NETWORKS.get(name) or (kind.__doc__ or name).splitlines()[0], parameters


def _plugins() -> list[str]:
    return plugin_names("denoisers", [*_FILTERS, *NETWORKS])


def _filter(name: str) -> Any:
    """Return the class of a filter, or the class or function of a plug-in."""
    return _FILTERS[name] if name in _FILTERS else load_plugin("denoisers", name, callable)


def tuning_specs(name: str, cleanups: Sequence[int]) -> list[str]:
    """Return the settings that tuning tries for a filter, as written on the command line."""
    axes = GRIDS[name] | {"cleanup": cleanups}
    return [
        f"{name}:" + ",".join(f"{key}={value:g}" for key, value in zip(axes, values, strict=True))
        for values in itertools.product(*axes.values())
    ]


def load(spec: str) -> Method:
    """Load a denoiser: ``name:key=value,...``, ``module:function:key=value,...`` or a network file.

    Network files are ``best.pt`` and ``face.safetensors`` (need PyTorch), and ``face.onnx``.

    ``label@spec`` sets its name in tables. Raises ConfigError for an unknown name or parameter,
    DenoiserError if it cannot be imported.
    """
    label, at, rest = spec.partition("@")
    text = rest if at else spec
    if not text or (at and not label):
        raise ConfigError(f"--denoiser {spec!r}: give a name, e.g. median:size=5")
    if text.endswith(_SUFFIXES):
        return from_file(Path(text), label)
    path, _, assignments = text.rpartition(":")
    if path.endswith(_SUFFIXES):
        return from_file(
            Path(path), label, build(NetworkOptions, _assignments(assignments, spec), spec)
        )
    name, _, tail = text.partition(":")
    if name in _FILTERS:
        return as_method(label, build(_FILTERS[name], _assignments(tail, spec), spec))
    if name in NETWORKS:
        options = build(NetworkOptions, _assignments(tail, spec), spec)
        return from_shipped(name, label, options)
    if name in _plugins():
        found = _filter(name)
        return from_callable(found.__module__, found.__name__, _assignments(tail, spec), label)
    function, _, parameters = tail.partition(":")
    if function and "=" not in function:
        return from_callable(name, function, _assignments(parameters, spec), label)
    raise ConfigError(
        f"--denoiser {spec}: no such denoiser {name!r} ({did_you_mean(name, denoiser_names())}); "
        "or write module:function, or the path of a network (.onnx, .pt, .safetensors)"
    )


def load_denoiser(
    spec: str,
    *,
    device: Path | str | None = None,
    composite: str | None = DEFAULT_COMPOSITE,
    around: str | None = None,
) -> MapDenoiser:
    """Load a denoiser as a function of one depth map: ``load_denoiser("face")(depth_mm)``.

    Raises what ``load`` and ``MapDenoiser`` raise.

    Args:
        spec: as for ``load``.
        device: sensor file of ``glsim fit`` whose fixed pattern and wiggling are subtracted first.
        composite: see COMPOSITES; None returns networks' probability of depth.
        around: "face": denoise only around the nearest head, for live streams.

    Returns:
        A function of (H, W) float or integer millimetres, 0 = no return, that returns ``Denoised``,
        depth and the mask of depth. Its ``stream()`` takes the frames of a camera one by one.
    """
    return MapDenoiser(load(spec), device, composite, around)


def _assignments(text: str, spec: str) -> dict[str, str]:
    """Parse ``key=value,key=value``. Raises ConfigError for another form."""
    pairs: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not key or not value:
            raise ConfigError(f"--denoiser {spec}: write name=value after the colon, not {part!r}")
        pairs[key] = value
    return pairs
