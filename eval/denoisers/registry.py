"""Denoisers as users write them: ``median:size=5``, ``module:function``, ``run/best.pt``."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from glsim.errors import ConfigError, did_you_mean

from . import masked, paper, temporal
from .base import Method, build
from .external import Network, as_method, from_callable, from_checkpoint, from_shipped

_KINDS: Final[dict[str, type]] = {
    "noisy": paper.Identity,
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
    "temporal_median": temporal.TemporalMedian,
}

#: The shipped network; ``glsim denoise`` takes it unless told otherwise.
SHIPPED: Final = "face"
_SHIPPED_HELP: Final = "the shipped network for faces before a Kinect V2 (needs PyTorch)"

#: The columns of the paper's table 1, in its order.
PAPER: Final = ("noisy", "adaptive", "median", "nlm", "bilateral")

#: What is tried when a filter is tuned: name -> parameter -> values. ``cleanup`` is tried too.
GRIDS: Final[dict[str, dict[str, Sequence[float]]]] = {
    "masked_median": {"size": (3, 5, 7, 9)},
    "masked_bilateral": {"sigma_mm": (5.0, 15.0, 40.0), "sigma_px": (1.0, 1.5, 2.0, 3.0)},
    "masked_gaussian": {"sigma_px": (0.7, 1.0, 1.5, 2.0, 3.0)},
    "plane": {"sigma_px": (1.0, 1.5, 2.0, 3.0, 4.0)},
    "quadric": {"sigma_px": (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)},
    "guided": {"radius": (2, 3, 5), "epsilon_mm": (2.0, 5.0, 15.0)},
    "rolling_guidance": {"sigma_mm": (5.0, 15.0), "sigma_px": (1.0, 2.0)},
}
#: Windows of the mask clean-up that are tried, px.
CLEANUPS: Final = (3, 5, 7)

_SUFFIXES = (".pt", ".pth", ".ckpt")


def known() -> list[str]:
    """The names of the shipped denoisers."""
    return [*_KINDS, SHIPPED]


def describe(name: str) -> tuple[str, Mapping[str, tuple[Any, str]]]:
    """What a shipped denoiser is, in a line, and parameter -> (default, help)."""
    kind = Network if name == SHIPPED else _KINDS[name]
    parameters = {
        field.name: (field.default, str(field.metadata["help"]))
        for field in dataclasses.fields(kind)
    }
    what = _SHIPPED_HELP if name == SHIPPED else (kind.__doc__ or "").splitlines()[0]
    return what, parameters


def grid(name: str, cleanups: Sequence[int]) -> list[str]:
    """The settings of a filter that are tried, each as it is written on the command line."""
    axes = GRIDS[name] | {"cleanup": cleanups}
    return [
        f"{name}:" + ",".join(f"{key}={value:g}" for key, value in zip(axes, values, strict=True))
        for values in itertools.product(*axes.values())
    ]


def load(spec: str) -> Method:
    """A denoiser from ``name:key=value,...``, ``module:function:key=value,...`` or ``best.pt``.

    ``label@spec`` gives it a name of its own in tables. Raises ConfigError for an unknown name or
    parameter, DenoiserError for what cannot be imported.
    """
    label, at, rest = spec.partition("@")
    text = rest if at else spec
    if not text or (at and not label):
        raise ConfigError(f"--denoiser {spec!r}: give a name, e.g. median:size=5")
    if text.endswith(_SUFFIXES):
        return from_checkpoint(Path(text), label)
    path, _, asked = text.rpartition(":")
    if path.endswith(_SUFFIXES):
        return from_checkpoint(Path(path), label, _network(asked, spec))
    name, _, tail = text.partition(":")
    if name in _KINDS:
        return as_method(label, build(_KINDS[name], _assignments(tail, spec), spec))
    if name == SHIPPED:
        return from_shipped(label, _network(tail, spec))
    function, _, parameters = tail.partition(":")
    if function and "=" not in function:
        return from_callable(name, function, _assignments(parameters, spec), label)
    raise ConfigError(
        f"--denoiser {spec}: no such denoiser {name!r} ({did_you_mean(name, known())}); or write "
        "module:function, or the path of a checkpoint"
    )


def _network(text: str, spec: str) -> Network:
    asked: Network = build(Network, _assignments(text, spec), spec)
    return asked


def _assignments(text: str, spec: str) -> dict[str, Any]:
    pairs: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not key or not value:
            raise ConfigError(f"--denoiser {spec}: write name=value after the colon, not {part!r}")
        pairs[key] = value
    return pairs
