"""Pairs of a data set on disk, PNG tree or shards, as a map-style data set of PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset, get_worker_info

from glsim.dataset import open_dataset
from glsim.frame import to_mm
from glsim.stable import stable_seed

from .checks import LAYERS, Cut, checked_split
from .relief import draw_relief

__all__ = ["CACHE_MB", "Augmentation", "StoredPairs"]

#: What the cache may hold unless the caller says otherwise: 15,000 pairs of 128 x 128.
CACHE_MB = 1024.0


@dataclass(frozen=True)
class Augmentation:
    """What may be done to a pair without making it one that the sensor could not have delivered.

    flip: mirror left and right in half of the epochs. Off by default: a time-of-flight camera's
        emitter and a structured-light camera's projector sit on one side of the lens, and a
        mirrored pair has its shadows on the other side of the face.

    relief_mm: lay bumps and creases up to about so high on both depths, see
        ``glsim.train.data.relief``.

    That is all. Another depth offset would be wrong: noise grows, and faces shrink, with distance.
    So would turning, scaling and added noise; each has a physical counterpart among the settings of
    the simulator (pose, distance, parameters of the stages). A shift is a cut of larger frames
    (``cut="random"``): padding would draw straight edges that no scene has.
    """

    flip: bool = False
    relief_mm: float = 0.0


class StoredPairs(Dataset[tuple[Tensor, Tensor]]):
    """``pairs[n]`` is (noisy_mm, clean_mm), each (1, H, W) float32 millimetres, 0 = no return.

    The same (seed, epoch, n) gives the same pair in any process and order.
    """

    def __init__(
        self,
        dataset: Path,
        split: str,
        *,
        crop: int | None = None,
        cut: Cut = "no",
        augmentation: Augmentation | None = None,
        seed: int = 0,
        cache_mb: float = CACHE_MB,
    ) -> None:
        """crop: side of the squares that are given; whole frames, which must be of one size, if
        left out. cut: what happens to frames that are larger. seed: of ``augmentation`` and cut.

        cache_mb: the decoded split is kept in memory if it takes no more than this (MB); 0 reads
        the files in every epoch. Only the process that made this object keeps any: the workers of
        a DataLoader always read, or they would hold a copy each.

        Raises DatasetError and ConfigError, see ``glsim.train.data.checks.checked_split``.
        """
        self.dataset = open_dataset(dataset)
        self.split = checked_split(self.dataset, split, crop, cut)
        self._crop, self._cut, self._seed = crop, cut, seed
        self._augmentation = augmentation or Augmentation()
        # Shared memory: workers that outlive an epoch learn of the next.
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()
        self._cache_bytes = cache_mb * 1e6
        self._cache: _Cache | None = None

    def set_epoch(self, epoch: int) -> None:
        """Draw the augmentations of this epoch from now on. Call it before iterating a loader."""
        self._epoch.fill_(epoch)

    def __len__(self) -> int:
        return len(self.split)

    def __getstate__(self) -> dict[str, object]:
        """Without the cache, which the workers of a DataLoader do not use."""
        return {**self.__dict__, "_cache": None}

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        """One pair. Raises DatasetError, with the file's name, for an image that cannot be read."""
        number = range(len(self))[index]
        pair_mm = self._pair_mm(number)
        rng = np.random.default_rng(
            stable_seed("augment", self._seed, int(self._epoch.item()), number)
        )
        pair_mm = self._cut_out(pair_mm, rng)
        if self._augmentation.flip and rng.random() < 0.5:
            pair_mm = pair_mm[:, :, ::-1]
        if self._augmentation.relief_mm:
            relief = draw_relief(pair_mm.shape[1:], self._augmentation.relief_mm, rng)
            pair_mm = np.where(pair_mm > 0, pair_mm + relief, np.float32(0))
        both = torch.from_numpy(np.ascontiguousarray(pair_mm))
        return both[0:1], both[1:2]

    def _cut_out(
        self, pair_mm: NDArray[np.float32], rng: np.random.Generator
    ) -> NDArray[np.float32]:
        height, width = pair_mm.shape[1:]
        side = self._crop
        if side is None or (height, width) == (side, side):
            return pair_mm
        top, left = (height - side) // 2, (width - side) // 2
        if self._cut == "random":
            top, left = (int(rng.integers(free + 1)) for free in (height - side, width - side))
        return pair_mm[:, top : top + side, left : left + side]

    def _pair_mm(self, number: int) -> NDArray[np.float32]:
        """(2, H, W): noisy, clean. From the cache if it is there."""
        cache = self._own_cache()
        if cache is not None and cache.known[number]:
            return cache.pair_mm(number)
        pair = self.split[number]
        units = np.stack([pair.image(layer) for layer in LAYERS]).astype(np.uint16)
        if cache is not None and units.shape[1:] == cache.units.shape[2:]:
            cache.keep(number, units, pair.depth_offset_mm)
        return to_mm(units, self.dataset.depth_unit_mm, pair.depth_offset_mm)

    def _own_cache(self) -> _Cache | None:
        if get_worker_info() is not None:
            return None
        if self._cache is None:
            camera = self.split[0].intrinsics
            shape = (len(self), len(LAYERS), camera.height, camera.width)
            if np.prod(shape, dtype=np.float64) * np.dtype(np.uint16).itemsize > self._cache_bytes:
                return None
            self._cache = _Cache(shape, self.dataset.depth_unit_mm)
        return self._cache


class _Cache:
    """Decoded frames as they are in their files. Memory is taken as it is filled."""

    def __init__(self, shape: tuple[int, ...], unit_mm: float) -> None:
        self.units = np.zeros(shape, np.uint16)
        self.known = np.zeros(shape[0], bool)
        self._offset_mm = np.zeros(shape[0], np.float32)
        self._unit_mm = unit_mm

    def keep(self, number: int, units: NDArray[np.uint16], offset_mm: float) -> None:
        self.units[number], self._offset_mm[number] = units, offset_mm
        self.known[number] = True

    def pair_mm(self, number: int) -> NDArray[np.float32]:
        return to_mm(self.units[number], self._unit_mm, float(self._offset_mm[number]))
