"""The order of the pairs of an epoch, given by seed and epoch alone."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Final

from torch.utils.data import BatchSampler, DistributedSampler, Sampler

from glsim.errors import ConfigError

#: Distance between the seeds of two devices or data sets, and of two recipe seeds.
SEED_STRIDE: Final = 1_000_003


class EpochSampler(Sampler[list[int]]):
    """Sampler of whole batches of pair indices, which can start at any batch of an epoch."""

    def __init__(self, count: int, batch: int, seed: int, replicas: int = 1, rank: int = 0) -> None:
        """Raises ConfigError if a device would get no whole batch."""
        if count < batch * replicas:
            raise ConfigError(
                f"training.batch = {batch} on {replicas} device(s), but there are {count} pairs to "
                "train on: set a smaller batch (--set training.batch=1), or generate more pairs"
            )
        self._shuffled: DistributedSampler[int] = DistributedSampler(
            range(count),  # type: ignore[arg-type]  # only its length is asked
            replicas,
            rank,
            shuffle=True,
            seed=seed * SEED_STRIDE,
            drop_last=True,
        )
        self._batches = BatchSampler(self._shuffled, batch, drop_last=True)
        self._skip = 0

    def set_epoch(self, epoch: int, skip: int) -> None:
        """Make the next iteration yield the batches of this epoch without the first ``skip``."""
        self._shuffled.set_epoch(epoch)
        self._skip = skip

    def __len__(self) -> int:
        """Return the number of batches in a whole epoch."""
        return len(self._batches)

    def __iter__(self) -> Iterator[list[int]]:
        return islice(iter(self._batches), self._skip, None)
