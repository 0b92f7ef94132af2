"""Pairs of a data set on disk (PNG tree or shards) as a map-style PyTorch data set."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import ConcatDataset, Dataset, get_worker_info

from glsim.core.depth_frame import DepthFrame
from glsim.core.depth_map import FLYING_MM
from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import DatasetError
from glsim.core.seeds import pcg_rng
from glsim.core.units import from_steps
from glsim.data.reader import open_dataset
from glsim.networks.inputs import DEPTH_ALONE, NetworkInputs, stack_inputs
from glsim.train.data.checks import Cut, Target, checked_split, moved_pair, require_videos
from glsim.train.data.extra_inputs import Neighbours, vary_inputs

#: (noisy_mm, clean_mm), float32 millimetres, 0 = no return; see `PairDataset` for their shapes.
Batch = tuple[Tensor, Tensor]


class PairDataset(Dataset[Batch]):
    """A map-style data set whose item n is (noisy_mm, clean_mm), (C, H, W) and (1, H, W).

    C = 1 for depth alone, else noisy_mm is the stack of all inputs (``glsim.networks.inputs``).
    clean_mm is the target of the recipe: the clean or the expected depth.
    """

    #: Whether the images lie in object storage.
    is_remote: bool = False

    def __init__(self) -> None:
        # In shared memory, so that persistent workers see the new epoch.
        self._epoch = torch.zeros((), dtype=torch.int64)
        self._epoch.share_memory_()  # type: ignore[no-untyped-call]  # it has no annotations

    def __len__(self) -> int:
        raise NotImplementedError

    def __getitems__(self, indices: list[int]) -> list[Batch]:
        """Return the pairs of a batch; images in object storage are read in parallel."""
        if not self.is_remote:
            return [self[index] for index in indices]
        with ThreadPoolExecutor(len(indices)) as pool:
            return list(pool.map(self.__getitem__, indices))

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the random augmentation; call it before iterating over a loader."""
        self._epoch.fill_(epoch)


