"""What lies in the folder of a recording: its depth files, and what states its camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glsim.core.camera import Intrinsics
from glsim.core.errors import DatasetError, MeshError
from glsim.data.recordings.camera_file import CAMERA_FILE, StatedCamera, read_camera_file
from glsim.data.recordings.files import BIWI_CALIBRATION, DUMP_SHAPE, DUMPS, IMAGES
from glsim.data.recordings.names import other_kind
from glsim.data.recordings.opencv_yaml import read_matrices
from glsim.data.recordings.streams import is_stream
from glsim.faces.scans.biwi_files import read_calibration

#: The calibration of iai_kinect2, in the folder of its frames.
CALIBRATION = "calib_ir.yaml"


def depth_files(root: Path) -> tuple[str, list[Path]]:
    """Return the kind of the depth files in a folder, and these files. Raises DatasetError."""
    folder = root / "depth" if (root / "depth").is_dir() else root
    files = sorted(path for path in folder.iterdir() if path.is_file())
    for kind, suffixes in (("images", IMAGES), ("npy", (".npy",)), ("libfreenect2", DUMPS[:-1])):
        named = [file for file in files if file.suffix.lower() in suffixes]
        maps = [file for file in named if not other_kind(file.name, "noisy")]
        if not maps:
            continue
        if kind == "libfreenect2" and (folder / BIWI_CALIBRATION).is_file():
            kind = "biwi"
        marked = [file for file in maps if file.stem.endswith(("_depth", "_noisy"))]
        if kind == "images" and any(file.stem.endswith("_depth") for file in marked):
            kind = "iai_kinect2"
        marked = marked or [file for file in maps if file.stem.startswith("depth")]
        return kind, marked or maps
    raise DatasetError(
        f"{root}: holds no 16-bit .png or .tiff depth maps, .npy stacks or dumps of "
        "libfreenect2 (.bin, .raw, .depth), no .bag and no .mkv"
    )


def whole_recording(given: Sequence[Path]) -> Path | None:
    """Return the bag or Matroska file that is given, or lies in a given folder without images.

    Raises DatasetError for more than one.
    """
    if any(is_stream(path) for path in given):
        files = list(given)
    elif len(given) == 1 and given[0].is_dir():
        inside = sorted(given[0].iterdir())
        files = [path for path in inside if is_stream(path)]
        if any(path.suffix.lower() in (*IMAGES, *DUMPS, ".npy") for path in inside):
            return None
    else:
        return None
    if len(files) > 1:
        raise DatasetError(
            f"{files[0]} and {files[1].name}: each holds a recording of its own: give one of them"
        )
    return files[0] if files else None


def stated_camera(*folders: Path) -> tuple[StatedCamera, Path | None]:
    """Read the first of the folders' files that state a camera. ConfigError, DatasetError."""
    for folder in dict.fromkeys(folders):
        if (folder / CAMERA_FILE).is_file():
            return read_camera_file(folder / CAMERA_FILE), folder / CAMERA_FILE
    if (file := folders[0] / BIWI_CALIBRATION).is_file():
        try:
            return StatedCamera(read_calibration(file)), file
        except MeshError as error:
            raise DatasetError(str(error)) from None
    if (file := folders[0] / CALIBRATION).is_file():
        return _opencv_calibration(file), file
    return StatedCamera(), None


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
