"""Neighbours in time as inputs besides depth, for stored and simulated pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import FrameKey
from glsim.networks.inputs import AFTER, BEFORE, NetworkInputs

#: Share of frames whose neighbours in time have gaps, since cameras drop frames.
_WITH_GAPS: Final = 0.25


class Neighbours:
    """Table of the neighbours in time of each frame, as positions in a list of frames.

    A neighbour is a frame of the same sequence; its number is at most ``inputs.before`` lower or
    ``inputs.after`` higher. Frames may be missing.
    """

    def __init__(self, keys: Sequence[FrameKey], inputs: NetworkInputs) -> None:
        """Index the keys of all frames; frames of a sequence must be adjacent, in time order."""
        self._inputs = inputs
        words = dict.fromkeys(key[:2] for key in keys)
        numbers = {sequence: number for number, sequence in enumerate(words)}
        self._sequence = np.array([numbers[key[:2]] for key in keys], np.int64)
        self._frame = np.array([key.frame for key in keys], np.int64)

    def of(self, number: int) -> tuple[list[int], list[int]]:
        """Return the positions of the earlier and of the later neighbours, nearest first."""
        before, after = self._inputs
        return self._towards(number, -1, before), self._towards(number, +1, after)

    def _towards(self, number: int, step: int, reach: int) -> list[int]:
        neighbours = []
        last = self._frame[number]
        for other in range(number + step, number + step * (reach + 1), step):
            if not 0 <= other < len(self._frame) or self._sequence[other] != self._sequence[number]:
                break
            distance = step * int(self._frame[other] - self._frame[number])
            if not (0 < distance <= reach) or step * int(self._frame[other] - last) <= 0:
                break
            last = self._frame[other]
            neighbours.append(other)
        return neighbours


def vary_inputs(
    stack: NDArray[np.float32], inputs: NetworkInputs, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Leave out neighbours of a frame at random, (C, H, W), so that any number is learnt.

    On each side the nearest remain, or some with gaps.
    """
    varied = stack.copy()
    named = inputs.named(varied)
    for name in (BEFORE, AFTER):
        if name not in named:
            continue
        images = named[name]
        numbers = np.arange(rng.integers(len(images) + 1))
        if rng.random() < _WITH_GAPS:
            numbers = np.sort(rng.choice(len(images), len(numbers), replace=False))
        remaining = images[numbers]
        images[:] = 0
        images[: len(numbers)] = remaining
    return varied
