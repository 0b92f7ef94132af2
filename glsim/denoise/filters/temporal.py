"""Filters over neighbouring frames of a sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glsim.core.array_types import Depth, Mask
from glsim.denoise.parameters import parameter
from glsim.networks.inputs import past_mean
from glsim.networks.interface import Denoised, DepthFunction


@dataclass
class TemporalMedian(DepthFunction):
    """Median over neighbouring frames of a sequence; valid where most of the frames are valid."""

    frames: int = parameter(3, 3, 15, "number of frames, centred on the filtered one")

    def __post_init__(self) -> None:
        self.before = self.after = self.frames // 2

    def __call__(
        self, noisy_mm: Depth, valid: Mask, now: int, infrared: Depth | None = None
    ) -> Denoised:
        """Compute medians of valid depths; of an even number, the mean of the middle two."""
        count = valid.sum(axis=0)
        ordered = np.sort(np.where(valid, noisy_mm, np.inf), axis=0)
        low, high = (
            np.take_along_axis(ordered, middle[None], axis=0)[0]
            for middle in (np.maximum(count - 1, 0) // 2, np.minimum(count // 2, len(valid) - 1))
        )
        kept = 2 * count > len(valid)
        middle = np.where(kept, 0.5 * (np.where(kept, low, 0) + np.where(kept, high, 0)), 0)
        return Denoised(middle.astype(np.float32), kept)


@dataclass
class Adaptive(DepthFunction):
    """Temporal mean with a threshold, after Essmaeel et al. 2012; a single frame stays unchanged.

    The paper ran its "adaptive threshold 15" on single frames, as frames=1 does: its row equals its
    baseline in every digit. With more frames each pixel is the mean over past frames, as far back
    as its depth stays within the threshold, so moving surfaces are not smeared. Essmaeel et al.
    make the threshold grow with distance; for one face at one distance it is a constant.
    """

    threshold_mm: float = parameter(15.0, 0.1, 1000, "a larger change of depth counts as motion")
    frames: int = parameter(1, 1, 30, "number of frames, with the filtered one")

    def __post_init__(self) -> None:
        self.before = self.frames - 1

    def __call__(
        self, noisy_mm: Depth, valid: Mask, now: int, infrared: Depth | None = None
    ) -> Denoised:
        """Compute means over past frames; pixels are valid where the input is."""
        return Denoised(past_mean(noisy_mm[: now + 1], self.threshold_mm), valid[now])


FILTERS = {"adaptive": Adaptive, "temporal_median": TemporalMedian}
