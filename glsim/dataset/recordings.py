"""Read the frames of a real depth camera from disk: four kinds of folders.

- iai_kinect2 calibration folders: ``NNNN_depth.png``, ``NNNN_sync_depth.png`` with ``_ir.png``
  beside them, and ``calib_ir.yaml`` if the camera was calibrated.
- 16-bit PNG or TIFF files; infrared images beside them (``_ir``, ``_infrared``) or in a folder
  ``ir`` or ``infrared`` beside the folder ``depth``.
- stacks ``*.npy``, (T, H, W) or (H, W), uint16 or float; infrared in ``*_ir.npy`` or ``ir.npy``.
- libfreenect2 dumps: the float32 bytes of its Frame, 512 x 424, ``*.bin``, ``*.raw`` or
  ``*.depth``, with infrared in ``*_ir.*`` or ``*.ir``.

16-bit integers are millimetres. Floats are millimetres as libfreenect2 gives them, or metres if
no value of the stack exceeds 20: no depth camera measures less than 20 mm or more than 20 m.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, DatasetError
from glsim.files.png import MAX_IMAGE_BYTES, MAX_MAP_PX, decode_png, size_problem
from glsim.files.regular import read_regular
from glsim.geometry.camera import Intrinsics

Array = NDArray[np.float32]

#: Size of a Kinect V2's images, which a dump of libfreenect2 does not state.
DUMP_SHAPE = (424, 512)
_METRES_BELOW = 20.0
_IMAGES = (".png", ".tif", ".tiff")
#: The calibration of iai_kinect2, in the folder of its frames.
CALIBRATION = "calib_ir.yaml"
_DUMPS = (".bin", ".raw", ".depth")
_INFRARED_FOLDERS = ("ir", "infrared")
#: How the name of a depth file ends, and those of its infrared image.
_NAME_PAIRS = (("_depth", "_ir"), ("_noisy", "_infrared"), ("", "_ir"), ("", "_infrared"))
#: Images that stand beside depth files and are none.
_OTHER = re.compile(
    r"(^|_)(ir|infrared|clean|reason|regions|colou?r|rgb|amplitude|confidence|mask)$"
)


@dataclass(frozen=True)
class RecordedFrame:
    """One frame on disk.

    name: unique in the recording, without slashes. number: its position in a stack, else 0.
    unit_mm: step of integer depths. mirror: flip left and right when it is read.
    """

    name: str
    depth_file: Path
    infrared_file: Path | None
    number: int = 0
    unit_mm: float = 1.0
    mirror: bool = False

    def depth_mm(self) -> Array:
        """Read (H, W) float32 depth, millimetres, 0 = none. Raises DatasetError."""
        image = _read(self.depth_file, self.number)
        if image.dtype.kind == "f":
            floats = np.nan_to_num(image.astype(np.float32), posinf=0.0)
            depth = np.maximum(floats, 0.0) * np.float32(
                1000.0 if _in_metres(self.depth_file) else 1.0
            )
        else:
            depth = image.astype(np.float32) * np.float32(self.unit_mm)
        return depth[:, ::-1].copy() if self.mirror else depth

    def infrared(self) -> Array | None:
        """Read (H, W) float32 infrared counts, 0 to 65535; None without infrared.

        Raises DatasetError if its size is not that of the depth map.
        """
        if self.infrared_file is None:
            return None
        image = np.nan_to_num(_read(self.infrared_file, self.number).astype(np.float32))
        return image[:, ::-1].copy() if self.mirror else image

    @property
    def quantum_mm(self) -> float:
        """The step of stored depths, mm; 0 for floats."""
        floats = self.depth_file.suffix.lower() in _DUMPS
        if self.depth_file.suffix == ".npy":
            floats = _stack(self.depth_file).dtype.kind == "f"
        return 0.0 if floats else self.unit_mm


@dataclass(frozen=True, eq=False)
class FrameFiles:
    """The frames of one folder in the order of their names, and how they were found.

    kind: "iai_kinect2", "images", "npy" or "libfreenect2". intrinsics: of ``calib_ir.yaml``,
    None without it. distortion: k1, k2, p1, p2, k3 of the same file, OpenCV's model; depth maps
    are not undistorted.
    """

    root: Path
    kind: str
    frames: tuple[RecordedFrame, ...]
    intrinsics: Intrinsics | None = None
    distortion: tuple[float, ...] = ()


def find_frames(root: Path, unit_mm: float = 1.0, mirror: bool = False) -> FrameFiles:
    """Find the frames in a folder. unit_mm: step of integer depth files.

    mirror: flip the images left and right: libfreenect2 delivers them as in a mirror, iai_kinect2
    and Microsoft's software do not. Raises ConfigError for a folder that does not exist or a step
    of 0 or less, DatasetError if it holds no depth frames of a known kind.
    """
    if not unit_mm > 0:
        raise ConfigError(f"--depth-unit-mm {unit_mm:g}: must be above 0")
    if not root.is_dir():
        raise ConfigError(f"{root}: no such folder")
    folder = root / "depth" if (root / "depth").is_dir() else root
    files = sorted(path for path in folder.iterdir() if path.is_file())
    kind, depth_files = _depth_files(files)
    if not depth_files:
        raise DatasetError(
            f"{root}: holds no 16-bit .png or .tiff depth maps, .npy stacks or dumps of "
            "libfreenect2 (.bin, .raw, .depth)"
        )
    marked = [file for file in depth_files if file.stem.endswith(("_depth", "_noisy"))]
    chosen = marked or depth_files
    frames: list[RecordedFrame] = []
    for file in chosen:
        infrared = _infrared_of(file, root)
        count = len(_stack(file)) if kind == "npy" else 1
        for number in range(count):
            name = f"{file.stem}_{number:05d}" if count > 1 else file.stem
            frames.append(RecordedFrame(name, file, infrared, number, unit_mm, mirror))
    frames[0].depth_mm()  # a folder of colour pictures is refused here, by its first file
    if kind == "images" and marked and any(f.stem.endswith("_depth") for f in chosen):
        kind = "iai_kinect2"
    intrinsics, distortion = _calibration(root, mirror)
    return FrameFiles(root, kind, tuple(frames), intrinsics, distortion)


def _depth_files(files: Sequence[Path]) -> tuple[str, list[Path]]:
    """Return the kind of a folder's depth files and these files; none of any kind: ("", [])."""
    for kind, suffixes in (("images", _IMAGES), ("npy", (".npy",)), ("libfreenect2", _DUMPS)):
        named = [file for file in files if file.suffix.lower() in suffixes]
        depth_files = [file for file in named if not _OTHER.search(file.stem.lower())]
        if depth_files:
            return kind, depth_files
    return "", []