class JoinedPairs(ConcatDataset[Batch], PairDataset):
    """The pairs of several data sets, concatenated."""

    def __init__(self, parts: Sequence[PairDataset]) -> None:
        super().__init__(parts)
        self._parts = parts
        self.is_remote = any(part.is_remote for part in parts)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch in every data set."""
        for part in self._parts:
            part.set_epoch(epoch)


#: Default limit of the cache: 15,000 pairs of 128 x 128.
CACHE_MB = 1024.0


@dataclass(frozen=True)
class Augmentation:
    """Random changes of a pair, limited to scenes that the sensor could have measured.

    Offsets, rotation, scaling and added noise are wrong for depth, because noise depends on
    distance and pose: change the simulator's settings. To shift, crop larger frames at random.

    Attributes:
        flip: mirror left and right with probability 1/2. Shadows change sides, as if the emitter
            were on the other side; do not use it for a network for a single camera.
        relief_mm: add bumps and creases of up to about this height to noisy and target depth.
        slope_mm_per_px: add a plane of up to this slope to noisy and target depth.
        texture: share of frames to which a texture (ribs or grain, as of fabric and hair) is added.
        averaged: share of frames whose noise is reduced as if several frames were averaged.
        vary_inputs: leave out neighbours in time, see ``glsim.train.data.extra_inputs``.
    """

    flip: bool = False
    relief_mm: float = 0.0
    slope_mm_per_px: float = 0.0
    texture: float = 0.0
    averaged: float = 0.0
    vary_inputs: bool = False


class StoredPairs(PairDataset):
    """Pairs of a split, each (noisy_mm, target_mm): (1, H, W) float32 mm, 0 = no return.

    With further ``inputs``, noisy_mm is the stack of all, (C, H, W): see ``glsim.networks.inputs``.
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
        inputs: NetworkInputs = DEPTH_ALONE,
        seed: int = 0,
        cache_mb: float = CACHE_MB,
        target: Target = "clean",
        protocol: DepthProtocol | None = None,
    ) -> None:
        """Open the split. Raises the errors of ``glsim.train.data.checks.checked_split``.

        Args:
            crop: side of the square frames, px. Default: whole frames, all of one size.
            protocol: origin of depths, see ``glsim.core.depth_protocol``. Default: as in the files.
            cache_mb: largest decoded split, MB, in memory; workers do not copy it, but read files.
        """
        super().__init__()
        self.dataset = open_dataset(dataset)
        self.is_remote = self.dataset.is_remote
        self.protocol: DepthProtocol = protocol or self.dataset.protocol
        self._layers = ("noisy", target)
        self.split = checked_split(self.dataset, split, crop, cut, self._layers)
        self._inputs = inputs
        self._neighbours: Neighbours | None = None
        if inputs.temporal:
            require_videos(self.dataset)
            keys = [self.split.key(number) for number in range(len(self.split))]
            self._neighbours = Neighbours(keys, inputs)
        self._crop, self._cut, self._seed = crop, cut, seed
        self._augmentation = augmentation or Augmentation()
        camera = self.split[0].intrinsics
        pixels = len(self.split) * len(self._layers) * camera.height * camera.width
        #: Number -> layers in units of their files, (L, H, W), and offset of the decoded frames.
        self._cache: dict[int, tuple[NDArray[np.uint16], float]] | None = None
        if pixels * np.dtype(np.uint16).itemsize <= cache_mb * 1e6:
            self._cache = {}

    def __len__(self) -> int:
        return len(self.split)

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the cache, since workers of a DataLoader do not use it."""
        return {**self.__dict__, "_cache": None}

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        """Return a pair. Raises DatasetError with the name of an unreadable image file."""
        number = range(len(self))[index]
        rng = pcg_rng("augment", self._seed, int(self._epoch.item()), number)
        images, change = self._cropped(self._images(number), rng), self._augmentation
        if change.flip and rng.random() < 0.5:
            images = images[:, :, ::-1]
        if change.averaged and rng.random() < change.averaged:
            images = _averaged(images, int(rng.choice(_FRAMES_AVERAGED)))
        if change.relief_mm or change.slope_mm_per_px or change.texture:
            added_mm = self._added_mm(images[-1], rng)
            images = np.where(images > 0, images + added_mm, np.float32(0))
        if self.protocol == "paper":
            images = moved_pair(images)
        noisy, target = images[:-1], images[-1:]
        if change.vary_inputs:
            noisy = vary_inputs(noisy, self._inputs, rng)
        return _tensor(noisy), _tensor(target)

    def _added_mm(
        self, target: NDArray[np.float32], rng: np.random.Generator
    ) -> NDArray[np.float32]:
        """Draw random bumps and a random slope to add to the depth, (H, W) mm."""
        change, added_mm = self._augmentation, np.zeros(target.shape, np.float32)
        if change.relief_mm:
            added_mm += sample_surface_bumps(target.shape, change.relief_mm, rng)
        if change.texture and rng.random() < change.texture:
            added_mm += sample_texture(target.shape, rng)
        if change.slope_mm_per_px and (target > 0).any():
            nearest_mm = float(target[target > 0].min())
            added_mm += sample_slope(target.shape, change.slope_mm_per_px, nearest_mm, rng)
        return added_mm

    def _cropped(
        self, images: NDArray[np.float32], rng: np.random.Generator
    ) -> NDArray[np.float32]:
        height, width = images.shape[1:]
        side = self._crop
        if side is None or (height, width) == (side, side):
            return images
        top, left = (height - side) // 2, (width - side) // 2
        if self._cut == "random":
            top, left = (int(rng.integers(free + 1)) for free in (height - side, width - side))
        return images[:, top : top + side, left : left + side]

    def _images(self, number: int) -> NDArray[np.float32]:
        """Read a frame as (C + 1, H, W): the stack of its inputs, then the target."""
        noisy_mm, target_mm = self._layers_of(number)
        positions = ([], []) if self._neighbours is None else self._neighbours.of(number)
        before, after = ([self._layers_of(n, 1)[0] for n in side] for side in positions)
        before, after = ([i for i in s if i.shape == noisy_mm.shape] for s in (before, after))
        stack = stack_inputs(self._inputs, noisy_mm, before, after)
        return np.concatenate([stack, target_mm[None]])

    def _layers_of(self, number: int, count: int = 2) -> NDArray[np.float32]:
        """Read a frame's noisy and target depth, (2, H, W) mm, or perhaps only the first."""
        cache = self._cache if get_worker_info() is None else None
        if cache is not None and number in cache:
            units, offset_mm = cache[number]
        else:
            frame = self.split[number]
            layers = self._layers[: count if cache is None else 2]
            units = np.stack([self._units(frame, layer) for layer in layers])
            offset_mm = float(frame.record["depth_offset_mm"])
            if cache is not None:
                cache[number] = units, offset_mm
        return from_steps(units, self.dataset.depth_unit_mm, offset_mm)

    def _units(self, frame: DepthFrame, layer: str) -> NDArray[np.uint16]:
        """Convert a layer to the uint16 units of its file, (H, W), to halve the cache's memory."""
        depth_mm, offset_mm = frame.layer(f"{layer}_mm"), frame.record["depth_offset_mm"]
        steps = np.rint((depth_mm - np.float32(offset_mm)) / np.float32(frame.step_mm))
        return np.where(depth_mm > 0, steps, 0).astype(np.uint16)


