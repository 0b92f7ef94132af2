"""Pairs of a data set on disk, PNG tree or shards, as a map-style PyTorch data set."""

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
from glsim.settings.seeds import stable_seed
from glsim.train.data.checks import Cut, Target, checked_split, pair_layers
from glsim.train.data.surface_bumps import draw_surface_bumps

__all__ = ["CACHE_MB", "Augmentation", "StoredPairs"]

#: Default limit of the cache: 15,000 pairs of 128 x 128.
CACHE_MB = 1024.0


@dataclass(frozen=True)
class Augmentation:
    """Random changes to a pair, limited to what the sensor could have measured.

    flip: mirror left and right, at random with probability 1/2. Off by default: a time-of-flight
        camera's emitter and a structured-light camera's projector sit on one side of the lens, and
        a mirrored pair has its shadows on the other side of the face.

    relief_mm: add bumps and creases up to about this height to both depths, see
        ``glsim.train.data.surface_bumps``.

    Nothing else is offered. A depth offset would be wrong: noise grows, and faces shrink, with
    distance. So would rotation, scaling and added noise; each has a physical counterpart in the
    settings of the simulator (pose, distance, parameters of the stages). To shift, crop larger
    frames (``cut="random"``): padding would draw straight edges that no scene has.
    """

    flip: bool = False
    relief_mm: float = 0.0


class StoredPairs(Dataset[tuple[Tensor, Tensor]]):
    """``pairs[n]`` is (noisy_mm, target_mm), each (1, H, W) float32 millimetres, 0 = no return.

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
        target: Target = "clean",
    ) -> None:
        """crop: side of the square frames, px; default: whole frames, all of one size. cut: how
        larger frames are cropped. seed: seed of ``augmentation`` and random crops. target: the
        layer that a network learns to give; "expected" leaves the sensor's systematic error.

        cache_mb: the decoded split is kept in memory if it takes at most this (MB); 0 reads the
        files in every epoch. Only the process that made this object has a cache: the workers of a
        DataLoader always read, because each would hold a copy.

        Raises DatasetError and ConfigError, see ``glsim.train.data.checks.checked_split``.
        """
        self.dataset = open_dataset(dataset)
        self.split = checked_split(self.dataset, split, crop, cut, target)
        self._crop, self._cut, self._seed = crop, cut, seed
        self._layers = pair_layers(target)
        self._augmentation = augmentation or Augmentation()
        # In shared memory, so that persistent workers see the new epoch.
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()
        self._cache_bytes = cache_mb * 1e6
        self._cache: _Cache | None = None

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the random draws. Call it before iterating a loader."""
        self._epoch.fill_(epoch)

    def __len__(self) -> int:
        return len(self.split)

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the cache, which workers of a DataLoader do not use."""
        return {**self.__dict__, "_cache": None}

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        """Return one pair. Raises DatasetError with the file's name for an unreadable image."""
        number = range(len(self))[index]
        pair_mm = self._pair_mm(number)
        rng = np.random.default_rng(
            stable_seed("augment", self._seed, int(self._epoch.item()), number)
        )
        pair_mm = self._cropped(pair_mm, rng)
        if self._augmentation.flip and rng.random() < 0.5:
            pair_mm = pair_mm[:, :, ::-1]
        if self._augmentation.relief_mm:
            bumps_mm = draw_surface_bumps(pair_mm.shape[1:], self._augmentation.relief_mm, rng)
            pair_mm = np.where(pair_mm > 0, pair_mm + bumps_mm, np.float32(0))
        both = torch.from_numpy(np.ascontiguousarray(pair_mm))
        return both[0:1], both[1:2]

    def _cropped(
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
        """Read a pair, (2, H, W): noisy, target; from the cache if possible."""
        cache = self._cache_of_process()
        if cache is not None and cache.known[number]:
            return cache.pair_mm(number)
        pair = self.split[number]
        units = np.stack([pair.image(layer) for layer in self._layers]).astype(np.uint16)
        if cache is not None and units.shape[1:] == cache.units.shape[2:]:
            cache.keep(number, units, pair.depth_offset_mm)
        return to_mm(units, self.dataset.depth_unit_mm, pair.depth_offset_mm)

    def _cache_of_process(self) -> _Cache | None:
        if get_worker_info() is not None:
            return None
        if self._cache is None:
            camera = self.split[0].intrinsics
            shape = (len(self), len(self._layers), camera.height, camera.width)
            if np.prod(shape, dtype=np.float64) * np.dtype(np.uint16).itemsize > self._cache_bytes:
                return None
            self._cache = _Cache(shape, self.dataset.depth_unit_mm)
        return self._cache


class _Cache:
    """Decoded frames in units of their files. The system allocates memory as frames come in."""

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