def _infrared_of(depth_file: Path, root: Path) -> Path | None:
    """Return the infrared file of a depth file, None if there is none."""
    stem, suffix = depth_file.stem, depth_file.suffix
    for ending, other in _NAME_PAIRS:
        if stem.endswith(ending):
            file = depth_file.with_name(f"{stem[: len(stem) - len(ending)]}{other}{suffix}")
            if file.is_file():
                return file
    if stem == "depth" and depth_file.with_name(f"ir{suffix}").is_file():
        return depth_file.with_name(f"ir{suffix}")
    if suffix == ".depth" and depth_file.with_suffix(".ir").is_file():
        return depth_file.with_suffix(".ir")
    for folder in _INFRARED_FOLDERS if depth_file.parent != root else ():
        for name in (depth_file.name, stem.replace("depth", folder) + suffix):
            if (root / folder / name).is_file():
                return root / folder / name
    return None


def _read(file: Path, number: int) -> NDArray[np.generic]:
    """Read one (H, W) image of a file: uint16 or float. Raises DatasetError."""
    if file.suffix == ".npy":
        stack = _stack(file)
        if number >= len(stack):
            raise DatasetError(f"{file}: has {len(stack)} frames, frame {number} is needed")
        return np.asarray(stack[number])
    try:
        data = read_regular(file, MAX_IMAGE_BYTES)
    except OSError as error:
        raise DatasetError(f"{file}: {error.strerror or error}") from None
    if file.suffix.lower() in _IMAGES:
        image = decode_png(data, MAX_MAP_PX)
        if image is None:
            raise DatasetError(
                f"{file}: {size_problem(data, MAX_MAP_PX) or 'is no readable image'}"
            )
        wrong = image.ndim != 2 or not (image.dtype == np.uint16 or image.dtype.kind == "f")
        if wrong:
            channels = 1 if image.ndim == 2 else image.shape[2]
            raise DatasetError(
                f"{file}: has {channels} channels of {image.dtype.itemsize * 8} bits; a frame of "
                "a depth camera has one of 16 bits: remove other pictures from the folder"
            )
        return image
    height, width = DUMP_SHAPE
    if len(data) != 4 * height * width:
        raise DatasetError(
            f"{file}: has {len(data)} bytes; a dump of libfreenect2's Frame has 512 x 424 float32 "
            f"({4 * height * width}): decode raw packets with libfreenect2 first"
        )
    return np.frombuffer(data, "<f4").reshape(DUMP_SHAPE)


