"""What a noise stage knows about the frame besides its layers."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.frame import Rect

#: Layers by name: (h, w) or (h, w, components) float32 arrays of the window.
Layers = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class FrameContext:
    """The frame that a chain runs on.

    window: the part of the frame that layers hold; width, height: of the whole frame, pixels.
    seed, sequence_seed, device_seed: 64-bit. time_s: since the start of the sequence.
    focal_baseline_px_m: focal length times baseline, pixels times metres; 0 without an emitter.
    """

    window: Rect
    width: int
    height: int
    seed: int
    sequence_seed: int
    device_seed: int
    time_s: float
    focal_baseline_px_m: float

    def view(self, stage: str) -> StageView:
        """The same for one stage, with seeds of its own. ``stage`` is its name in the chain."""
        return StageView(
            self.window,
            self.width,
            self.height,
            _stage_seed(self.seed, stage),
            _stage_seed(self.sequence_seed, stage),
            _stage_seed(self.device_seed, stage),
            self.time_s,
            self.focal_baseline_px_m,
        )


@dataclass(frozen=True)
class StageView:
    """FrameContext as one stage sees it: the seeds are 32-bit and the stage's own."""

    window: Rect
    width: int
    height: int
    seed: int
    sequence_seed: int
    device_seed: int
    time_s: float
    focal_baseline_px_m: float


def _stage_seed(seed: int, stage: str) -> int:
    """32 bits that depend on the stage's name, so that a new stage changes no other's noise."""
    return zlib.crc32(struct.pack("<Q", seed), zlib.crc32(stage.encode()))
