"""Load denoisers from text: ``median:size=5``, ``module:function``, ``run/best.pt``."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from glsim.denoise.composites import DEFAULT_COMPOSITE
from glsim.denoise.filters import led3d, masked, paper, temporal
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

_FILTERS: Final[dict[str, type]] = {
    "noisy": paper.Unchanged,
    "median": paper.Median,
    "bilateral": paper.Bilateral,
    "nlm": paper.NonLocalMeans,
    "adaptive": temporal.Adaptive,
    "masked_median": masked.MaskedMedian,
    "masked_bilateral": masked.MaskedBilateral,
    "masked_gaussian": masked.MaskedGaussian,
    "plane": masked.LocalPlane,
    "quadric": masked.LocalQuadric,
    "guided": masked.Guided,
    "rolling_guidance": masked.RollingGuidance,
    "led3d": led3d.Led3DCleanUp,
    "temporal_median": temporal.TemporalMedian,
}

#: Name of the shipped network, the default of ``glsim denoise``.
SHIPPED: Final = "face"
#: The networks that glsim ships, in the folder shipped/: name -> help.
_NETWORKS: Final = {
    SHIPPED: "the shipped network, for heads and rooms before any depth camera",
    "face-ir": "the shipped network that also sees the infrared image",
    "face-video": "the shipped network that also sees up to four earlier frames",
}

#: The columns of the paper's table 1, in its order.
PAPER_FILTERS: Final = ("noisy", "adaptive", "median", "nlm", "bilateral")

#: Values that tuning tries: filter -> parameter -> values. Tuning also tries ``cleanup``.
GRIDS: Final[dict[str, dict[str, Sequence[float]]]] = {
    "masked_median": {"size": (3, 5, 7, 9)},
    "masked_bilateral": {"sigma_mm": (5.0, 15.0, 40.0), "sigma_px": (1.0, 1.5, 2.0, 3.0)},
    "masked_gaussian": {"sigma_px": (0.7, 1.0, 1.5, 2.0, 3.0)},
    "plane": {"sigma_px": (1.0, 1.5, 2.0, 3.0, 4.0)},
    "quadric": {"sigma_px": (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)},
    "guided": {"radius": (2, 3, 5), "epsilon_mm": (2.0, 5.0, 15.0)},
    "rolling_guidance": {"sigma_mm": (5.0, 15.0), "sigma_px": (1.0, 2.0)},
}
#: Windows of the mask clean-up that tuning tries, px.
CLEANUPS: Final = (3, 5, 7)

_SUFFIXES = (ONNX_SUFFIX, ".pt", ".pth", ".ckpt", ".safetensors")


def denoiser_names() -> list[str]:
    """Return the names of the shipped denoisers."""
    return [*_FILTERS, *(name for name in _NETWORKS if name == SHIPPED or is_shipped(name))]


def describe_denoiser(name: str) -> tuple[str, Mapping[str, tuple[Any, str]]]:
    """Return a one-line description of a shipped denoiser, and parameter -> (default, help)."""
    kind = NetworkOptions if name in _NETWORKS else _FILTERS[name]
    parameters = {
        field.name: (field.default, str(field.metadata["help"]))
        for field in dataclasses.fields(kind)
    }
    description = _NETWORKS.get(name) or (kind.__doc__ or "").splitlines()[0]
    return description, parameters


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
        return from_file(Path(path), label, _network_options(assignments, spec))
    name, _, tail = text.partition(":")
    if name in _FILTERS:
        return as_method(label, build(_FILTERS[name], _assignments(tail, spec), spec))
    if name in _NETWORKS:
        return from_shipped(name, label, _network_options(tail, spec))
    function, _, parameters = tail.partition(":")
    if function and "=" not in function:
        return from_callable(name, function, _assignments(parameters, spec), label)
    raise ConfigError(
        f"--denoiser {spec}: no such denoiser {name!r} ({did_you_mean(name, denoiser_names())}); "
        "or write module:function, or the path of a network (.onnx, .pt, .safetensors)"
    )


def load_denoiser(
    spec: str, *, device: Path | str | None = None, composite: str | None = DEFAULT_COMPOSITE
) -> MapDenoiser:
    """Load a denoiser as a function of one depth map: ``load_denoiser("face")(depth_mm)``.

    spec: as for ``load``. The function takes (H, W) float or integer millimetres, 0 = no return,
    and returns ``Denoised``, depth and the mask of depth. Its ``stream()`` takes the frames of a
    camera one by one. device: sensor file of ``glsim fit`` whose fixed pattern and wiggling are
    subtracted first. composite: see COMPOSITES; None returns networks' probability of depth.
    Raises what ``load`` and ``MapDenoiser`` raise.
    """
    return MapDenoiser(load(spec), device, composite)


def _network_options(text: str, spec: str) -> NetworkOptions:
    options: NetworkOptions = build(NetworkOptions, _assignments(text, spec), spec)
    return options


def _assignments(text: str, spec: str) -> dict[str, str]:
    """Parse ``key=value,key=value``. Raises ConfigError for another form."""
    pairs: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not key or not value:
            raise ConfigError(f"--denoiser {spec}: write name=value after the colon, not {part!r}")
        pairs[key] = value
    return pairs
