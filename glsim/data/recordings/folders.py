"""What lies in the folder of a recording: its depth files, and what states its camera."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from glsim.core.camera import Intrinsics
from glsim.core.errors import DatasetError, NoDepthError
from glsim.core.files.atomic import read_json
from glsim.core.files.listing import entries
from glsim.core.files.png import MAX_IMAGE_BYTES, image_size
from glsim.core.files.regular import MOST_HELD, read_data, read_regular
from glsim.data.map_files import BIWI_CALIBRATION, DUMP_SHAPE, DUMPS, SUFFIXES
from glsim.data.recordings.biwi import read_calibration
from glsim.data.recordings.camera_file import CAMERA_FILE, StatedCamera, read_camera_file
from glsim.data.recordings.names import other_kind
from glsim.data.recordings.opencv_yaml import read_matrices
from glsim.data.recordings.streams import STREAMS, is_stream

#: The calibration of iai_kinect2, in the folder of its frames.
CALIBRATION = "calib_ir.yaml"
#: Files of Polycam's cameras that are read, evenly spread.
_SAMPLE = 16
#: Largest difference of the scales of depth to colour along x and y: 256 x 192 of 1024 x 768.
_UNEQUAL = 0.02
#: Kind of depth files -> ends of their names, the first that is there.
_KINDS = {
    "images": tuple(suffix for suffix in SUFFIXES if suffix != ".npy"),
    "npy": (".npy",),
    "libfreenect2": DUMPS[:-1],
}


def depth_files(root: Path) -> tuple[str, list[Path]]:
    """Return the kind of the depth files in a folder, and these files. Raises DatasetError."""
    folder = root / "depth" if (root / "depth").is_dir() else root
    names, _ = entries(folder, (*SUFFIXES, *DUMPS))
    for kind, suffixes in _KINDS.items():
        named = [name for name in names if name.lower().endswith(suffixes)]
        maps = [folder / name for name in named if not other_kind(name, "noisy")]
        if not maps:
            continue
        if kind == "libfreenect2" and (folder / BIWI_CALIBRATION).is_file():
            kind = "biwi"
        marked = [file for file in maps if file.stem.endswith(("_depth", "_noisy"))]
        if kind == "images" and any(file.stem.endswith("_depth") for file in marked):
            kind = "iai_kinect2"
        marked = marked or [file for file in maps if file.stem.startswith("depth")]
        return kind, marked or maps
    raise NoDepthError(
        f"{root}: holds no 16-bit .png or .tiff depth maps, .exr, .npy stacks or dumps of "
        "libfreenect2 (.bin, .raw, .depth), no .bag and no .mkv"
    )


def whole_recording(given: Sequence[Path]) -> Path | None:
    """Return the bag or Matroska file that is given, or lies in a given folder without images.

    Raises DatasetError for more than one.
    """
    if any(is_stream(path) for path in given):
        files = list(given)
    elif len(given) == 1 and given[0].is_dir():
        streams, folders = entries(given[0], (*STREAMS,))
        files = [given[0] / n for n in sorted([*streams, *folders]) if is_stream(given[0] / n)]
        if files and entries(given[0], (*SUFFIXES, *DUMPS))[0]:
            return None
    else:
        return None
    if len(files) > 1:
        raise DatasetError(
            f"{files[0]} and {files[1].name}: each holds a recording of its own: give one of them"
        )
    return files[0] if files else None


def stated_camera(*folders: Path) -> tuple[StatedCamera, Path | None]:
    """Read the files in the folders that state a camera or the unit of its depth.

    Returns:
        What they state, the first above the others, and that first file.

    Raises ConfigError, DatasetError.
    """
    stated, first = StatedCamera(), None
    above = [folder.absolute().parent for folder in folders if folder.absolute().name == "depth"]
    for name, read in _READERS.items():
        for folder in dict.fromkeys([*folders, *above]):
            open_yet = stated.intrinsics is None or stated.unit_mm is None
            if open_yet and (file := folder / name).exists():
                found = read(file)
                first = first or (file if found != StatedCamera() else None)
                stated = stated.over(found)
    return stated, first


def _tum_list(file: Path) -> StatedCamera:
    """Return the unit of depth, 1/5000 m, if a text lists images depth/*.png, as TUM's do."""
    text = read_data(file, MOST_HELD)
    listed = re.search(rb"^[\d.]+[ \t](.*[ \t])?depth/\S+\.png", text, re.MULTILINE)
    return StatedCamera(unit_mm=0.2) if listed else StatedCamera()


def _scannet_calibration(file: Path) -> StatedCamera:
    """Return the camera of ScanNet's 4 x 4 matrix; its depth is in millimetres."""
    try:
        size = _size_of_maps(file.parents[1])
        (fx, _, cx, *_), (_, fy, cy, *_) = np.loadtxt(file)[:2].tolist()
        intrinsics = None if size is None else Intrinsics(*size, fx, fy, cx + 0.5, cy + 0.5)
    except (OSError, ValueError, TypeError) as error:
        raise DatasetError(f"{file}: is no 4 x 4 matrix of intrinsics ({error})") from None
    return StatedCamera(intrinsics, unit_mm=1.0)


def _polycam_cameras(folder: Path) -> StatedCamera:
    """Return Polycam's camera, scaled from its colour images; its depth is in millimetres.

    The focus changes from image to image: the median of some files is taken.
    """
    names, _ = entries(folder, (".json",))
    files = [read_json(folder / name) for name in names[:: len(names) // _SAMPLE + 1]]
    size = _size_of_maps(folder.parent)
    try:
        rows = [[f[k] for k in ("width", "height", "fx", "fy", "cx", "cy")] for f in files]
        width, height, *matrix = np.median(np.array(rows, np.float64), axis=0).tolist()
    except (KeyError, ValueError, TypeError):
        return StatedCamera()  # cameras of something else
    if size is None:
        return StatedCamera()
    x, y = size[0] / width, size[1] / height
    if not (np.isfinite(matrix).all() and min(matrix[:2]) >= 1 and abs(x / y - 1) < _UNEQUAL):
        raise DatasetError(f"{folder}: its numbers are of no camera of depth maps of {size}")
    fx, fy, cx, cy = matrix
    return StatedCamera(Intrinsics(*size, fx * x, fy * y, cx * x, cy * y), unit_mm=1.0)


def _size_of_maps(folder: Path) -> tuple[int, int] | None:
    """Return (width, height) of the first PNG in the folder depth; None without one."""
    names = entries(folder / "depth", (".png",))[0] if (folder / "depth").is_dir() else []
    return image_size(read_regular(folder / "depth" / names[0], MAX_IMAGE_BYTES)) if names else None


def _opencv_calibration(file: Path) -> StatedCamera:
    matrices = read_matrices(file)
    matrix = matrices.get("cameraMatrix", np.empty(0))
    if matrix.shape != (3, 3) or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise DatasetError(
            f"{file}: has no 3 x 3 cameraMatrix with focal lengths above 0: repair or remove it"
        )
    height, width = DUMP_SHAPE
    (fx, _, cx), (_, fy, cy) = matrix[:2].tolist()
    lens = matrices.get("distortionCoefficients", np.empty(0))
    # OpenCV counts from the centre of the first pixel, glsim from its corner.
    image = Intrinsics(width, height, fx, fy, cx + 0.5, cy + 0.5)
    return StatedCamera(image, tuple(lens.ravel().tolist()))


#: What states a camera or a unit in the folder of a recording -> its reader, the surest first.
_READERS: Final[dict[str, Callable[[Path], StatedCamera]]] = {
    CAMERA_FILE: read_camera_file,
    BIWI_CALIBRATION: lambda file: StatedCamera(read_calibration(file)),
    CALIBRATION: _opencv_calibration,
    "intrinsic/intrinsic_depth.txt": _scannet_calibration,
    "cameras": _polycam_cameras,
    "depth.txt": _tum_list,
    "associations.txt": _tum_list,
    "associated.txt": _tum_list,
}
