"""Where batches come from, in an order that is a function of the seed and the epoch alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor
from torch.utils.data import (
    BatchSampler,
    ConcatDataset,
    DataLoader,
    Dataset,
    DistributedSampler,
    Sampler,
    Subset,
    TensorDataset,
)

from glsim.config import Settings, load_settings
from glsim.errors import ConfigError
from glsim.train.recipe import DataSettings, Recipe

#: Pairs a batch of the validation: it has no say in what is found, only in memory.
VALIDATION_BATCH: Final = 8
#: Frames of the validation that are rendered for ``--simulate`` unless the recipe says.
_RENDERED: Final = 200
#: Seeds of one training's devices, and seeds with the epoch added, are so far apart.
_APART: Final = 1_000_003

Batch = tuple[Tensor, Tensor]


class Pairs(Protocol):
    """A map-style data set: ``pairs[n]`` is (noisy_mm, clean_mm), each (1, H, W) float32."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Batch: ...

    def set_epoch(self, epoch: int) -> None:
        """What is drawn anew in each epoch, is drawn for this one."""
        ...


class Feed(Protocol):
    """What a training sees. Batches are (noisy_mm, clean_mm), (B, 1, H, W) float32 on its device.

    validation: the frames to judge by. fingerprint: plain values that are equal for equal data.
    """

    validation: Dataset[Batch]
    fingerprint: dict[str, Any]

    def connect(self, fabric: Fabric) -> int:
        """Make ready for one of the devices, once; the number of batches of an epoch."""
        ...

    def batches(self, epoch: int, skip: int) -> Iterator[Batch]:
        """Those of an epoch but for the first ``skip``."""
        ...


class StoredFeed:
    """Pairs that can be had by number; see ``Feed``."""

    def __init__(
        self,
        train: Pairs,
        validation: Dataset[Batch],
        fingerprint: dict[str, Any],
        recipe: Recipe,
    ) -> None:
        self._train, self._recipe = train, recipe
        self.validation, self.fingerprint = validation, fingerprint

    def connect(self, fabric: Fabric) -> int:
        """As in ``Feed``. Raises ConfigError if there is not one batch for each device."""
        data, batch = self._recipe.data, self._recipe.training.batch
        count = min(data.train_frames or len(self._train), len(self._train))
        self._order = Order(count, batch, self._recipe.seed, fabric.world_size, fabric.global_rank)
        loader = DataLoader(
            self._train,
            batch_sampler=self._order,
            num_workers=data.workers,
            persistent_workers=data.workers > 0,
            pin_memory=torch.cuda.is_available(),
            generator=torch.Generator(),  # of its own: the global one is a checkpoint's
        )
        self._loader = fabric.setup_dataloaders(loader, use_distributed_sampler=False)
        return len(self._order)

    def batches(self, epoch: int, skip: int) -> Iterator[Batch]:
        """As in ``Feed``."""
        self._train.set_epoch(epoch)
        self._order.start(epoch, skip)
        yield from self._loader


