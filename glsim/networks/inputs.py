"""Inputs of a network besides the depth of its frame: neighbours in time.

A network's input is one stack of depth maps, (C, H, W) float32 mm, 0 = no return: the frame, then
``before`` earlier frames, the latest first, then ``after`` later frames, the next one first. Frames
that do not exist (the start of a sequence) are zeros.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth, Floats

#: Largest number of neighbours on each side. Chosen: noise falls with the root of their number.
MAX_NEIGHBOURS: Final = 4
#: Names of the inputs of exported networks, in the order of the stack.
DEPTH, BEFORE, AFTER = "noisy_mm", "before_mm", "after_mm"


class NetworkInputs(NamedTuple):
    """The inputs of a network besides the frame's depth: numbers of earlier and later frames."""

    before: int = 0
    after: int = 0

    @property
    def names(self) -> dict[str, int]:
        """The inputs in the order of the stack: name -> number of images."""
        counts = {DEPTH: 1, BEFORE: self.before, AFTER: self.after}
        return {name: count for name, count in counts.items() if count}

    @property
    def channels(self) -> int:
        """The number of images in the stack."""
        return 1 + self.before + self.after

    @property
    def temporal(self) -> bool:
        """Whether the network takes neighbours in time."""
        return bool(self.before or self.after)

    def named(self, stack: Any) -> dict[str, Any]:
        """Split a network's input, (C, H, W) or (B, C, H, W), into name -> images."""
        parts: dict[str, Any] = {}
        first = 0
        for name, count in self.names.items():
            parts[name] = stack[..., first : first + count, :, :]
            first += count
        return parts


#: The inputs of a network of single depth frames.
DEPTH_ALONE: Final = NetworkInputs()


def stack_inputs(
    inputs: NetworkInputs,
    depth_mm: NDArray[Any],
    before_mm: Sequence[NDArray[Any]] = (),
    after_mm: Sequence[NDArray[Any]] = (),
) -> Floats:
    """Stack depth and neighbours in time of a frame as a network's input.

    Earlier frames begin with the latest, later ones with the next; surplus frames are ignored.
    Returns (C, H, W) float32.
    """
    stack = np.zeros((inputs.channels, *depth_mm.shape), np.float32)
    parts = inputs.named(stack)
    parts[DEPTH][0] = depth_mm
    for name, given in ((BEFORE, before_mm), (AFTER, after_mm)):
        for place, neighbour in zip(parts.get(name, ()), given, strict=False):
            place[:] = neighbour
    return stack


def past_mean(depths_mm: Depth, threshold_mm: float) -> Depth:
    """Average the last of (T, H, W) frames, mm, with earlier ones until a pixel's depth changes."""
    here = depths_mm[-1]
    total, count, still = here.copy(), np.ones_like(here), here > 0
    for past in depths_mm[-2::-1]:
        still &= (past > 0) & (np.abs(past - here) <= threshold_mm)
        total[still] += past[still]
        count[still] += 1
    return np.asarray(total / count)
