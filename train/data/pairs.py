"""The base class of data sets of training pairs."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.utils.data import Dataset

#: (noisy_mm, clean_mm), float32 millimetres, 0 = no return; see `PairDataset` for their shapes.
Batch = tuple[Tensor, Tensor]


class PairDataset(Dataset[Batch]):
    """A map-style data set: ``pairs[n]`` is (noisy_mm, clean_mm), (C, H, W) and (1, H, W).

    C = 1 for depth alone, else noisy_mm is the stack of all inputs (``glsim.denoise.inputs``).
    The clean frame is the target of the recipe: the clean depth or the expected one. For a
    `SecondCaptureLoss` it is a second capture: see `StoredCaptures`.
    """

    def __init__(self) -> None:
        # In shared memory, so that persistent workers see the new epoch.
        self._epoch = torch.zeros((), dtype=torch.int64)
        self._epoch.share_memory_()  # type: ignore[no-untyped-call]  # it has no annotations

    def __len__(self) -> int:
        raise NotImplementedError

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the random draws; call it before iterating a loader."""
        self._epoch.fill_(epoch)
