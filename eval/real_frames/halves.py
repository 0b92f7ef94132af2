"""A recording on which denoisers are scored: its static pairs, its tuning and scoring halves."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import Frames
from glsim.data.maps import open_maps
from glsim.data.recording import DEFAULT_FRAMES, Recording
from glsim.measures.boards import PATTERN
from glsim.measures.static import static_pairs

#: Side of an image tile, px. Chosen: three times the widest filter that tuning tries, so that most
#: pixels of a tile are denoised from no pixel of the next tile.
TILE_PX: Final = 64
#: Fewest static scenes for halves and intervals over scenes, not tiles. Chosen, not measured.
LEAST_SCENES: Final = 6


@dataclass(frozen=True)
class Source:
    """The path and settings with which a worker process reads a recording."""

    path: Path
    focal_px: float | None = None
    pattern: tuple[int, int] = PATTERN
    unit_mm: float | None = None
    topic: str | None = None


@dataclass(frozen=True, eq=False)
class SplitRecording:
    """A recording with its static scenes and its units, which are scenes or image tiles.

    Attributes:
        partner: frame -> another frame of the same static scene.
        scene: frame -> number of the static scene.
    """

    source: Source
    recording: Recording
    frames: Frames
    partner: dict[int, int]
    scene: dict[int, int]

    @property
    def scenes(self) -> int:
        """Number of scenes with at least two static frames."""
        return len(set(self.scene.values()))

    @property
    def by_scene(self) -> bool:
        """Whether units of tuning, scoring and intervals are scenes; else they are image tiles."""
        return self.scenes >= LEAST_SCENES

    @property
    def _tiles_across(self) -> int:
        return -(-self.frames.intrinsics.width // TILE_PX)

    @property
    def unit_count(self) -> int:
        """Number of units (scenes or tiles)."""
        tiles = self._tiles_across * -(-self.frames.intrinsics.height // TILE_PX)
        return self.scenes if self.by_scene else tiles

    def units(self, frame: int) -> NDArray[np.int64]:
        """Return the number of the scene or tile of each pixel: (H, W) int64."""
        shape = self.frames[frame].measured_mm.shape
        if self.by_scene:
            return np.full(shape, self.scene.get(frame, 0), np.int64)
        rows, columns = (np.arange(size) // TILE_PX for size in shape)
        return rows[:, None] * self._tiles_across + columns[None]

    def tuning_units(self) -> NDArray[np.bool_]:
        """Mark the units for tuning: every second scene, or every second tile (chessboard)."""
        units = np.arange(self.unit_count)
        if not self.by_scene:
            units = units // self._tiles_across + units % self._tiles_across
        return np.asarray(units % 2 == 0)

    def checksums(self) -> dict[str, str]:
        """Return frame name -> checksum of its depth and infrared."""
        sums = {}
        for frame in self.frames:
            digest = hashlib.blake2b(frame.measured_mm.tobytes(), digest_size=8)
            if frame.infrared is not None:
                digest.update(frame.infrared.tobytes())
            sums[frame.name] = digest.hexdigest()
        return sums


def split_recording(source: Source) -> SplitRecording:
    """Read a recording and find its static scenes. Raises the errors of ``open_maps``."""
    recording = open_maps(source.path, unit_mm=source.unit_mm, topic=source.topic)
    frames = recording.read(DEFAULT_FRAMES, source.focal_px)
    partner: dict[int, int] = {}
    scene: dict[int, int] = {}
    for first, second in static_pairs(frames):
        partner[first] = second
        partner.setdefault(second, first)
        number = scene.setdefault(first, len(set(scene.values())))
        scene[second] = number
    return SplitRecording(source, recording, frames, partner, scene)
