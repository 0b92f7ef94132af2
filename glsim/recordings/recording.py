"""Find the frames of a recording, and read them: every format that glsim knows.

- data sets of glsim: their noisy layer and infrared.
- folders of 16-bit PNG or TIFF files; infrared beside them (``_ir``, ``_infrared``) or in a folder
  ``ir`` or ``infrared`` beside the folder ``depth``. iai_kinect2 names them ``NNNN_depth.png`` and
  ``NNNN_ir.png``, with ``calib_ir.yaml`` if the camera was calibrated.
- stacks ``*.npy``, (T, H, W) or (H, W), uint16 or float; infrared in ``*_ir.npy`` or ``ir.npy``.
- dumps of libfreenect2: the float32 bytes of its Frame, 512 x 424, ``*.bin``, ``*.raw`` or
  ``*.depth``, with infrared in ``*_ir.*`` or ``*.ir``.
- Biwi: ``frame_*_depth.bin`` beside ``depth.cal``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.dataset.header import is_dataset
from glsim.dataset.pair import Pair
from glsim.dataset.reader import Dataset, open_dataset
from glsim.errors import ConfigError, DatasetError, MeshError
from glsim.faces.scans.biwi_files import read_calibration
from glsim.geometry.camera import Intrinsics
from glsim.measures.frame import DepthFrame, FrameSet
from glsim.measures.stacks import with_nan
from glsim.measures.static import view_change
from glsim.recordings.files import (
    BIWI_CALIBRATION,
    DUMP_SHAPE,
    DUMPS,
    IMAGES,
    FrameFile,
    open_stack,
)
from glsim.recordings.names import infrared_beside, infrared_files, other_kind
from glsim.recordings.opencv_yaml import read_matrices
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import DEFAULT_SENSOR

#: The calibration of iai_kinect2, in the folder of its frames.
CALIBRATION = "calib_ir.yaml"
#: Frames that are measured if a recording has more; more do not change the printed digits.
DEFAULT_FRAMES = 60
#: Most frames of one recording: two hours at 30 Hz are 216,000.
_MAX_FRAMES = 250_000
#: Consecutive frames that are kept together, so that static pairs stay pairs.
_RUN = 4


@dataclass(frozen=True)
class _PairFrame:
    """A frame of a data set, read as a ``FrameFile`` is."""

    pair: Pair
    quantum_mm: float

    @property
    def name(self) -> str:
        return f"{self.pair.split}/{self.pair.subject}/{self.pair.sequence}_{self.pair.frame:05d}"

    def depth_mm(self) -> NDArray[np.float32]:
        return self.pair.noisy_mm

    def infrared(self) -> NDArray[np.float32] | None:
        has_one = "infrared" in self.pair.record["files"]
        return self.pair.infrared.astype(np.float32) if has_one else None


class _PairFrames(Sequence[_PairFrame]):
    """The frames of a data set, looked up one by one: there may be millions."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset

    def __len__(self) -> int:
        return len(self._dataset)

    def __getitem__(self, number: Any) -> Any:
        return _PairFrame(self._dataset.pair(number), self._dataset.depth_unit_mm)


