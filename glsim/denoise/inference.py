"""Run the network of a checkpoint with PyTorch."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch

from glsim.denoise import checkpoint
from glsim.denoise.network import Depth, NetworkDenoiser, network_denoiser
from glsim.denoise.record import NetworkRecord
from glsim.depth_protocol import check_protocol
from glsim.errors import DenoiserError, GlsimError
from glsim.train.models.base import DepthModel, channels_last
from glsim.train.models.named_outputs import named_outputs
from glsim.train.models.registry import build_model, weight_shapes

#: Keeps GPU convolutions in float32: the default, TF32, has ten bits, steps of 0.5 mm at 900 mm.
_FLOAT32 = partial(torch.backends.cudnn.flags, enabled=True, allow_tf32=False)


class TorchNetwork:
    """Runs a model in float32, on the GPU if there is one; a ``glsim.denoise.network.Network``."""

    def __init__(self, model: DepthModel) -> None:
        self._device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._model = channels_last(model.eval().to(self._device))

    def __call__(self, noisy_mm: Depth) -> dict[str, Depth]:
        """Run the model on (H, W) millimetres, or on the (C, H, W) stack of its inputs."""
        stack = noisy_mm[None] if noisy_mm.ndim == 2 else noisy_mm
        noisy = torch.from_numpy(stack)[None].to(self._device)
        with torch.inference_mode(), _FLOAT32():
            outputs = named_outputs(self._model(noisy))
        return {name: image[0, 0].float().cpu().numpy() for name, image in outputs.items()}


def load_model(path: Path) -> DepthModel:
    """Load the model of a checkpoint of ``glsim train``, best.pt or last.pt; run no code in it.

    Raises:
        DenoiserError: for a file that is truncated, foreign, or does not fit the models of glsim.
    """
    return _load(path)[0]


def load_record(path: Path) -> NetworkRecord:
    """Read the record of a checkpoint's network. Raises DenoiserError as ``load_model``."""
    return _load(path)[1]


def _load(path: Path) -> tuple[DepthModel, NetworkRecord]:
    try:
        content: dict[str, Any] = checkpoint.load(path)
        table = content["recipe"]["model"]
        _check_shapes(weight_shapes(table), content["model"])
        model = build_model(table)
        model.load_state_dict(content["model"])
        protocol = check_protocol(content["data"].get("protocol", "depth"), f"{path}: protocol")
    except GlsimError as error:
        raise DenoiserError(str(error)) from None
    except (RuntimeError, KeyError, TypeError, AttributeError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DenoiserError(
            f"{path}: its weights do not fit its recipe ({reason}): train again"
        ) from None
    assert protocol is not None
    return model, NetworkRecord(protocol, model.keep_clean, model.margin_px, model.unlikely)


def load_network(path: Path, min_probability: float = 0.0) -> NetworkDenoiser:
    """Load the network of a checkpoint as a denoiser.

    Args:
        path: best.pt or last.pt.
        min_probability: see ``NetworkDenoiser``; networks that code "no depth" as 0 ignore it.

    Raises:
        DenoiserError: as ``load_model``.
    """
    model, record = _load(path)
    uncertain = bool(getattr(model, "uncertainty", False))
    return network_denoiser(
        TorchNetwork(model), str(path), uncertain, min_probability, model.inputs, record
    )


def _check_shapes(expected: Mapping[str, tuple[int, ...]], weights: Mapping[str, Any]) -> None:
    """Raise ValueError if weights do not fit their model, before the model takes any memory."""
    found = {name: tuple(value.shape) for name, value in weights.items()}
    for name in sorted(expected.keys() | found.keys()):
        if expected.get(name) != found.get(name):
            raise ValueError(f"{name}: {found.get(name)}, not {expected.get(name)}")


def load_denoiser(path: Path, sure: float = 0.0) -> NetworkDenoiser:
    """Load a network by the deprecated name and parameter: use ``load_network``."""
    warnings.warn(
        "glsim.denoise.inference.load_denoiser(path, sure) is deprecated: call "
        "load_network(path, min_probability), or glsim.denoise.load_denoiser(spec)",
        DeprecationWarning,
        stacklevel=2,
    )
    return load_network(path, sure)
