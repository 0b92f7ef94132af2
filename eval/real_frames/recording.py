"""A recording to score on: its frames, static pairs, and halves for tuning and scoring."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.compare.boards import PATTERN
from glsim.compare.frames import DEFAULT_FRAMES, DepthFrame, read_frame_set
from glsim.compare.temporal import static_pairs

#: Side of a tile of the image, px: some three times the widest filter that tuning tries, so that
#: most of a tile's pixels share no input with the next tile.
TILE_PX: Final = 64
#: With at least so many static scenes, the halves for tuning and scoring are scenes, and intervals
#: are over scenes; with fewer, both are of tiles of the image.
LEAST_SCENES: Final = 6


@dataclass(frozen=True)
class Source:
    """Where the frames are: what a worker needs to read them again."""

    path: Path
    focal_px: float | None = None
    most: int = DEFAULT_FRAMES
    pattern: tuple[int, int] = PATTERN


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames; partner: frame -> another frame of its static scene; scene: frame -> number.

    by_scene: whether the units of tuning, scoring and intervals are scenes (else tiles).
    """

    source: Source
    frames: tuple[DepthFrame, ...]
    partner: dict[int, int]
    scene: dict[int, int]

    @property
    def scenes(self) -> int:
        """The number of scenes with at least two static frames."""
        return len(set(self.scene.values()))

    @property
    def by_scene(self) -> bool:
        """Whether there are enough scenes to split and to resample them."""
        return self.scenes >= LEAST_SCENES

    def units(self, frame: int) -> NDArray[np.int64]:
        """Return (H, W) the number of the unit of each pixel: its scene, or its tile."""
        shape = self.frames[frame].depth_mm.shape
        if self.by_scene:
            return np.full(shape, self.scene[frame], np.int64)
        rows, columns = (np.arange(size) // TILE_PX for size in shape)
        return rows[:, None] * self._tiles_across + columns[None]

    def is_tuning_unit(self, unit: int) -> bool:
        """Whether a unit is of the half for tuning: every second scene; tiles as a chessboard."""
        if self.by_scene:
            return unit % 2 == 0
        return sum(divmod(unit, self._tiles_across)) % 2 == 0

    @property
    def _tiles_across(self) -> int:
        return -(-self.frames[0].camera.width // TILE_PX)

    def checksums(self) -> dict[str, str]:
        """Return frame -> checksum of its depth and infrared as they were read."""
        sums = {}
        for frame in self.frames:
            digest = hashlib.blake2b(frame.depth_mm.tobytes(), digest_size=8)
            if frame.infrared is not None:
                digest.update(frame.infrared.tobytes())
            sums[frame.name] = digest.hexdigest()
        return sums


def open_recording(source: Source) -> Recording:
    """Read a recording and find its static frames. Raises what ``read_frame_set`` raises."""
    frames = read_frame_set(source.path, focal_px=source.focal_px, most=source.most).frames
    partner: dict[int, int] = {}
    scene: dict[int, int] = {}
    for first, second in static_pairs(frames):
        partner[first] = second
        partner.setdefault(second, first)
        number = scene.setdefault(first, len(set(scene.values())))
        scene[second] = number
    return Recording(source, frames, partner, scene)
