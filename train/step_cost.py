"""Cost of a training step: operations by PyTorch's counter, and seconds on this machine."""

from __future__ import annotations

import time
from typing import Final

import torch
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils.flop_counter import FlopCounterMode

from glsim.train.models.registry import build_model
from glsim.train.recipe import Recipe

#: Operations of the largest timed step; of a larger one, fewer frames are timed. Chosen: some 4 s.
_LARGEST_FLOP: Final = 5e11
#: Timed steps, after one that allocates memory; their median counts.
_TIMED: Final = 3


def step_flop(recipe: Recipe) -> float:
    """Count the floating-point operations of a training step, forward and backward."""
    with FakeTensorMode(), FlopCounterMode(display=False) as counter:  # computes shapes alone
        _run_steps(recipe, recipe.training.batch, 1)
    return float(counter.get_total_flops())


def step_seconds(recipe: Recipe) -> float:
    """Time a training step on this machine, s."""
    share = min(1.0, _LARGEST_FLOP / max(step_flop(recipe), 1.0))
    frames = max(1, int(share * recipe.training.batch))
    with torch.device("cuda" if torch.cuda.is_available() else "cpu"):
        seconds = sorted(_run_steps(recipe, frames, 1 + _TIMED)[1:])
    return seconds[_TIMED // 2] * recipe.training.batch / frames


def _run_steps(recipe: Recipe, frames: int, steps: int) -> list[float]:
    """Time training steps on frames of a wall at 900 mm with white noise; return s per step."""
    network, side = build_model(recipe.model), recipe.data.crop or 128
    optimiser = torch.optim.Adam(network.parameters())
    noisy_mm = 900 + torch.randn(frames, 1, side, side)
    seconds = []
    for _ in range(steps):
        start = time.perf_counter()
        optimiser.zero_grad()
        network(noisy_mm).depth_mm.square().mean().backward()
        optimiser.step()
        seconds.append(time.perf_counter() - start)
    return seconds