def _stack(file: Path) -> NDArray[np.generic]:
    """Open a stack as (T, H, W), mapped from the disk. Raises DatasetError."""
    try:
        stack: NDArray[np.generic] = np.load(file, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DatasetError(f"{file}: is no readable .npy file: {error}") from None
    good = stack.dtype == np.uint16 or stack.dtype.kind == "f"
    if stack.ndim not in (2, 3) or not good or 0 in stack.shape:
        raise DatasetError(
            f"{file}: is {stack.dtype} {stack.shape}; a stack of frames is (T, H, W), uint16 in "
            "steps of --depth-unit-mm or float in millimetres or metres"
        )
    if stack.shape[-1] * stack.shape[-2] > MAX_MAP_PX:
        raise DatasetError(
            f"{file}: its images are {stack.shape[-1]} x {stack.shape[-2]} pixels, more than the "
            f"{MAX_MAP_PX} pixels that glsim reads"
        )
    return stack if stack.ndim == 3 else stack[None]


def _in_metres(file: Path) -> bool:
    """Whether the floats of a file are metres: no value of its first frames exceeds 20."""
    if file.suffix == ".npy":
        sample = np.asarray(_stack(file)[:8], np.float32)
    else:
        sample = np.asarray(_read(file, 0), np.float32)
    known = sample[np.isfinite(sample) & (sample > 0)]
    return bool(known.size) and float(np.max(known)) < _METRES_BELOW


def _calibration(root: Path, mirror: bool) -> tuple[Intrinsics | None, tuple[float, ...]]:
    """Read ``calib_ir.yaml`` of iai_kinect2. OpenCV counts from the first pixel's centre."""
    file = root / CALIBRATION
    if not file.is_file():
        return None, ()
    import cv2

    try:
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
        matrix = storage.getNode("cameraMatrix").mat()
        lens = storage.getNode("distortionCoefficients").mat()
        storage.release()
    except (cv2.error, SystemError):
        matrix = lens = np.empty(0)
    if matrix is None or matrix.shape != (3, 3):
        raise DatasetError(f"{file}: has no 3 x 3 cameraMatrix: repair or remove it")
    height, width = DUMP_SHAPE
    cx, cy = float(matrix[0, 2]) + 0.5, float(matrix[1, 2]) + 0.5
    camera = Intrinsics(
        width, height, float(matrix[0, 0]), float(matrix[1, 1]), width - cx if mirror else cx, cy
    )
    return camera, tuple(float(k) for k in lens.ravel()) if lens is not None else ()


def check_sizes(frames: Sequence[tuple[str, tuple[int, ...]]], where: str) -> None:
    """Raise DatasetError if named images differ in size: give (name, shape) of each."""
    for name, shape in frames[1:]:
        if shape != frames[0][1]:
            first, size = frames[0]
            raise DatasetError(
                f"{where}: {name} is {shape[1]}x{shape[0]}, but {first} is {size[1]}x{size[0]}: "
                "give frames of one camera in one mode"
            )
