"""Small networks of all kinds, and frames for them."""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from glsim.networks import checkpoint
from glsim.train.models.base import DepthModel
from glsim.train.models.registry import build_model

torch.set_num_threads(1)  # more threads are slower on images this small

#: A small backbone of each kind.
BACKBONES: dict[str, dict[str, Any]] = {
    "dncnn": {"kind": "dncnn", "depth": 3, "width": 8},
    "unet": {"kind": "unet", "scales": 3, "width": 4},
    "restormer": {"kind": "restormer", "dim": 8, "blocks": [1, 1, 1, 1], "refinement": 1},
    "small_unet": {"kind": "small_unet", "width": 8, "scales": 3},
}
WRAPPERS: dict[str, dict[str, Any]] = {
    "paper": {"kind": "paper_input"},
    "masked": {"kind": "mask_aware"},
    "uncertain": {"kind": "mask_aware", "uncertainty": True},
    "surfaces": {"kind": "mask_aware", "uncertainty": True, "surfaces": True},
}
#: Images besides the frame that ``mask_aware`` networks take.
INPUTS: dict[str, dict[str, Any]] = {
    "frame": {},
    "video": {"before": 4},
    "both": {"before": 2, "after": 1},
}


def build(wrapper: str, backbone: str, inputs: str = "frame") -> DepthModel:
    """Build a model in which no parameter tensor is all 0, as if it were trained."""
    torch.manual_seed(3)
    model = build_model(_spec(wrapper, backbone, inputs))
    with torch.no_grad():
        for parameter in model.parameters():
            if not parameter.any():
                parameter.normal_(std=0.05)
    return model


def write_checkpoint(
    path: Path, wrapper: str = "surfaces", backbone: str = "small_unet", inputs: str = "frame"
) -> Path:
    """Write a checkpoint of the model that ``build`` makes from the same names; return ``path``."""
    content = {
        "recipe": {"model": _spec(wrapper, backbone, inputs)},
        "model": build(wrapper, backbone, inputs).state_dict(),
    }
    checkpoint.save(path, content | {"data": {}, "progress": {}, "validation": {}})
    return path


def _spec(wrapper: str, backbone: str, inputs: str) -> dict[str, Any]:
    return WRAPPERS[wrapper] | INPUTS[inputs] | {"backbone": BACKBONES[backbone]}


def frames(count: int = 2, height: int = 53, width: int = 67) -> Tensor:
    """Return (B, 1, H, W) noisy depth near 0.9 m, with a step to a wall, and holes."""
    generator = torch.Generator().manual_seed(5)
    noise = torch.randn(count, 1, height, width, generator=generator)
    frame = 900.0 + 3.0 * noise
    frame[..., : width // 3] += 400.0
    frame[torch.rand(frame.shape, generator=generator) < 0.1] = 0.0
    return frame


def parts(model: DepthModel, noisy_mm: Tensor) -> list[Tensor]:
    return [part for part in model(noisy_mm) if part is not None]
