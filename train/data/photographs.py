"""Photographs with Gaussian noise as pairs of depth maps: what image denoisers are trained on."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import torch
from torch import Tensor

from glsim.errors import DatasetError
from glsim.settings.seeds import pcg_rng
from glsim.train.data.pairs import PairDataset
from glsim.train.data.photograph_files import Photograph

#: Largest grey level.
_WHITE: Final = 255.0
#: Noise does not make a hole: the smallest depth, mm.
_NEAREST_MM: Final = 1.0
#: Share of a frame's pixels beyond its farthest depth: ears and rims have few.
_BEYOND_PCT: Final = 1.0


class DepthSpan(NamedTuple):
    """What grey levels stand for: 0 is near_mm, 255 is near_mm + span_mm."""

    near_mm: float
    span_mm: float


def measure_span(clean_mm: Iterable[Tensor]) -> DepthSpan:
    """Return the depths between which heads lie: medians over (1, H, W) clean maps.

    Raises DatasetError if no map has depth.
    """
    ends = []
    for depth in clean_mm:
        valid = depth[depth > 0].numpy()
        if valid.size:
            ends.append((valid.min(), np.percentile(valid, 100 - _BEYOND_PCT)))
    if not ends:
        raise DatasetError("no clean map has depth: grey levels cannot be mapped to depths")
    near, far = np.median(ends, axis=0)
    return DepthSpan(float(near), float(max(far - near, 1.0)))


def photograph_fingerprint(
    photographs: Sequence[Photograph], span: DepthSpan, sigma_grey: float
) -> dict[str, Any]:
    """Identify the photographs and their mapping in a checkpoint."""
    names = [f"{p.name} {zlib.crc32(p.grey.tobytes()):08x}" for p in photographs]
    return {
        "photographs": len(names),
        "photographs_crc32": f"{zlib.crc32(repr(names).encode()):08x}",
        "sigma_grey": sigma_grey,
        "near_mm": round(span.near_mm, 3),
        "span_mm": round(span.span_mm, 3),
    }


class PhotographPairs(PairDataset):
    """``pairs[n]`` is (noisy_mm, clean_mm), (1, side, side) float32, without holes.

    A random part of a random photograph, mirrored with probability 1/2, with Gaussian noise. The
    same (seed, epoch, n) gives the same pair.
    """

    def __init__(
        self,
        photographs: Sequence[Photograph],
        span: DepthSpan,
        sigma_grey: float,
        *,
        side: int,
        length: int,
        seed: int,
    ) -> None:
        """Take the noise's standard deviation, grey levels of 255, and the number of pairs."""
        super().__init__()
        self._photographs, self._span, self._sigma = list(photographs), span, sigma_grey
        self._side, self._length, self._seed = side, length, seed

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        """Return one pair."""
        number = range(len(self))[index]
        rng = pcg_rng("photograph", self._seed, int(self._epoch.item()), number)
        grey = self._photographs[int(rng.integers(len(self._photographs)))].grey
        top, left = (int(rng.integers(size - self._side + 1)) for size in grey.shape)
        part = grey[top : top + self._side, left : left + self._side].astype(np.float32)
        if rng.random() < 0.5:
            part = part[:, ::-1]
        noise = rng.normal(0.0, self._sigma, part.shape).astype(np.float32)
        scale = np.float32(self._span.span_mm / _WHITE)
        clean, noisy = (
            np.maximum(self._span.near_mm + scale * image, _NEAREST_MM).astype(np.float32)
            for image in (part, part + noise)
        )
        return torch.from_numpy(noisy[None].copy()), torch.from_numpy(clean[None].copy())
