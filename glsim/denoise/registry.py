"""Load denoisers from text: ``median:size=5``, ``module:function``, ``run/best.pt``.

The filters are the dictionaries FILTERS and GRIDS of the modules in the folder filters/.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from glsim.core.errors import ConfigError, DenoiserError, did_you_mean, one_line, pip_install
from glsim.core.plugins import load_plugin, module_names, plugin_names, shipped_module
from glsim.core.user_code import load_object
from glsim.denoise import shipped
from glsim.denoise.denoiser import Denoiser
from glsim.denoise.parameters import build, parameter
from glsim.networks.composites import DEFAULT_COMPOSITE
from glsim.networks.inputs import MAX_NEIGHBOURS
from glsim.networks.interface import DepthFunction
from glsim.networks.onnx_file import load_onnx

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
    "face-video": "The shipped network that also sees up to four earlier frames.",
    "face-azure-kinect": "Heads before an Azure Kinect or Femto Bolt.",
    "face-stereo": "Heads before a RealSense D4xx or TrueDepth.",
}
#: Folder of the shipped networks, one file each; docs/results/model_card.md describes them.
_SHIPPED_FOLDER = Path(shipped.__file__).parent

#: The columns of the paper's table 1, in its order.
PAPER_FILTERS: Final = ("noisy", "adaptive", "median", "nlm", "bilateral")

#: Values that tuning tries: filter -> parameter -> values. Tuning also tries ``cleanup``.
GRIDS: Final[dict[str, dict[str, Sequence[float]]]] = {
    name: grid for module in _MODULES for name, grid in getattr(module, "GRIDS", {}).items()
}
#: Windows of the mask clean-up that tuning tries, px.
CLEANUPS: Final = (3, 5, 7)

#: Suffix of network files that run without PyTorch.
ONNX_SUFFIX: Final = ".onnx"
_SUFFIXES: Final = (ONNX_SUFFIX, ".pt", ".pth", ".ckpt", ".safetensors")


@dataclass(frozen=True)
class NetworkOptions:
    """The parameters of trained networks on the command line."""

    min_probability: float = parameter(
        0.0, 0.0, 0.999, "keep a pixel if P(depth on the chosen surface) exceeds this; 0: see "
        "--composite",
    )  # fmt: skip
    before: int = parameter(
        MAX_NEIGHBOURS, 0, MAX_NEIGHBOURS, "networks of video: use at most this many earlier frames"
    )
    average: int = parameter(
        1, 1, 30, "denoise the mean of this many frames, up to this one, where nothing moves"
    )
    mirror: int = parameter(
        0, 0, 1, "1: average with the output of the mirror image: twice the time, 0.3 to 1 % nearer"
    )
    keep_clean: int | None = parameter(
        None, 0, 1, "1: a frame whose noise rounding and the form of surfaces explain comes back "
        "unchanged; 0: every frame is denoised; default: as the network was trained, 0 for "
        "face-stereo",
    )  # fmt: skip


def denoiser_names() -> list[str]:
    """Return the names of all denoisers: filters, shipped networks, and plug-ins."""
    filters = [*PAPER_FILTERS, *(name for name in _FILTERS if name not in PAPER_FILTERS)]
    return [*filters, *NETWORKS, *_plugins()]


def describe_denoiser(name: str) -> tuple[str, Mapping[str, tuple[Any, str]]]:
    """Return a one-line description of a denoiser, and parameter -> (default, help)."""
    kind = NetworkOptions if name in NETWORKS else _filter(name)
    parameters = {
        field.name: (field.default, str(field.metadata.get("help", "")))
        for field in (dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ())
    }
    return NETWORKS.get(name) or (kind.__doc__ or name).splitlines()[0], parameters


def tuning_specs(name: str, cleanups: Sequence[int]) -> list[str]:
    """List the settings of a filter that tuning tries, as texts for the command line."""
    axes = GRIDS[name] | {"cleanup": cleanups}
    return [
        f"{name}:" + ",".join(f"{key}={value:g}" for key, value in zip(axes, values, strict=True))
        for values in itertools.product(*axes.values())
    ]


def load_denoiser(
    spec: str, *, device: Path | str | None = None, composite: str | None = DEFAULT_COMPOSITE,
    around: str | None = None,
) -> Denoiser:  # fmt: skip
    """Load a denoiser as a function of a depth map: ``load_denoiser("face")(depth_mm)``.

    Args:
        spec: ``name:key=value,...``, ``module:function:key=value,...`` (also file.py:...), or a
            network file (.pt and .safetensors need PyTorch). ``label@spec`` names it in tables.
        device: sensor file of ``glsim fit`` whose fixed pattern and wiggling are subtracted first.
        composite: see COMPOSITES; None returns networks' probability of depth.
        around: "face": denoise only around the nearest head, for live streams.

    Returns:
        See ``Denoiser.__call__``; its ``push`` takes the frames of a camera one by one.

    Raises:
        ConfigError: for an unknown name or parameter, and as ``Denoiser``.
        DenoiserError: if it cannot be imported, or for a file that is missing or damaged.
    """
    label, at, rest = spec.partition("@")
    text = rest if at else spec
    if not text or (at and not label):
        raise ConfigError(f"denoiser {spec!r}: give a name, e.g. median:size=5")
    function, version = _resolve(text, spec, label)
    return Denoiser(label, function, version, device=device, composite=composite, around=around)


def with_parameter(spec: str, key: str, value: int) -> str:
    """Return a network's spec with ``key=value`` beside or instead of its parameters."""
    name, tail = _parts(spec)
    values = _assignments(tail, spec) | {key: str(value)}
    return f"{name}:" + ",".join(f"{key}={value}" for key, value in values.items())


