"""Where batches come from, in an order that is a function of the seed and the epoch alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import BatchSampler, DataLoader, Dataset, DistributedSampler, Sampler, Subset

from glsim.errors import ConfigError
from glsim.train.recipe import DataSettings, Recipe

#: Pairs a batch of the validation: it has no say in what is found, only in memory.
VALIDATION_BATCH: Final = 8


class Pairs(Protocol):
    """A map-style data set: ``pairs[n]`` is (noisy_mm, clean_mm), each (1, H, W) float32."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> tuple[Tensor, Tensor]: ...

    def set_epoch(self, epoch: int) -> None:
        """What is drawn anew in each epoch, is drawn for this one."""
        ...


@dataclass(frozen=True, eq=False)
class Feed:
    """What a training sees. fingerprint: plain values that are equal for equal data."""

    train: Pairs
    validation: Dataset[tuple[Tensor, Tensor]]
    fingerprint: dict[str, Any]


def stored(dataset: Path, recipe: Recipe) -> Feed:
    """The splits train and val of a data set on disk. Raises DatasetError, ConfigError."""
    from glsim.train.data.checks import fingerprint
    from glsim.train.data.stored import Augmentation, StoredPairs

    data = recipe.data
    crop = data.crop or None
    train = StoredPairs(
        dataset,
        "train",
        crop=crop,
        cut=data.cut,
        augmentation=Augmentation(flip=data.flip),
        seed=recipe.seed,
    )
    centred = "centre" if data.cut == "random" else data.cut
    validation = StoredPairs(dataset, "val", crop=crop, cut=centred)
    return Feed(train, spread(validation, data), fingerprint(dataset))


def spread(validation: Pairs, data: DataSettings) -> Dataset[tuple[Tensor, Tensor]]:
    """As many frames as the recipe asks for, evenly over all, so that all subjects are seen."""
    count = min(data.validation_frames or len(validation), len(validation))
    places = np.linspace(0, len(validation) - 1, count).round().astype(int)
    return Subset(validation, places.tolist())


def training_loader(
    feed: Feed, recipe: Recipe, replicas: int, rank: int
) -> tuple[DataLoader[list[Tensor]], Order]:
    """Batches of an epoch, and the order that says of which and from where."""
    count = min(recipe.data.train_frames or len(feed.train), len(feed.train))
    order = Order(count, recipe.training.batch, recipe.seed, replicas, rank)
    workers = recipe.data.workers
    loader = DataLoader(
        feed.train,
        batch_sampler=order,
        num_workers=workers,
        persistent_workers=workers > 0,
        pin_memory=torch.cuda.is_available(),
        generator=torch.Generator(),  # of its own: the global one is a checkpoint's
    )
    return loader, order


def validation_loader(feed: Feed) -> DataLoader[list[Tensor]]:
    """All frames of the validation, always in the same order."""
    return DataLoader(feed.validation, VALIDATION_BATCH, generator=torch.Generator())


class Order(Sampler[list[int]]):
    """The batches of an epoch, from any of them on. What does not fill a batch is left out."""

    def __init__(self, count: int, batch: int, seed: int, replicas: int = 1, rank: int = 0) -> None:
        """Raises ConfigError if there is not one batch for each of the devices."""
        if count < batch * replicas:
            raise ConfigError(
                f"training.batch = {batch} on {replicas} device(s), but there are {count} pairs to "
                "train on: set a smaller one (--set training.batch=1), or generate more"
            )
        # PyTorch adds the epoch to the seed: so far apart that no seed repeats another's epochs.
        self._shuffled = DistributedSampler(
            range(count), replicas, rank, shuffle=True, seed=seed * 1_000_003, drop_last=True
        )
        self._batches = BatchSampler(self._shuffled, batch, drop_last=True)
        self._skip = 0

    def start(self, epoch: int, skip: int) -> None:
        """The next iteration gives the batches of this epoch but for the first ``skip``."""
        self._shuffled.set_epoch(epoch)
        self._skip = skip

    def __len__(self) -> int:
        """Batches of a whole epoch."""
        return len(self._batches)

    def __iter__(self) -> Iterator[list[int]]:
        return islice(iter(self._batches), self._skip, None)
