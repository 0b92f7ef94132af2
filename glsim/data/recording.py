"""The depth maps of one camera on disk: its frames, its camera, and what is said of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import DatasetError
from glsim.data.recordings.camera_file import StatedCamera
from glsim.data.recordings.files import SHOWN, VOTERS, MapFiles, Votes, spread
from glsim.data.recordings.names import is_infrared, left_out_text
from glsim.data.recordings.streams import FrameStream
from glsim.measures.static import view_change

#: What reads the frames of a recording.
FrameReader = MapFiles | FrameStream

#: Frames that are measured if a recording has more; more do not change the printed digits.
DEFAULT_FRAMES = 60
#: Frames of a static scene that are measured if a recording has more: 1.2 GB with infrared at
#: 848 x 480, and the noise of 1 % in the standard deviation of a pixel is far below its spread.
MOST_STATIC = 256
#: Shortest side of a depth frame, pixels: slopes and 3 x 3 windows need some.
_LEAST_PX = 8
#: Consecutive frames that are kept together, so that static pairs stay pairs.
_RUN = 4


@dataclass(frozen=True, eq=False)
class Recording:
    """The frames of one camera on disk, in the order of their names.

    Attributes:
        path: the folder, or the first of several files.
        kind: "data set", "images", "npy", "libfreenect2", "biwi", "bag" or "mkv".
        frames: the frames, which are read one by one.
        reader: the files of the frames; None of a data set.
        stated: what the recording says about its camera; its distortion is not removed.
        stated_by: the file that says so; None without one.
        notes: what is chosen, and what the recording does not say, in lines for the user.
        left_out: patterns of the images of folders that are no such depth -> their number.
        outputs: relative path of each map below the input, as changed maps are named.
        protocol: where the depths of the files are counted from; frames hold them as measured.
        layer: name of the depth in the frames, "noisy_mm" or another.
        assumed: name of the sensor whose intrinsics the frames have; "" if they are stated.
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

    @property
    def camera(self) -> Intrinsics | None:
        """Intrinsics that the recording states; None without them."""
        return self.stated.intrinsics

    def sentence(
        self, focal_px: float | None = None, taken: str = "", *, camera: bool = True
    ) -> str:
        """Say what is left out and assumed; every command prints this sentence. "": nothing.

        Args:
            focal_px: focal length by an option, pixels.
            taken: name of the sensor whose intrinsics are taken; default: the assumed one.
            camera: whether the intrinsics matter.
        """
        remarks = list(self.notes)
        left_out = self.left_out
        if left_out and self.first_without_infrared() is None:  # infrared images are used
            left_out = Counter({name: n for name, n in left_out.items() if not is_infrared(name)})
        if left_out:
            remarks.append(f"left out {left_out_text(left_out)}")
        if camera and self.camera is None and focal_px is None:
            taken = taken or self.assumed
            remarks.append(
                f"states no intrinsics: those of {taken} are taken; a camera.toml beside it states "
                "them"
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
        """The step of whole numbers, mm."""
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
    def votes(self) -> Votes:
        """What at most 16 maps show, evenly spread: of files those that voted on the unit."""
        if isinstance(self.reader, MapFiles):
            return self.reader.votes
        numbers = spread(len(self.frames), VOTERS)
        frames = [self.frames[number] for number in numbers]
        maps_mm = [frame.layer(self.layer) for frame in frames]
        deepest_mm = max(float(depth_mm.max(initial=0)) for depth_mm in maps_mm)
        return Votes(tuple(maps_mm[:SHOWN]), frames[0].step_mm, deepest_mm)

    @property
    def distortion(self) -> tuple[float, ...]:
        """Coefficients of the lens in OpenCV's order; empty without."""
        return self.stated.distortion

    def read(self, most: int | None = None, focal_px: float | None = None) -> Frames:
        """Read the frames into memory.

        Args:
            most: largest number of frames; a longer recording is thinned evenly, in runs of four
                consecutive frames. Default: all.
            focal_px: overrides the camera's focal length, pixels.

        Raises:
            DatasetError: a file cannot be read, sizes differ, or no pixel has depth.
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
        if focal_px is not None:
            camera = replace(frames[0].intrinsics, fx=focal_px, fy=focal_px)
            frames = [frame.changed(intrinsics=camera) for frame in frames]
        return Frames.of(frames, self.path.name or where)

    def read_static(self, most: int | None = MOST_STATIC) -> Frames:
        """Read the frames of one static scene; a longer recording is thinned as by ``read``.

        Where half of the frames or more have infrared, the others are left out.

        Raises DatasetError as ``read`` does, for a single frame, and for a scene that changes.
        """
        if len(self.frames) < 2:
            raise DatasetError(
                f"{self.path}: has one frame only; noise is measured between frames: record at "
                "least 30 frames of a scene in which nothing moves"
            )
        frames = self.read(most)
        for before, after in pairwise(frames):
            if reason := view_change(before, after):
                raise DatasetError(
                    f"{self.path}: {before.name} and {after.name} show different scenes "
                    f"({reason}): give a static recording, one camera and nothing that moves"
                )
        lit = [frame for frame in frames if frame.infrared is not None]
        if len(lit) == len(frames) or not lit:
            return frames
        if 2 * len(lit) < len(frames):
            raise DatasetError(
                f"{self.path}: {len(lit)} of {len(frames)} frames have an infrared image: give it "
                "for all or for none"
            )
        return Frames.of(lit, frames.title)


def check_least_size(shape: tuple[int, ...], where: object) -> None:
    """Raise DatasetError if an (H, W) depth map is too small to be measured."""
    if min(shape) < _LEAST_PX:
        raise DatasetError(
            f"{where}: has {shape[1]} x {shape[0]} pixels: a depth frame has at least {_LEAST_PX} "
            f"x {_LEAST_PX}"
        )


def check_sizes(frames: Sequence[tuple[str, tuple[int, ...]]], where: str) -> None:
    """Raise DatasetError if named images, (name, shape) each, differ in size."""
    for name, shape in frames[1:]:
        if shape != frames[0][1]:
            first, size = frames[0]
            raise DatasetError(
                f"{where}: {name} is {shape[1]}x{shape[0]}, but {first} is {size[1]}x{size[0]}: "
                "give frames of one camera in one mode"
            )


def _chosen(count: int, most: int) -> list[int]:
    """Return the numbers of at most ``most`` frames, evenly spread runs of consecutive ones."""
    if count <= most:
        return list(range(count))
    run = min(most, _RUN)
    starts = np.linspace(0, count - run, most // run).round().astype(int)
    return sorted({int(start) + step for start in starts for step in range(run)})
