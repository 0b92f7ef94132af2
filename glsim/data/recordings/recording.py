"""Find the frames of a recording, and read them: every format that glsim knows.

- data sets of glsim: their noisy layer and infrared.
- folders of 16-bit PNG or TIFF files; infrared beside them (``_ir``, ``_infrared``) or in a folder
  ``ir`` or ``infrared`` beside the folder ``depth``. iai_kinect2 names them ``NNNN_depth.png`` and
  ``NNNN_ir.png``, with ``calib_ir.yaml`` if the camera was calibrated.
- stacks ``*.npy``, (T, H, W) or (H, W), uint16 or float; infrared in ``*_ir.npy`` or ``ir.npy``.
- dumps of libfreenect2: the float32 bytes of its Frame, 512 x 424, ``*.bin``, ``*.raw`` or
  ``*.depth``, with infrared in ``*_ir.*`` or ``*.ir``.
- Biwi: ``frame_*_depth.bin`` beside ``depth.cal``.
- ROS bags of librealsense or ROS nodes (``bag``), Matroska files of an Azure Kinect (``mkv``).

A ``camera.toml`` beside the frames (``camera_file``) says what the camera is; it wins over what the
files state, and options of commands win over it, but for a unit that differs: that is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from glsim.core.camera import DEFAULT_INTRINSICS, DEFAULT_SENSOR, Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.listing import MOST_FILES, natural
from glsim.core.files.png import stated_unit_mm
from glsim.data.header import is_dataset
from glsim.data.map_files import open_stack
from glsim.data.reader import open_dataset
from glsim.data.recordings.camera_file import (
    StatedCamera,
    agreed_unit_mm,
    check_size,
    sensor_camera,
)
from glsim.data.recordings.files import FramePlace, MapFiles
from glsim.data.recordings.folders import depth_files, stated_camera, whole_recording
from glsim.data.recordings.names import infrared_files
from glsim.data.recordings.streams import STREAMS, FrameStream
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
#: Files that another program unpacks -> what to do.
_PACKED = {
    ".r3d": "its depth is compressed by LZFSE: export EXR + RGB from Record3D",
    ".zip": "unpack it, and give its folder of depth maps (of Polycam: keyframes)",
    ".zstd": "unpack it: zstd -d",
}
#: Consecutive frames that are kept together, so that static pairs stay pairs.
_RUN = 4


@dataclass(frozen=True, eq=False)
class Recording:
    """The frames of one camera on disk, in the order of their names.

    Attributes:
        path: the folder, or the first of several files.
        kind: "data set", "iai_kinect2", "images", "npy", "libfreenect2", "biwi", "bag" or "mkv".
        frames: the frames, which are read one by one.
        reader: the files of the frames; None of a data set.
        stated: what the recording says about its camera; its distortion is not removed.
        stated_by: the file that says so; None without one.
        notes: what is chosen, and what the recording does not say, in lines for the user.
    """

    path: Path
    kind: str
    frames: Frames
    reader: FrameReader | None = None
    stated: StatedCamera = field(default_factory=StatedCamera)
    stated_by: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def camera(self) -> Intrinsics | None:
        """Intrinsics that the recording states; None without them."""
        return self.stated.intrinsics

    @property
    def assumed(self) -> str:
        """Name of the sensor whose intrinsics the frames have; "" if the recording states them."""
        return "" if self.camera is not None else self.stated.sensor or DEFAULT_SENSOR

    def remarks(self, focal_px: float | None = None, taken: str = "") -> tuple[str, ...]:
        """Return the notes, and whose intrinsics are taken if neither file nor option states them.

        taken: a sensor's name, if these are not the assumed ones.
        """
        if self.camera is not None or focal_px is not None:
            return self.notes
        taken = f"those of {taken or self.assumed} are taken; a camera.toml beside it states them"
        return (*self.notes, f"{self.path}: states no intrinsics: {taken}")

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

        Raises DatasetError as ``read`` does, for a single frame, for a scene that changes, and if
        some frames only have infrared.
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
        dark = [frame.name for frame in frames if frame.infrared is None]
        if 0 < len(dark) < len(frames):
            raise DatasetError(
                f"{self.path}: {dark[0]} has no infrared image, but other frames have: give it "
                "for all or for none"
            )
        return frames


@dataclass(frozen=True)
class _Loader:
    """Reads the frames of files: see ``open_recording`` for mirror.

    assumed: intrinsics where none are stated.
    """

    reader: FrameReader
    mirror: bool
    stated: StatedCamera
    assumed: Intrinsics

    def __call__(self, number: int) -> DepthFrame:
        depth_mm, step_mm = self.reader.depth(number)
        light, name = self.reader.infrared(number), self.reader.name(number)
        _check_least_size(depth_mm.shape, self.reader.files(number)[0])
        layers = {"noisy_mm": depth_mm} | ({} if light is None else {"infrared": light})
        if self.mirror:
            layers = {layer: image[:, ::-1].copy() for layer, image in layers.items()}
        check_size(self.stated, depth_mm.shape, f"{self.reader.files(number)[0]}: {name}")
        camera = self.stated.intrinsics
        if camera is None:
            camera = self.assumed.for_map((depth_mm.shape[0], depth_mm.shape[1]))
        return DepthFrame(FrameKey("", name, number), camera, layers, step_mm=step_mm, name=name)


def open_recording(
    paths: Path | Sequence[Path],
    unit_mm: float | None = None,
    mirror: bool = False,
    infrared: Path | None = None,
    topic: str | None = None,
) -> Recording:
    """Find the frames of a recording.

    Args:
        paths: a data set of glsim, a folder, or files of one kind.
        unit_mm: step of integer depth files, mm; default: as the recording says, else 1. Data sets
            state their own.
        mirror: flip left and right: libfreenect2 delivers images as in a mirror.
        infrared: folder of the infrared images; default: beside the depth files.
        topic: of the depth images in a bag; default: native images named depth.

    Raises:
        ConfigError: a path, topic or step is wrong, or ``camera.toml`` is.
        DatasetError: there are no depth frames of a known kind.
    """
    given = [paths] if isinstance(paths, Path) else list(paths)
    if missing := next((path for path in given if not path.exists()), None):
        kind = "file or folder" if missing.suffix or len(given) > 1 else "folder"
        raise ConfigError(f"{missing}: no such {kind}")
    if given[0].is_file() and (packed := _PACKED.get(given[0].suffix.lower())):
        raise DatasetError(f"{given[0]}: {packed}")
    if len(given) == 1 and is_dataset(given[0]):
        dataset = open_dataset(given[0])
        if len(dataset) == 0:
            raise DatasetError(f"{given[0]}: has no frames")
        dataset.require("noisy")
        stated = StatedCamera(dataset.frames().intrinsics, unit_mm=dataset.depth_unit_mm)
        return Recording(given[0], "data set", dataset.frames(), None, stated)
    if whole := whole_recording(given):
        return _stream_recording(whole, unit_mm, mirror, infrared, topic)
    found = [depth_files(path) if path.is_dir() else ("", [path]) for path in given]
    if topic is not None:
        raise ConfigError(f"--topic {topic}: {given[0]} is no bag")
    maps = sorted((file for _, files in found for file in files), key=natural)
    folder = given[0] if given[0].is_dir() else given[0].parent
    stated, stated_by = stated_camera(folder, maps[0].parent)
    unit = agreed_unit_mm(unit_mm, stated.unit_mm or stated_unit_mm(maps[0]), given[0])
    lights: list[Path] | None = None if infrared is None else []
    places: list[FramePlace] = []
    for file, light in zip(maps, infrared_files(maps, infrared) if infrared else maps, strict=True):
        count = len(open_stack(file)) if file.suffix.lower() == ".npy" else 1
        if len(places) + count > MOST_FILES:
            raise DatasetError(f"{file}: the recording has more than {MOST_FILES} frames")
        names = [f"{file.stem}_{k:05d}" for k in range(count)] if count > 1 else [file.stem]
        places += [FramePlace(name, file, k) for k, name in enumerate(names)]
        if lights is not None:
            lights += [light] * count
    reader = MapFiles(places, unit, stated.channel, lights, stated.unit_mm is not None)
    return _recording(given[0], found[0][0], reader, stated, stated_by, reader.notes, mirror)


def _recording(
    path: Path,
    kind: str,
    reader: FrameReader,
    stated: StatedCamera,
    stated_by: Path | None,
    notes: tuple[str, ...],
    mirror: bool,
) -> Recording:
    """Read the first frame, so that a folder of colour pictures is refused, and check its size."""
    depth_mm, _ = reader.depth(0)
    if stated_by is not None:
        check_size(stated, depth_mm.shape, stated_by)
    _check_least_size(depth_mm.shape, reader.files(0)[0])
    stated = _mirrored(stated, mirror)
    assumed = None
    if stated.intrinsics is None and stated.sensor:
        assumed = sensor_camera(stated.sensor, path).intrinsics
    loader = _Loader(reader, mirror, stated, assumed or DEFAULT_INTRINSICS)
    frames = Frames(len(reader), loader)
    return Recording(path, kind, frames, reader, stated, stated_by, notes)


def _check_least_size(shape: tuple[int, ...], where: Path) -> None:
    """Raise DatasetError if an (H, W) depth frame has fewer than 8 x 8 pixels."""
    if min(shape) < _LEAST_PX:
        raise DatasetError(
            f"{where}: has {shape[1]} x {shape[0]} pixels: a depth frame has at least {_LEAST_PX} "
            f"x {_LEAST_PX}"
        )


def _stream_recording(
    path: Path, unit_mm: float | None, mirror: bool, infrared: Path | None, topic: str | None
) -> Recording:
    kind = STREAMS.get(path.suffix.lower(), "bag")
    stream: FrameStream
    if kind == "mkv":
        from glsim.data.recordings.mkv import MkvStream

        if topic is not None:
            raise ConfigError(f"--topic {topic}: {path} is no bag")
        stream = MkvStream(path)
    else:
        from glsim.data.recordings.bag import BagStream

        stream = BagStream(path, topic)
    if infrared is not None:
        raise ConfigError(f"{path}: holds the infrared images itself: leave {infrared} out")
    if len(stream) > MOST_FILES:
        raise DatasetError(f"{path}: the recording has more than {MOST_FILES} frames")
    given, file = stated_camera(path.parent, path if path.is_dir() else path.parent)
    stated = given.over(stream.stated)
    stream.step_mm = agreed_unit_mm(unit_mm, stated.unit_mm, path) or 1.0
    notes = stream.notes + (stream.camera_notes if given.intrinsics is None else ())
    return _recording(path, kind, stream, stated, file or path, notes, mirror)


def _mirrored(stated: StatedCamera, mirror: bool) -> StatedCamera:
    """Flip left and right: of OpenCV's lens p2, s1, s2 and the tilt tau_y change their signs."""
    own = stated.intrinsics
    if own is None or not mirror:
        return stated
    lens = tuple(-k if n in (3, 8, 9, 13) else k for n, k in enumerate(stated.distortion))
    return replace(stated, intrinsics=replace(own, cx=own.width - own.cx), distortion=lens)


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
