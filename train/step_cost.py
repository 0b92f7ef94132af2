"""Cost of a training step: operations by PyTorch's counter, and seconds on this machine."""

from __future__ import annotations

import time
from typing import Final

import torch
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils.flop_counter import FlopCounterMode

from glsim.train.models.registry import build_model
from glsim.train.recipe import Recipe

#: Operations of the largest timed step; of a larger one, fewer and smaller frames are timed.
#: Chosen: about 1 s of a core.
_LARGEST_FLOP: Final = 2e10
#: Timed steps, after one that allocates memory; the fastest counts: other work disturbs it least.
_TIMED: Final = 5
#: Sides of timed frames are multiples of this, px, as all networks divide them.
_MULTIPLE_PX: Final = 16


def step_flop(recipe: Recipe) -> float:
    """Count the floating-point operations of a training step, forward and backward."""
    with FakeTensorMode(), FlopCounterMode(display=False) as counter:  # computes shapes alone
        _run_steps(recipe, recipe.training.batch, _side(recipe), 1)
    return float(counter.get_total_flops())


def step_seconds(recipe: Recipe) -> float:
    """Time a training step on this machine, s; large images are timed as crops and scaled."""
    batch, side = recipe.training.batch, _side(recipe)
    share = batch * min(1.0, _LARGEST_FLOP / max(step_flop(recipe), 1.0))  # in frames
    frames, shrunk = max(1, int(share)), _MULTIPLE_PX * int(side * share**0.5 // _MULTIPLE_PX)
    timed = side if share >= 1 else max(2 * _MULTIPLE_PX, shrunk)
    with torch.device("cuda" if torch.cuda.is_available() else "cpu"):
        seconds = min(_run_steps(recipe, frames, timed, 1 + _TIMED)[1:])
    return seconds * batch * side**2 / (frames * timed**2)


def _side(recipe: Recipe) -> int:
    return recipe.data.crop or 128


def _run_steps(recipe: Recipe, frames: int, side: int, steps: int) -> list[float]:
    """Time training steps on frames of a wall at 900 mm with white noise; return s per step."""
    network = build_model(recipe.model)
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
