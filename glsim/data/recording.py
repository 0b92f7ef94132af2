"""The depth maps of one camera on disk: frames, stated camera, and remarks for the user."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from glsim.core.camera import DEFAULT_INTRINSICS, Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import DatasetError, counted
from glsim.data.recordings.camera_file import StatedCamera
from glsim.data.recordings.files import SHOWN, VOTERS, MapFiles, Votes, spread
from glsim.data.recordings.names import is_infrared, left_out_text
from glsim.data.recordings.recognition import Camera, recognise_camera
from glsim.data.recordings.streams import FrameStream
from glsim.measures.static import longest_still, mask_moving, view_change

FrameReader = MapFiles | FrameStream

#: Largest number of frames that are measured; more frames do not change the printed digits.
DEFAULT_FRAMES = 60
#: Largest number of frames of a static scene that are measured. They take 1.2 GB with infrared at
#: 848 x 480, and give a pixel's standard deviation with an error far below its spread over pixels.
MOST_STATIC = 256
#: Smallest share of depths at rest in a recording to measure. Chosen: a person before a room covers
#: half of it; of a camera that moves less stays.
#: And largest share of frames that still differ from the next when what moves is masked.
_LEAST_STILL, _MOST_CHANGES = 0.2, 0.2
#: Smallest number of frames at rest that is proposed. Chosen.
_LEAST_RUN = 8
#: Smallest side of a depth frame, px: slopes and 3 x 3 windows need neighbours.
_LEAST_PX = 8
#: A long recording is thinned in groups of this number of frames, so that static pairs stay.
_RUN = 4


@dataclass(frozen=True, eq=False)
class Recording:
    """The frames of one camera on disk, in the order of their names.

    Attributes:
        path: the folder, or the first of several files.
        kind: "data set", "images", "npy", "libfreenect2", "biwi", "bag" or "mkv".
        reader: reader of the files; None for a data set.
        stated: the stated camera; its lens distortion is not removed from the frames.
        left_out: file-name pattern of images that are not read -> number of images.
        outputs: relative path of each changed map when it is written.
        protocol: origin of the depths in the files; frames always have measured depths.
        assumed: name of the sensor whose intrinsics are assumed; "" for stated intrinsics.
        assumed_camera: these intrinsics, for maps of the size of the first.
        seen: ``recognised``, if opening the recording has found it.
        is_one_camera: whether ``stated`` holds for every frame; False for crops, several cameras.
        simulated_by: sensor of glsim whose noise the frames have; "" if none is known.
    """

    path: Path
    kind: str
    frames: Frames
    reader: FrameReader | None = None
    stated: StatedCamera = field(default_factory=StatedCamera)
    stated_by: Path | None = None
    notes: tuple[str, ...] = ()
    left_out: Counter[str] = field(default_factory=Counter)
    outputs: tuple[Path, ...] = ()
    protocol: DepthProtocol = "depth"
    assumed: str = ""
    layer: str = "noisy_mm"
    is_one_camera: bool = True
    simulated_by: str = ""
    assumed_camera: Intrinsics = DEFAULT_INTRINSICS
    seen: Camera | None = None

    @property
    def camera(self) -> Intrinsics | None:
        """Intrinsics that the recording states, or None."""
        return self.stated.intrinsics

    def sentence(
        self, focal_px: float | None = None, taken: str = "", *, camera: bool = True,
        real: bool = False,
    ) -> str:  # fmt: skip
        """Describe what is left out and assumed, for every command; "" if there is nothing.

        Args:
            taken: name of the sensor whose intrinsics are used. Default: ``assumed``.
            camera: whether the intrinsics matter.
            real: whether the command measures a real camera.
        """
        remarks = list(self.notes)
        if real and self.simulated_by:
            remarks.append(f"is simulated by {self.simulated_by}, and no record of a camera")
        if real and (folders := len({file.parent for file in self.sources})) > 1:
            remarks.append(f"its {folders} folders are read as one camera: give each by itself")
        left_out = self.left_out
        if left_out and self.first_without_infrared() is None:  # infrared images are used
            left_out = Counter({name: n for name, n in left_out.items() if not is_infrared(name)})
        if left_out:
            remarks.append(f"left out {left_out_text(left_out)}")
        if camera and self.assumed and focal_px is None:
            at = self.assumed_camera
            taken = taken or f"{self.assumed} (f {at.fx:.0f} px for {at.width}x{at.height})"
            remarks.append(
                f"states no intrinsics: those of {taken} are taken; a camera.toml states them"
            )
        return f"{self.path}: {'; '.join(remarks)}" if remarks else ""

    @property
    def sources(self) -> list[Path]:
        """The file of each map."""
        if self.reader is None:
            return [self.path / output for output in self.outputs]
        return [self.reader.files(number)[0] for number in range(len(self.reader))]

    @property
    def step_mm(self) -> float:
        """Step of integers, mm."""
        return (self.stated.unit_mm if self.reader is None else self.reader.step_mm) or 1.0

    @property
    def has_infrared(self) -> bool:
        """Whether some maps have an infrared image."""
        if self.reader is None:
            return "infrared" in self.frames[0]
        return any(map(self.reader.has_infrared_of, range(len(self.reader))))

    def first_without_infrared(self) -> Path | None:
        """Return the first file of a map that has no infrared image; None if all have one."""
        if self.reader is None:
            return None if "infrared" in self.frames[0] else self.path
        has, numbers = self.reader.has_infrared_of, range(len(self.reader))
        lacking = next((number for number in numbers if not has(number)), None)
        return None if lacking is None else self.reader.files(lacking)[0]

    @cached_property
    def recognised(self) -> Camera:
        """The shipped sensor whose images and depths are most like the recording's."""
        return self.seen or recognise_camera(self.stated, self.stated_by, self.votes)

    @cached_property
    def votes(self) -> Votes:
        """Facts about at most 16 sampled maps; for files, the maps that decided on the unit."""
        if isinstance(self.reader, MapFiles):
            return self.reader.votes
        frames = [self.frames[number] for number in spread(len(self.frames), VOTERS)]
        maps_mm = [frame.layer(self.layer) for frame in frames]
        deepest_mm = max(float(depth_mm.max(initial=0)) for depth_mm in maps_mm)
        return Votes(tuple(maps_mm[:SHOWN]), frames[0].step_mm, deepest_mm)

    @property
    def distortion(self) -> tuple[float, ...]:
        """Coefficients of the lens in OpenCV's order; empty without a lens."""
        return self.stated.distortion

    def read(self, most: int | None = None, focal_px: float | None = None) -> Frames:
        """Read the frames into memory, but for exact copies of the frame before each.

        The ``note`` of the result says how many frames of the recording it has.

        Raises DatasetError: a file cannot be read, sizes differ, no depth, or all are copies.

        Args:
            most: largest number of frames; of a longer recording, evenly spread groups of four
                consecutive frames are read. Default: all.
            focal_px: focal length that replaces the camera's, px.
        """
        numbers = _chosen(len(self.frames), most or len(self.frames))
        frames = [self.frames[number] for number in numbers]
        where = str(self.path)
        check_sizes([(frame.name, frame.noisy_mm.shape) for frame in frames], where)
        check_least_size(frames[0].noisy_mm.shape, where)
        for frame in frames:
            if frame.infrared is not None:
                pair = [("depth", frame.noisy_mm.shape), ("infrared", frame.infrared.shape)]
                check_sizes(pair, f"{where}: {frame.name}")
        if not any(frame.noisy_mm.any() for frame in frames):
            raise DatasetError(f"{where}: no pixel of any frame has depth (all are 0)")
        whole = frames  # a frozen stream, or a recorder faster than its camera, repeats frames
        pairs = pairwise(whole)
        frames = whole[:1] + [b for a, b in pairs if not np.array_equal(a.noisy_mm, b.noisy_mm)]
        if len(frames) == 1 < len(whole):
            raise DatasetError(
                f"{where}: the {len(whole)} frames read are copies: record a live stream"
            )
        if focal_px is not None:
            camera = replace(frames[0].intrinsics, fx=focal_px, fy=focal_px)
            frames = [frame.changed(intrinsics=camera) for frame in frames]
        taken = f"{len(frames)} of {counted(len(self.frames), 'frame')}"
        taken += ", without copies of the frame before" * (len(frames) < len(whole))
        return Frames.of(frames, self.path.name or where, taken)

    def read_static(self, most: int | None = MOST_STATIC, part: slice = slice(None)) -> Frames:
        """Read the frames of a camera at rest, without the depth of what moves before it.

        If at least half of the frames have infrared, frames without it are left out.

        Returns the frames; ``note`` says how many, and how much of them was at rest.

        Raises the errors of ``read``; DatasetError for a single frame and if too little is at rest.
        """
        chosen = range(*part.indices(len(self.frames)))
        if len(chosen) < 2:
            some = counted(len(chosen), "frame") + " in --frames" * (len(self.frames) > 1)
            raise DatasetError(
                f"{self.path}: has {some}; noise is measured between frames: record 60 "
                "frames or more of a camera at rest"
            )
        picked = self.frames[part]
        frames = replace(self, frames=picked).read(most)
        still, share = mask_moving(frames)
        changes = [reason for a, b in pairwise(still) if (reason := view_change(a, b, parts=False))]
        if share < _LEAST_STILL or len(changes) > _MOST_CHANGES * (len(still) - 1):
            first, last = longest_still(frames)
            advice = "record 60 frames or more of a camera that does not move"
            if last - first >= _LEAST_RUN:
                advice = f"the longest rest is {frames[first].name} to {frames[last - 1].name}"
                if len(frames) == len(picked):
                    advice += f": --frames {chosen[first]}:{chosen[last - 1] + 1}"
            raise DatasetError(
                f"{self.path}: the frames show different scenes ("
                + (changes[0] if changes else f"{100 * share:.0f} % of the depths are at rest")
                + f"): {advice}"
            )
        note = f"{frames.note}; {100 * share:.0f} % of the depths rest"
        frames = Frames.of(still, frames.title, note)
        lit = [frame for frame in frames if frame.infrared is not None]
        if len(lit) == len(frames) or not lit:
            return frames
        if 2 * len(lit) < len(frames):
            raise DatasetError(
                f"{self.path}: {len(lit)} of {len(frames)} frames have an infrared image: give it "
                "for all or for none"
            )
        return Frames.of(lit, frames.title, note)


def check_least_size(shape: tuple[int, ...], where: object) -> None:
    """Raise DatasetError if an (H, W) depth map is too small to be measured."""
    if min(shape) < _LEAST_PX:
        raise DatasetError(
            f"{where}: has {shape[1]} x {shape[0]} pixels: a depth frame has at least {_LEAST_PX}"
        )


def check_sizes(frames: Sequence[tuple[str, tuple[int, ...]]], where: str) -> None:
    """Raise DatasetError if images, given as (name, shape), differ in size."""
    for name, shape in frames[1:]:
        if shape != frames[0][1]:
            first, size = frames[0]
            raise DatasetError(
                f"{where}: {name} is {shape[1]}x{shape[0]}, but {first} is {size[1]}x{size[0]}: "
                "give frames of one camera in one mode"
            )


def _chosen(count: int, most: int) -> list[int]:
    """Return at most ``most`` frame numbers: evenly spread groups of consecutive frames."""
    if count <= most:
        return list(range(count))
    run = min(most, _RUN)
    starts = np.linspace(0, count - run, most // run).round().astype(int)
    return sorted({int(start) + step for start in starts for step in range(run)})
