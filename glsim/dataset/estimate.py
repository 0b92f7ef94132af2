"""Estimate a data set from its plan: images by source, subject and split, bytes, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from glsim.faces.base import FaceSource
from glsim.plan.tasks import Plan
from glsim.settings.schema import SPLIT_NAMES, Settings

#: Bytes a pixel of a layer that shows a room or a wall, and of one that shows a face alone, which
#: has at most FACE_BYTES; bytes of a record; measured with kinect-v2.
ROOM_BYTES_PER_PX, FACE_BYTES_PER_PX, FACE_BYTES, RECORD_BYTES = 0.9, 0.4, 20_000, 1_600
#: Pixels of an image that is not cropped: kinect-v2.
IMAGE_PX = 512 * 424
#: Seconds of one core for a frame in a room, and of a face alone: measured with kinect-v2 on a
#: two-core cloud machine with Mesa's software rasteriser (on a slower one 0.172 and 0.035).
ROOM_S, FACE_S = 0.12, 0.025


@dataclass(frozen=True)
class DatasetEstimate:
    """The expected contents, size and time of a data set.

    Attributes:
        by_source: "number kind" of each source -> (people, images).
        by_split: split -> (people, images).
        bytes: of all images and records.
        core_seconds: time of one core.
    """

    by_source: Mapping[str, tuple[int, int]]
    by_split: Mapping[str, tuple[int, int]]
    bytes: int
    core_seconds: float

    @property
    def frames(self) -> int:
        """The number of frames (pairs of images)."""
        return sum(images for _, images in self.by_split.values())


def estimate_dataset(
    settings: Settings, sources: Sequence[FaceSource], plan: Plan
) -> DatasetEstimate:
    """Estimate a data set. Nothing is rendered or written.

    Args:
        settings: their layers, crop and scene decide the size.
        sources: the open face sources of the plan.
        plan: the frames to count.
    """
    by_source: dict[str, tuple[int, int]] = {}
    by_split = dict.fromkeys(SPLIT_NAMES, (0, 0))
    for person in plan.people():
        name = f"{person.source} {sources[person.source].name}"
        for sums, key in ((by_source, name), (by_split, person.split)):
            people, images = sums.get(key, (0, 0))
            sums[key] = people + 1, images + person.frames
    crop, layers = settings.output.crop, len(settings.output.layers)
    image_px = IMAGE_PX if crop is None else crop**2
    in_room = settings.scene.room != "none" or settings.scene.wall_mm is not None
    face_bytes = min(FACE_BYTES_PER_PX * image_px, FACE_BYTES)
    layer_bytes = ROOM_BYTES_PER_PX * image_px if in_room else face_bytes
    total = round(len(plan) * (layers * layer_bytes + RECORD_BYTES))
    return DatasetEstimate(by_source, by_split, total, len(plan) * (ROOM_S if in_room else FACE_S))
