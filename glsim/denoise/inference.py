"""Run the network of a checkpoint with PyTorch."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch

from glsim.core.array_types import Depth
from glsim.core.depth_protocol import check_protocol
from glsim.core.errors import DenoiserError, GlsimError
from glsim.networks import checkpoint
from glsim.networks.network import NetworkFunction
from glsim.networks.record import NetworkRecord
from glsim.train.models.base import DepthModel, channels_last, named_outputs
from glsim.train.models.registry import build_model

#: Keeps GPU convolutions in float32. The default, TF32, has ten bits: 0.5 mm at 900 mm.
_FLOAT32 = partial(torch.backends.cudnn.flags, enabled=True, allow_tf32=False)
#: Side of the frame of zeros on which a network runs to show its outputs, px.
_TRIAL_PX: Final = 32


class TorchNetwork:
    """A ``Runner`` of a PyTorch model in float32, on the GPU if there is one."""

    def __init__(self, model: DepthModel, record: NetworkRecord | None = None) -> None:
        self._device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._model = channels_last(model.eval().to(self._device))
        self.inputs, self.record = model.inputs, record or record_of(model)
        zeros = np.zeros((model.inputs.channels, _TRIAL_PX, _TRIAL_PX), np.float32)
        self.outputs = tuple(self(zeros))

    def __call__(self, stack: Depth) -> dict[str, Depth]:
        """Run the model on a stack of inputs, (C, H, W)."""
        noisy = torch.from_numpy(stack)[None].to(self._device)
        with torch.inference_mode(), _FLOAT32():
            outputs = named_outputs(self._model(noisy))
        return {name: image[0, 0].float().cpu().numpy() for name, image in outputs.items()}


def record_of(model: DepthModel, protocol: Any = "depth") -> NetworkRecord:
    """Make the record of a model that was trained under a protocol."""
    return NetworkRecord(protocol, model.keep_clean, model.margin_px)


def load_model(path: Path) -> tuple[DepthModel, NetworkRecord]:
    """Load the model and the record of a checkpoint of ``glsim train``, without running its code.

    Raises DenoiserError for a file that is truncated, foreign, or does not fit the models of glsim.

    ``path``: best.pt, last.pt or a safetensors file.
    """
    try:
        content: dict[str, Any] = checkpoint.load(path)
        model = build_model(content["recipe"]["model"])
        model.load_state_dict(content["model"])
        protocol = check_protocol(content["data"].get("protocol", "depth"), f"{path}: protocol")
    except GlsimError as error:
        raise DenoiserError(str(error)) from None
    except (RuntimeError, KeyError, TypeError, AttributeError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DenoiserError(
            f"{path}: its weights do not fit its recipe ({reason}): train again"
        ) from None
    return model, record_of(model, protocol)


def load_network(path: Path, min_probability: float = 0.0) -> NetworkFunction:
    """Load the network of a checkpoint as a denoising function.

    Raises DenoiserError as ``load_model``.

    ``path``: best.pt, last.pt or a safetensors file.
        min_probability: see ``NetworkFunction``; networks that code "no depth" as 0 ignore it.
    """
    return NetworkFunction(TorchNetwork(*load_model(path)), str(path), min_probability)
