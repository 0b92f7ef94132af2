"""Data sets of training pairs: their base class, and several joined to one."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor
from torch.utils.data import ConcatDataset, Dataset

#: (noisy_mm, clean_mm), float32 millimetres, 0 = no return; see `PairDataset` for their shapes.
Batch = tuple[Tensor, Tensor]


class PairDataset(Dataset[Batch]):
    """A map-style data set: ``pairs[n]`` is (noisy_mm, clean_mm), (C, H, W) and (1, H, W).

    C = 1 for depth alone, else noisy_mm is the stack of all inputs (``glsim.denoise.inputs``).
    The clean frame is the target of the recipe: the clean depth or the expected one.
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


class JoinedPairs(ConcatDataset[Batch], PairDataset):
    """Pairs of several data sets, one data set after the other."""

    def __init__(self, parts: Sequence[PairDataset]) -> None:
        super().__init__(parts)
        self._parts = parts
        self._remote = any(getattr(part, "is_remote", False) for part in parts)

    def __getitems__(self, indices: list[int]) -> list[Batch]:
        """Return the pairs of a batch; read those in object storage in parallel."""
        if not self._remote:
            return [self[index] for index in indices]
        with ThreadPoolExecutor(len(indices)) as pool:
            return list(pool.map(self.__getitem__, indices))

    def set_epoch(self, epoch: int) -> None:
        """See ``PairDataset``."""
        for part in self._parts:
            part.set_epoch(epoch)