def _parts(text: str) -> tuple[str, str]:
    """Split a name, or a file of a network, from the text behind its colon."""
    path, _, tail = (text, "", "") if text.endswith(_SUFFIXES) else text.rpartition(":")
    if not path.endswith(_SUFFIXES):
        path, _, tail = text.partition(":")
    return path, tail


def _resolve(text: str, spec: str, label: str) -> tuple[Any, str]:
    name, tail = _parts(text)
    if name in _FILTERS:
        return build(_FILTERS[name], _assignments(tail, spec), spec), ""
    if name in NETWORKS or name.endswith(_SUFFIXES):
        file = shipped_file(name) if name in NETWORKS else Path(name)
        return _from_file(file, label, build(NetworkOptions, _assignments(tail, spec), spec))
    if name in _plugins():
        plugin = _filter(name)
        return _own_code(f"{plugin.__module__}:{plugin.__name__}", tail, spec, label)
    function, _, parameters = tail.partition(":")
    if function and "=" not in function:
        return _own_code(f"{name}:{function}", parameters, spec, label)
    if (best := Path(text, "best.pt")).is_file():
        raise ConfigError(f"denoiser {spec}: is the folder of a run: give {best}")
    raise ConfigError(
        f"denoiser {spec}: no such denoiser {name!r} ({did_you_mean(name, denoiser_names())}); "
        "or write module:function, file.py:function, or the path of a network (.onnx, .pt, "
        ".safetensors)"
    )


def _plugins() -> list[str]:
    return plugin_names("denoisers", [*_FILTERS, *NETWORKS])


def _filter(name: str) -> Any:
    return _FILTERS[name] if name in _FILTERS else load_plugin("denoisers", name, callable)


def _assignments(text: str, spec: str) -> dict[str, str]:
    """Parse ``key=value,key=value``. Raises ConfigError for a text of another form."""
    pairs: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not key or not value:
            raise ConfigError(f"denoiser {spec}: write name=value after the colon, not {part!r}")
        pairs[key] = value
    return pairs


def _own_code(target: str, parameters: str, spec: str, label: str) -> tuple[Any, str]:
    """Load a user's class or function with keyword arguments, and the version of its code."""
    keywords = {key: _number(value) for key, value in _assignments(parameters, spec).items()}
    try:
        function, file = load_object(target)
    except ConfigError as error:
        raise DenoiserError(f"{label}: {error}") from error
    try:
        if isinstance(function, type):
            function = function(**keywords)
        elif keywords:
            function = functools.partial(function, **keywords)
    except Exception as error:  # the user's code may raise anything
        raise DenoiserError(f"{label}: cannot make {target}: {one_line(error)}") from error
    return function, "" if file is None else _version(file)


def _from_file(path: Path, label: str, options: NetworkOptions) -> tuple[DepthFunction, str]:
    """Load a network from an ONNX file, or, if PyTorch is installed, from a checkpoint."""
    if not path.exists():
        raise DenoiserError(
            f"{path}: no such file: give best.pt of glsim train, or an ONNX file of glsim export"
        )
    if path.suffix == ONNX_SUFFIX:
        network = load_onnx(path, options.min_probability)
    else:
        try:
            from glsim.denoise.inference import load_network
        except ImportError as error:
            raise DenoiserError(
                f"{label}: checkpoints need PyTorch: {pip_install('train')}, or "
                f"export it where PyTorch is (glsim export {path} -o network.onnx) ({error})"
            ) from None
        network = load_network(path, options.min_probability)
    keep_clean = None if options.keep_clean is None else bool(options.keep_clean)
    network.configure(options.before, options.average, bool(options.mirror), keep_clean)
    return network, f"{_version(path)} {options}"


def shipped_file(name: str) -> Path:
    """Return the path of a shipped network's weights."""
    return _SHIPPED_FOLDER / f"{name}{ONNX_SUFFIX}"


def _version(file: Path) -> str:
    """Return a text of a file's size and time, which changes when the file changes."""
    status = file.stat()
    return f"{status.st_size} {status.st_mtime_ns}"


def _number(text: str) -> int | float | str:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text