@dataclass(frozen=True, eq=False)
class Recording:
    """The frames of one camera on disk, in the order of their names.

    Attributes:
        path: the folder, or the first of several files.
        kind: "data set", "iai_kinect2", "images", "npy", "libfreenect2" or "biwi".
        files: the frames, which are read one by one.
        camera: intrinsics that the recording states; None without them.
        distortion: k1, k2, p1, p2, k3 of ``calib_ir.yaml``, OpenCV's model; it is not removed.

    """

    path: Path
    kind: str
    files: Sequence[FrameFile] | Sequence[_PairFrame]
    camera: Intrinsics | None = None
    distortion: tuple[float, ...] = ()

    @property
    def calibration(self) -> str:
        """Name of the file that states the camera, if there is one."""
        return BIWI_CALIBRATION if self.kind == "biwi" else CALIBRATION

    def camera_of(self, shape: tuple[int, ...]) -> Intrinsics:
        """Return the stated camera if it fits an (H, W) image, else a Kinect V2's."""
        own = self.camera
        if own is not None and (own.height, own.width) == shape:
            return own
        return load_sensor(DEFAULT_SENSOR).rig.for_map((shape[0], shape[1])).intrinsics

    def read(self, most: int | None = None) -> FrameSet:
        """Read the frames into memory.

        Args:
            most: largest number of frames; a longer recording is thinned evenly, in runs of four
                consecutive frames. Default: all.

        Raises:
            DatasetError: a file cannot be read, sizes differ, or no pixel has depth.

        """
        numbers = _chosen(len(self.files), most or len(self.files))
        frames = [self._read(self.files[number]) for number in numbers]
        where = str(self.path)
        check_sizes([(frame.name, frame.depth_mm.shape) for frame in frames], where)
        for frame in frames:
            if frame.infrared is not None:
                pair = [("depth", frame.depth_mm.shape), ("infrared", frame.infrared.shape)]
                check_sizes(pair, f"{where}: {frame.name}")
        if not any(np.isfinite(frame.depth_mm).any() for frame in frames):
            raise DatasetError(f"{where}: no pixel of any frame has depth (all are 0)")
        return FrameSet(self.path.name or where, tuple(frames))

    def read_static(self) -> FrameSet:
        """Read all frames of one static scene.

        Raises DatasetError as ``read`` does, for a single frame, for a scene that changes, and if
        some frames only have infrared.
        """
        if len(self.files) < 2:
            raise DatasetError(
                f"{self.path}: has one frame only; noise is measured between frames: record at "
                "least 30 frames of a scene in which nothing moves"
            )
        frames = self.read()
        for before, after in pairwise(frames.frames):
            if reason := view_change(before, after):
                raise DatasetError(
                    f"{self.path}: {before.name} and {after.name} show different scenes "
                    f"({reason}): give a static recording, one camera and nothing that moves"
                )
        dark = [frame.name for frame in frames.frames if frame.infrared is None]
        if 0 < len(dark) < len(frames.frames):
            raise DatasetError(
                f"{self.path}: {dark[0]} has no infrared image, but other frames have: give it "
                "for all or for none"
            )
        return frames

    def _read(self, file: FrameFile | _PairFrame) -> DepthFrame:
        depth = with_nan(file.depth_mm()).astype(np.float32)
        stated = file.pair.intrinsics if isinstance(file, _PairFrame) else None
        camera = stated or self.camera_of(depth.shape)
        return DepthFrame(file.name, depth, file.infrared(), camera, file.quantum_mm)


def open_recording(
    paths: Path | Sequence[Path],
    unit_mm: float = 1.0,
    mirror: bool = False,
    infrared: Path | None = None,
) -> Recording:
    """Find the frames of a recording.

    Args:
        paths: a data set of glsim, a folder, or files of one kind.
        unit_mm: step of integer depth files, mm; data sets state their own.
        mirror: flip left and right: libfreenect2 delivers images as in a mirror.
        infrared: folder of the infrared images; default: beside the depth files.

    Raises:
        ConfigError: a path does not exist, or a step is not above 0.
        DatasetError: there are no depth frames of a known kind.

    """
    if not unit_mm > 0:
        raise ConfigError(f"--depth-unit-mm {unit_mm:g}: must be above 0")
    given = [paths] if isinstance(paths, Path) else list(paths)
    if len(given) == 1 and not given[0].is_file():
        if not given[0].is_dir():
            raise ConfigError(f"{given[0]}: no such folder")
        if is_dataset(given[0]):
            return _dataset_recording(given[0])
    if missing := next((path for path in given if not path.exists()), None):
        raise ConfigError(f"{missing}: no such file or folder")
    found = [_depth_files(path) if path.is_dir() else ("", [path]) for path in given]
    depth_files = [file for _, files in found for file in files]
    folder = given[0] if given[0].is_dir() else given[0].parent
    lights = [infrared_beside(file) for file in depth_files]
    if infrared is not None:
        lights = list(infrared_files(depth_files, infrared))
    frames: list[FrameFile] = []
    for file, light in zip(depth_files, lights, strict=True):
        count = len(open_stack(file)) if file.suffix.lower() == ".npy" else 1
        if len(frames) + count > _MAX_FRAMES:
            raise DatasetError(f"{file}: the recording has more than {_MAX_FRAMES} frames")
        for number in range(count):
            name = f"{file.stem}_{number:05d}" if count > 1 else file.stem
            frames.append(FrameFile(name, file, light, number, unit_mm, mirror))
    frames[0].depth_mm()  # a folder of colour pictures is refused here, by its first file
    camera, distortion = _calibration(folder, mirror)
    return Recording(given[0], found[0][0], tuple(frames), camera, distortion)