#: Standard deviation of noise on photographs, grey values: Zhang et al. 2017, and a tenth of the
#: range in Monroy et al. 2025.
_GREY_SIGMA: Final = 25.0


class Photographs(PairDataset):
    """Random cuts of photographs with Gaussian noise, (noisy, clean): grey values as 1 to 256 mm.

    Smaller pictures are mirrored at their edges. No pixel is 0, which would be a hole.
    """

    def __init__(self, folder: Path, side: int, seed: int) -> None:
        """List the pictures. Raises DatasetError without any."""
        super().__init__()
        self._files = sorted(file for file in folder.glob("*") if cv2.haveImageReader(str(file)))
        if not self._files:
            raise DatasetError(f"data.photographs = {folder}: holds no pictures")
        self._side, self._seed = side, seed
        sizes = [(file.name, file.stat().st_size) for file in self._files]
        self.identity = f"{zlib.crc32(repr(sizes).encode()):08x}"

    def __len__(self) -> int:
        return len(self._files)

    def __getitem__(self, index: int) -> Batch:
        """Return a pair, (1, H, W) each. Raises DatasetError for an unreadable picture."""
        rng = pcg_rng("photograph", self._seed, int(self._epoch.item()), index)
        grey = cv2.imread(str(self._files[index]), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise DatasetError(f"{self._files[index]}: cannot be read as a picture")
        grey = np.pad(grey, [(0, max(0, self._side - n)) for n in grey.shape], mode="symmetric")
        top, left = (int(rng.integers(size - self._side + 1)) for size in grey.shape)
        clean = grey[top : top + self._side, left : left + self._side].astype(np.float32) + 1
        noisy = clean + np.float32(_GREY_SIGMA) * rng.standard_normal(clean.shape, np.float32)
        return _tensor(np.maximum(noisy, 1)[None]), _tensor(clean[None])


def _tensor(images: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(images))


#: Sizes of bumps (sigma of a Gaussian, px) and their relative heights. They range from creases to
#: cheekbones at 0.9 m (2.5 mm per pixel); all sizes are about equally steep.
_SIZES_PX: Final = (1.2, 2.5, 5.0, 10.0)
_HEIGHTS: Final = (0.25, 0.5, 0.75, 1.0)
#: Sigma of the patches that get bumps, px; the rest of a face stays smooth.
_PATCH_PX: Final = 12.0
#: Share of frames without bumps, and share of bump sizes that become creases.
_UNTOUCHED, _CREASED = 0.25, 0.5
#: Ranges of a texture's period, px, and of its standard deviation, mm; both are log-uniform. Chosen
#: for hair, knitted cloth, chairs, leaves and keys at 0.5 to 2 m; finer ones look like noise.
_PERIOD_PX: Final = (3.0, 12.0)
_TEXTURE_MM: Final = (0.4, 4.0)
#: Numbers of frames of which ``averaged`` imitates the mean.
_FRAMES_AVERAGED: Final = (2, 4, 9)
#: Share of frames without a slope; largest move nearer, as a share of the frame's smallest depth.
_LEVEL, _NEARER = 0.5, 0.5


def sample_surface_bumps(
    shape: tuple[int, int], height_mm: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Draw (H, W) float32 millimetres of bumps and creases to add to depth.

    Without bumps, a network learns the smooth skin of embedded heads, and removes lids, creases and
    nostrils. A pair's noise was drawn for the surface without bumps, which change distance and tilt
    only a little. ``height_mm`` limits the standard deviation of the largest bumps.
    """
    total_mm = np.zeros(shape, np.float32)
    if rng.random() < _UNTOUCHED:
        return total_mm
    for size_px, height in zip(_SIZES_PX, _HEIGHTS, strict=True):
        bumps = _smooth_noise(shape, size_px, rng)
        if rng.random() < _CREASED:
            bumps = (1 - 1.5 * np.abs(bumps)).astype(np.float32)
        patches = np.clip(_smooth_noise(shape, _PATCH_PX, rng), 0, 2)
        total_mm += (height_mm * rng.random() ** 2 * height * bumps * patches).astype(np.float32)
    return total_mm


def sample_texture(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw (H, W) float32 millimetres of ribs or grain, in patches, to add to depth.

    Without textures, a network smooths hair and fabric as if they were noise.
    """
    period_px, height_mm = (
        float(np.exp(rng.uniform(*np.log(limits)))) for limits in (_PERIOD_PX, _TEXTURE_MM)
    )
    if rng.random() < 0.5:
        angle, phase = rng.uniform(0, 2 * np.pi, 2)
        down, right = np.indices(shape)
        along = np.sin(angle) * down + np.cos(angle) * right
        pattern: NDArray[Any] = np.sqrt(2) * np.sin(2 * np.pi * along / period_px + phase)
    else:  # the spectrum falls to half at about the period
        pattern = _smooth_noise(shape, period_px / 5, rng)
    patches = np.clip(0.5 + 2 * _smooth_noise(shape, _PATCH_PX, rng), 0, 1)
    return np.asarray(height_mm * pattern * patches, np.float32)


def _averaged(images: NDArray[np.float32], frames: int) -> NDArray[np.float32]:
    """Divide a frame's noise by the root of a number of frames; ``images`` as in StoredPairs."""
    noisy, target = images[0], images[-1]
    error = noisy - target
    same = (noisy > 0) & (target > 0) & (np.abs(error) < FLYING_MM)  # larger: flying pixels
    averaged = images.copy()
    averaged[0] = np.where(same, target + error / np.float32(math.sqrt(frames)), noisy)
    return averaged


def sample_slope(
    shape: tuple[int, int], largest_mm_per_px: float, nearest_mm: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Draw (H, W) float32 millimetres to add to depth: a random plane, 0 at the image centre.

    Training frames show mostly people and walls: without slopes a network bends floors.

    Args:
        largest_mm_per_px: largest slope; small slopes are more frequent.
        nearest_mm: smallest depth of the frame; the slope leaves at least half of it.
    """
    if rng.random() < _LEVEL:
        return np.zeros(shape, np.float32)
    angle = rng.uniform(0, 2 * np.pi)
    down, right = (np.arange(size, dtype=np.float32) - (size - 1) / 2 for size in shape)
    plane = np.sin(angle) * down[:, None] + np.cos(angle) * right
    slope = largest_mm_per_px * rng.random() ** 2
    limit = _NEARER * nearest_mm / max(float(np.abs(plane).max()), 1e-6)
    return np.asarray(min(slope, limit) * plane, np.float32)


def _smooth_noise(
    shape: tuple[int, int], sigma_px: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Draw blurred Gaussian noise with variance 1, (H, W) float32."""
    white = rng.standard_normal(shape, dtype=np.float32)
    smooth = np.asarray(cv2.GaussianBlur(white, (0, 0), sigma_px), np.float32)
    return smooth / max(float(smooth.std()), 1e-6)
