"""Sources of batches: stored or simulated pairs, in an order set by seed and epoch alone.

``clean_mm`` is the target of the recipe: the clean or the expected depth (data.target).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
import torch
from lightning_fabric import Fabric
from torch.utils.data import ConcatDataset, DataLoader, Dataset, Sampler, Subset, TensorDataset

from glsim.core.errors import ConfigError, counted
from glsim.settings.schema import Settings, load_settings
from glsim.train.data.checks import entries_of, fingerprint
from glsim.train.data.simulated import SimulatedPairs, randomised
from glsim.train.data.stored import (
    Augmentation,
    Batch,
    JoinedPairs,
    PairDataset,
    Photographs,
    StoredPairs,
)
from glsim.train.models.registry import inputs_of
from glsim.train.recipe import Recipe

#: Difference between the seeds of two data sets, and of two recipes' seeds.
SEED_STRIDE: Final = 1_000_003
#: Number of pairs per batch of a validation; it affects memory, not results.
VALIDATION_BATCH: Final = 8
#: Default number of validation frames that are rendered for ``--simulate``.
_SIMULATED_VALIDATION_FRAMES: Final = 200


def on_device(fabric: Fabric, loader: DataLoader[Batch]) -> DataLoader[Batch]:
    """Wrap a loader so that it moves its batches to the device of ``fabric``."""
    return cast(DataLoader[Batch], fabric.setup_dataloaders(loader, use_distributed_sampler=False))


def spread(frames: Subset[Batch]) -> Subset[Batch]:
    """Shuffle the frames with a fixed seed, so that the first frames represent the whole set."""
    order = np.random.default_rng(0).permutation(len(frames))
    return Subset(frames.dataset, [frames.indices[number] for number in order])


class EpochSampler(Sampler[list[int]]):
    """Sampler of whole batches of pair indices that can start at any batch of an epoch."""

    def __init__(self, count: int, batch: int, seed: int) -> None:
        """Prepare the sampler. Raises ConfigError if there is no whole batch."""
        if count < batch:
            raise ConfigError(
                f"training.batch = {batch}, but the data set has {counted(count, 'pair')}: set a "
                f"smaller batch (--set training.batch={max(count, 1)}), or generate more pairs"
            )
        self._count, self._batch, self._seed = count, batch, seed * SEED_STRIDE
        self._epoch = self._skip = 0

    def set_epoch(self, epoch: int, skip: int) -> None:
        """Set the epoch of the next iteration, and the number of first batches to skip."""
        self._epoch, self._skip = epoch, skip

    def __len__(self) -> int:
        return self._count // self._batch

    def __iter__(self) -> Iterator[list[int]]:
        generator = torch.Generator().manual_seed(self._seed + self._epoch)
        order = torch.randperm(self._count, generator=generator).tolist()
        for number in range(self._skip, len(self)):
            yield order[number * self._batch : (number + 1) * self._batch]


class StoredBatches:
    """Batches (noisy_mm, clean_mm) of pairs with random access: float32 mm on the device.

    Shapes: (B, C, H, W) and (B, 1, H, W), with the inputs of ``glsim.networks.inputs`` as channels.
    ``validation``: pairs without a batch axis; ``fingerprint``: JSON values that identify the data.
    """

    def __init__(
        self, train: PairDataset, validation: Subset[Batch], fingerprint: dict[str, Any],
        recipe: Recipe,
    ) -> None:  # fmt: skip
        self._train, self._recipe = train, recipe
        self.validation, self.fingerprint = validation, fingerprint

    def prepare(self, fabric: Fabric) -> int:
        """Set up loading; return the number of batches per epoch. Raises ConfigError for none."""
        data, batch = self._recipe.data, self._recipe.training.batch
        count = min(data.train_frames or len(self._train), len(self._train))
        self._sampler = EpochSampler(count, batch, self._recipe.seed)
        loader = DataLoader(
            self._train,
            batch_sampler=self._sampler,
            num_workers=data.workers,
            persistent_workers=data.workers > 0,
            pin_memory=torch.cuda.is_available(),
            generator=torch.Generator(),  # not the global one: checkpoints hold its state
        )
        self._loader = on_device(fabric, loader)
        return len(self._sampler)

    def batches(self, epoch: int, skip: int) -> Iterator[Batch]:
        """Yield the batches of an epoch except the first ``skip``."""
        self._train.set_epoch(epoch)
        self._sampler.set_epoch(epoch, skip)
        yield from self._loader


class SimulatedBatches:
    """Batches of pairs rendered on demand; each epoch continues the same stream."""

    def __init__(self, settings: Settings, recipe: Recipe) -> None:
        """Render the validation frames. Raises the errors of ``simulated_batches``."""
        self._recipe = recipe
        self._open = partial(
            SimulatedPairs, settings, inputs=inputs_of(recipe.model), target=recipe.data.target,
            protocol=recipe.data.protocol,
        )  # fmt: skip
        self.fingerprint = self._pairs(0).fingerprint()
        count = recipe.data.validation_frames or _SIMULATED_VALIDATION_FRAMES
        length = -(-count // VALIDATION_BATCH)
        held_out = self._open(batch=VALIDATION_BATCH, split="val", length=length)
        rendered = [cast(Dataset[Batch], TensorDataset(*batch)) for batch in held_out]
        self.validation: Subset[Batch] = Subset(ConcatDataset(rendered), range(count))
        self._running: tuple[int, Iterator[Batch]] | None = None  # number of next batch, loader

    def prepare(self, fabric: Fabric) -> int:
        """Set up loading as in `StoredBatches`."""
        self._fabric = fabric
        return self._recipe.data.epoch_steps

    def batches(self, epoch: int, skip: int) -> Iterator[Batch]:
        """Yield batches as `StoredBatches`; worker processes live from epoch to epoch."""
        steps = self._recipe.data.epoch_steps
        first, end = epoch * steps + skip, (epoch + 1) * steps
        if self._running is None or self._running[0] != first:
            loader = self._pairs(first).loader(self._recipe.data.workers)
            self._running = (first, iter(on_device(self._fabric, loader)))
        iterator = self._running[1]
        for number in range(first, end):
            self._running = (number + 1, iterator)
            yield next(iterator)

    def _pairs(self, start: int) -> SimulatedPairs:
        return self._open(
            batch=self._recipe.training.batch, seed=self._recipe.seed,
            reuse=self._recipe.data.reuse, vary_inputs=True, start=start,
        )  # fmt: skip


BatchSource = StoredBatches | SimulatedBatches


def stored_batches(datasets: Sequence[Path], recipe: Recipe) -> StoredBatches:
    """Open the splits train and val of the data sets on disk and join them.

    Raises DatasetError: a data set is missing, damaged, or unfit for the recipe; ConfigError: no
    data set can fit the recipe.
    """
    data = recipe.data
    open_split = partial(
        StoredPairs, crop=data.crop or None, inputs=inputs_of(recipe.model), target=data.target,
        protocol=data.protocol,
    )  # fmt: skip
    changes = Augmentation(
        data.flip, data.relief_mm, data.slope_mm_per_px, data.texture, data.averaged, True
    )
    train: list[PairDataset] = [
        open_split(
            dataset, "train", cut=data.cut, augmentation=changes,
            seed=recipe.seed + number * SEED_STRIDE,
        )
        for number, dataset in enumerate(datasets)
    ]  # fmt: skip
    validation_cut = "centre" if data.cut == "random" else data.cut
    validation = [open_split(dataset, "val", cut=validation_cut) for dataset in datasets]
    fingerprints = [fingerprint(dataset) | entries_of(target=data.target) for dataset in datasets]
    joined = fingerprints[0] if len(fingerprints) == 1 else {"sets": fingerprints}
    protocols = {pairs.protocol for pairs in validation}
    if len(protocols) > 1:
        raise ConfigError(
            f"the data sets are of different protocols ({', '.join(sorted(protocols))}): choose "
            "one with --protocol"
        )
    joined |= entries_of(protocol=protocols.pop())
    if data.photographs is not None:
        photographs = Photographs(Path(data.photographs), data.crop or 128, recipe.seed)
        train, joined = [photographs], joined | {"photographs": photographs.identity}
    held_out = JoinedPairs(validation)
    count = min(data.validation_frames or len(held_out), len(held_out))
    indices = np.linspace(0, len(held_out) - 1, count).round().astype(int)  # frames of all subjects
    return StoredBatches(JoinedPairs(train), Subset(held_out, indices.tolist()), joined, recipe)


def simulated_batches(recipe: Recipe) -> SimulatedBatches:
    """Create batches as the table [simulate] of a recipe describes.

    The table changes the settings of `randomised`, or the defaults of glsim if it names a sensor.

    Raises ConfigError: the settings cannot be simulated; MeshError: a source has no usable face;
    DeviceError: there is no OpenGL.
    """
    changes = dict(recipe.simulate)
    if recipe.data.crop:
        changes["output"] = {"crop": recipe.data.crop, **changes.get("output", {})}
    load = load_settings if "sensor" in changes else randomised
    return SimulatedBatches(load(overrides=changes), recipe)
