"""What a noise stage knows about the frame besides its layers."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.camera import SensorRig
from glsim.frame import Rect

#: Layers by name: (h, w) or (h, w, components) float32 arrays of the window.
Layers = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Optics:
    """What stages that add light up know about the rig and the scene.

    emitter_m: the middle of the emitters, camera frame. modulation_mhz: three frequencies.
    supersample: samples a pixel along each axis in the fine layers (1: they are the layers).
    nearest_m: nothing in the scene is nearer. focal_px: of the columns.
    """

    emitter_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    modulation_mhz: tuple[float, ...] = ()
    supersample: int = 1
    nearest_m: float = 0.0
    focal_px: float = 1.0

    @classmethod
    def of(cls, rig: SensorRig, nearest_m: float, supersample: int | None = None) -> Optics:
        """Of a rig; supersample: where it is not the rig's."""
        samples = rig.supersample if supersample is None else supersample
        return cls(rig.emitter_m, rig.modulation_mhz, samples, nearest_m, rig.intrinsics.fx)


@dataclass(frozen=True)
class _View:
    """What FrameContext and StageView have in common.

    window: the part of the frame that layers hold; width, height: of the whole frame, pixels.
    time_s: since the start of the sequence.
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
    optics: Optics = Optics()


@dataclass(frozen=True)
class StageView(_View):
    """A frame as one stage sees it: the seeds are 32-bit and the stage's own."""


@dataclass(frozen=True)
class FrameContext(_View):
    """The frame that a chain runs on. The seeds are 64-bit."""

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
            self.optics,
        )


def _stage_seed(seed: int, stage: str) -> int:
    """32 bits that depend on the stage's name, so that a new stage changes no other's noise."""
    return zlib.crc32(struct.pack("<Q", seed), zlib.crc32(stage.encode()))
