"""Pairs of noisy frames of one sequence, for training without clean frames."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.errors import DatasetError
from glsim.settings.seeds import pcg_rng
from glsim.train.data.stored import StoredPairs


class StoredCaptures(StoredPairs):
    """``pairs[n]`` is (noisy_mm, second_mm): a frame and another one near it in time.

    Each (1, H, W) float32 millimetres, 0 = no return. The second capture is a frame of the same
    sequence, 1 to ``frames_apart`` before or after, drawn anew in each epoch. Both sides are
    equally likely away from the ends of a sequence, so that steady motion adds no bias. Crop and
    augmentation are those of `StoredPairs`, the same for both frames.
    """

    def __init__(
        self, dataset: Path, split: str, *, frames_apart: int = 1, **settings: Any
    ) -> None:
        """Open the split with the settings of ``StoredPairs``.

        Raises as it does, and DatasetError for a frame that is the only one of its sequence.
        """
        super().__init__(dataset, split, **settings)
        self._apart = frames_apart
        self._ends = self._sequence_ends()

    def _sequence_ends(self) -> NDArray[np.int64]:
        """First and last number of each frame's sequence, (frames, 2)."""
        keys = [self.split.key(n)[:2] for n in range(len(self.split))]
        starts = [0, *(n for n in range(1, len(keys)) if keys[n] != keys[n - 1])]
        ends = np.empty((len(keys), 2), np.int64)
        for first, after in pairwise([*starts, len(keys)]):
            if after - first < 2:
                raise DatasetError(
                    f"{self.dataset}: {self.split[first].name} is the only frame of its "
                    "sequence, and this loss needs a second one: generate more frames for each "
                    "person (--frames-per-subject)"
                )
            ends[first:after] = first, after - 1
        return ends

    def _images(self, number: int) -> NDArray[np.float32]:
        """Read a frame, (C + 1, H, W): the stack of its inputs, and another noisy map."""
        stack, second = super()._images(number), super()._images(self.second_of(number))
        return np.concatenate([stack[:-1], second[:1]])

    def second_of(self, number: int) -> int:
        """Draw the number of the second capture of a frame, for the present epoch."""
        words = ("second capture", self._seed, int(self._epoch.item()), number)
        rng = pcg_rng(*words)
        first, last = self._ends[number]
        others = [
            other
            for other in range(number - self._apart, number + self._apart + 1)
            if first <= other <= last and other != number
        ]
        return int(rng.choice(others))