def read_frame_set(
    paths: Path | Sequence[Path],
    unit_mm: float = 1.0,
    focal_px: float | None = None,
    most: int | None = DEFAULT_FRAMES,
) -> FrameSet:
    """Read a recording into memory. focal_px: overrides the camera's focal length, pixels.

    See ``open_recording`` and ``Recording.read`` for the rest.
    """
    frames = open_recording(paths, unit_mm).read(most)
    if focal_px is None:
        return frames
    own = frames.camera
    camera = Intrinsics(own.width, own.height, focal_px, focal_px, own.cx, own.cy)
    return frames.with_camera(camera)


def _dataset_recording(path: Path) -> Recording:
    dataset = open_dataset(path)
    if len(dataset) == 0:
        raise DatasetError(f"{path}: has no frames")
    if "noisy" not in dataset.layers:
        raise DatasetError(f"{path}: has no layer 'noisy': generate it with --layers clean,noisy")
    return Recording(path, "data set", _PairFrames(dataset), dataset.pair(0).intrinsics)


def _depth_files(root: Path) -> tuple[str, list[Path]]:
    """Return the kind of the depth files in a folder, and these files. Raises DatasetError."""
    folder = root / "depth" if (root / "depth").is_dir() else root
    files = sorted(path for path in folder.iterdir() if path.is_file())
    for kind, suffixes in (("images", IMAGES), ("npy", (".npy",)), ("libfreenect2", DUMPS[:-1])):
        named = [file for file in files if file.suffix.lower() in suffixes]
        depth_files = [file for file in named if not other_kind(file.name, "noisy")]
        if not depth_files:
            continue
        if kind == "libfreenect2" and (folder / BIWI_CALIBRATION).is_file():
            kind = "biwi"
        marked = [file for file in depth_files if file.stem.endswith(("_depth", "_noisy"))]
        if kind == "images" and any(file.stem.endswith("_depth") for file in marked):
            kind = "iai_kinect2"
        return kind, marked or depth_files
    raise DatasetError(
        f"{root}: holds no 16-bit .png or .tiff depth maps, .npy stacks or dumps of "
        "libfreenect2 (.bin, .raw, .depth)"
    )


def _calibration(folder: Path, mirror: bool) -> tuple[Intrinsics | None, tuple[float, ...]]:
    """Read the camera and its distortion, if the folder states them. Raises DatasetError."""
    camera: Intrinsics | None = None
    lens: tuple[float, ...] = ()
    if (folder / BIWI_CALIBRATION).is_file():
        try:
            camera = read_calibration(folder / BIWI_CALIBRATION)
        except MeshError as error:
            raise DatasetError(str(error)) from None
    elif (folder / CALIBRATION).is_file():
        camera, lens = _opencv_calibration(folder / CALIBRATION)
    if camera is not None and mirror:
        camera = replace(camera, cx=camera.width - camera.cx)
    return camera, lens


def _opencv_calibration(file: Path) -> tuple[Intrinsics, tuple[float, ...]]:
    matrices = read_matrices(file)
    matrix = matrices.get("cameraMatrix", np.empty(0))
    if matrix.shape != (3, 3) or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise DatasetError(
            f"{file}: has no 3 x 3 cameraMatrix with focal lengths above 0: repair or remove it"
        )
    height, width = DUMP_SHAPE
    # OpenCV counts from the centre of the first pixel, glsim from its corner.
    cx, cy = float(matrix[0, 2]) + 0.5, float(matrix[1, 2]) + 0.5
    camera = Intrinsics(width, height, float(matrix[0, 0]), float(matrix[1, 1]), cx, cy)
    lens = matrices.get("distortionCoefficients", np.empty(0))
    return camera, tuple(float(k) for k in lens.ravel())


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
    runs = max(1, most // _RUN)
    starts = np.linspace(0, count - _RUN, runs).round().astype(int)
    return sorted({int(start) + step for start in starts for step in range(_RUN)})