class SimulatedFeed:
    """Pairs that are rendered when needed; see ``Feed``. An epoch goes on in the stream."""

    def __init__(self, settings: Settings, recipe: Recipe) -> None:
        """Renders the frames of the validation. Raises ConfigError, MeshError, DeviceError."""
        from glsim.train.data.simulated import SimulatedPairs

        self._settings, self._recipe = settings, recipe
        self.fingerprint = self._pairs(0, 0).fingerprint()
        count = recipe.data.validation_frames or _RENDERED
        steps = -(-count // VALIDATION_BATCH)
        held_out = SimulatedPairs(settings, batch=VALIDATION_BATCH, split="val", length=steps)
        rendered = ConcatDataset([TensorDataset(*batch) for batch in held_out])
        self.validation: Dataset[Batch] = Subset(rendered, range(count))
        self._next: tuple[int, Iterator[Batch]] | None = None

    def connect(self, fabric: Fabric) -> int:
        """As in ``Feed``."""
        self._fabric = fabric
        steps: int = self._recipe.data.epoch_steps
        return steps

    def batches(self, epoch: int, skip: int) -> Iterator[Batch]:
        """As in ``Feed``. The workers live on from epoch to epoch."""
        steps = self._recipe.data.epoch_steps
        first, end = epoch * steps + skip, (epoch + 1) * steps
        if self._next is None or self._next[0] != first:
            loader = self._pairs(self._fabric.global_rank, first).loader(self._recipe.data.workers)
            loader = self._fabric.setup_dataloaders(loader, use_distributed_sampler=False)
            self._next = (first, iter(loader))
        running = self._next[1]
        for number in range(first, end):
            self._next = (number + 1, running)
            yield next(running)

    def _pairs(self, rank: int, start: int) -> Any:
        from glsim.train.data.simulated import SimulatedPairs

        return SimulatedPairs(
            self._settings,
            batch=self._recipe.training.batch,
            seed=self._recipe.seed + rank * _APART,
            reuse=self._recipe.data.reuse,
            start=start,
        )


def stored(datasets: Sequence[Path], recipe: Recipe) -> StoredFeed:
    """The splits train and val of one or several data sets on disk, joined.

    Raises DatasetError, ConfigError.
    """
    from glsim.train.data.checks import fingerprint
    from glsim.train.data.stored import Augmentation, StoredPairs

    data = recipe.data
    crop = data.crop or None
    centred = "centre" if data.cut == "random" else data.cut
    train = [
        StoredPairs(
            dataset,
            "train",
            crop=crop,
            cut=data.cut,
            augmentation=Augmentation(flip=data.flip),
            seed=recipe.seed + number * _APART,
        )
        for number, dataset in enumerate(datasets)
    ]
    validation = [StoredPairs(dataset, "val", crop=crop, cut=centred) for dataset in datasets]
    prints = [fingerprint(dataset) for dataset in datasets]
    whole = prints[0] if len(prints) == 1 else {"sets": prints}
    return StoredFeed(Joined(train), _spread(Joined(validation), data), whole, recipe)


class Joined(ConcatDataset[Batch]):
    """Pairs of several data sets, one after the other."""

    def __init__(self, parts: Sequence[Pairs]) -> None:
        super().__init__(parts)
        self._parts = parts

    def set_epoch(self, epoch: int) -> None:
        """As in ``Pairs``."""
        for part in self._parts:
            part.set_epoch(epoch)


def simulated(recipe: Recipe) -> SimulatedFeed:
    """Pairs of a recipe's [simulate], over the settings for any Kinect V2 if it names no sensor.

    Raises ConfigError, MeshError, DeviceError.
    """
    from glsim.train.data.simulated import randomised

    changes = dict(recipe.simulate)
    if recipe.data.crop:
        changes["output"] = {"crop": recipe.data.crop, **changes.get("output", {})}
    make = load_settings if "sensor" in changes else randomised
    return SimulatedFeed(make(overrides=changes), recipe)


def _spread(validation: Pairs, data: DataSettings) -> Dataset[Batch]:
    """As many frames as the recipe asks for, evenly over all, so that all subjects are seen."""
    count = min(data.validation_frames or len(validation), len(validation))
    places = np.linspace(0, len(validation) - 1, count).round().astype(int)
    return Subset(validation, places.tolist())


class Order(Sampler[list[int]]):
    """The batches of an epoch, from any of them on. What does not fill a batch is left out."""

    def __init__(self, count: int, batch: int, seed: int, replicas: int = 1, rank: int = 0) -> None:
        """Raises ConfigError if there is not one batch for each of the devices."""
        if count < batch * replicas:
            raise ConfigError(
                f"training.batch = {batch} on {replicas} device(s), but there are {count} pairs to "
                "train on: set a smaller one (--set training.batch=1), or generate more"
            )
        self._shuffled = DistributedSampler(
            range(count), replicas, rank, shuffle=True, seed=seed * _APART, drop_last=True
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
