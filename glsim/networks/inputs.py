"""Inputs of a network besides the depth of its frame: infrared, and neighbours in time.

A network's input is one stack of images, (C, H, W) float32:

    0                    depth of the frame, mm, 0 = no return
    1, if infrared       infrared of the frame, counts, 0 = not measured
    then ``before``      depth of earlier frames, the latest first
    then ``after``       depth of later frames, the next one first

Images that do not exist (the start of a sequence, a camera without infrared) are zeros.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats

#: Largest number of neighbours on each side. Chosen: noise falls with the root of their number.
MAX_NEIGHBOURS: Final = 4
#: Names of the inputs of exported networks, in the order of the stack.
DEPTH, INFRARED, BEFORE, AFTER = "noisy_mm", "infrared", "before_mm", "after_mm"


class NetworkInputs(NamedTuple):
    """The inputs of a network besides the frame's depth: infrared, earlier and later frames."""

    infrared: bool = False
    before: int = 0
    after: int = 0

    @property
    def names(self) -> dict[str, int]:
        """The inputs in the order of the stack: name -> number of images."""
        counts = {DEPTH: 1, INFRARED: int(self.infrared), BEFORE: self.before, AFTER: self.after}
        return {name: count for name, count in counts.items() if count}

    @property
    def channels(self) -> int:
        """The number of images in the stack."""
        return sum(self.names.values())

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
    infrared: NDArray[Any] | None = None,
) -> Floats:
    """Stack depth, infrared and neighbours in time of a frame as a network's input.

    Args:
        depth_mm: (H, W) depth of the frame, 0 = no return.
        before_mm: earlier frames, the latest first; surplus frames are ignored.
        after_mm: later frames, the next frame first; surplus frames are ignored.
        infrared: (H, W) counts, or None.

    Returns:
        (C, H, W) float32.
    """
    stack = np.zeros((inputs.channels, *depth_mm.shape), np.float32)
    parts = inputs.named(stack)
    parts[DEPTH][0] = depth_mm
    if inputs.infrared and infrared is not None:
        parts[INFRARED][0] = infrared
    for name, given in ((BEFORE, before_mm), (AFTER, after_mm)):
        for place, neighbour in zip(parts.get(name, ()), given, strict=False):
            place[:] = neighbour
    return stack
