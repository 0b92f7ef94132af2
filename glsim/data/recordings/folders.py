"""Search of a recording's folder: its depth files, and files that state its camera."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError, DatasetError, NoDepthError
from glsim.core.files.atomic import read_json
from glsim.core.files.listing import check_number, entries, files_below, natural
from glsim.core.files.png import MAX_IMAGE_BYTES, image_size
from glsim.core.files.regular import MOST_HELD, read_data, read_regular
from glsim.data.header import results_in
from glsim.data.map_files import BIWI_CALIBRATION, DUMP_SHAPE, DUMPS, READ_ONLY, STACKS, SUFFIXES
from glsim.data.recordings.biwi import read_calibration
from glsim.data.recordings.camera_file import CAMERA_FILE, StatedCamera, read_camera_file
from glsim.data.recordings.names import DepthKind, left_out_text, other_kind, words_of
from glsim.data.recordings.opencv_yaml import read_matrices
from glsim.data.recordings.streams import STREAMS, is_stream

#: File name of a calibration by iai_kinect2, in the folder of its frames.
CALIBRATION = "calib_ir.yaml"
#: Number of Polycam's camera files that are read, evenly spread.
_SAMPLE = 16
#: Largest difference between the scales from colour to depth images along x and y.
_UNEQUAL = 0.02
#: Suffixes of files that may state a camera.
_CAMERA_ENDS: Final = (".json", ".yaml", ".yml", ".txt", ".xml", ".toml", ".ini")
_CAMERA_WORDS: Final = re.compile("intrinsic|camera|calib")
#: Groups of suffixes of depth maps; the first group that a folder has is read, no other.
_FORMATS: Final = ((".png",), (*SUFFIXES[1:], *READ_ONLY), DUMPS[:-1])
#: Kind of map -> last words of file names; if a folder has such files, only these are read.
_MARKS: Final = {
    "noisy": ("_depth", "_noisy"),
    "clean": ("_depth", "_clean"),
    "expected": ("_expected",),
}


def list_maps(
    folder: Path, kind: DepthKind = "noisy", below: bool = True
) -> tuple[list[Path], Counter[str]]:
    """Find the depth maps in a folder and its sub-folders, by the same rules for all commands.

    First rule, name: files named as depth (``*_depth``, ``*_noisy`` or ``*_clean``, else
    ``depth*``) are read; if a folder has none, all files that are not named as another kind. Second
    rule, format: of these PNG files are read; if there are none, TIFF, OpenEXR and .npy files; if
    there are none, dumps of libfreenect2 and Biwi. A folder ``depth`` excludes all files beside it.

    Args:
        kind: kind of the maps; other kinds in a folder that glsim wrote are left out.
        below: whether to search sub-folders other than ``depth``, too.

    Returns:
        The files in natural order, and pattern of file names that are left out -> number of files.

    Raises NoDepthError: the folder has no depth map; ConfigError: it holds results of glsim.
    """
    if results := results_in(folder):
        raise ConfigError(f"{folder}: {results}")
    groups: dict[Path, list[Path]] = {}
    for path in _images(folder, below):
        groups.setdefault(path.parent, []).append(path)
    maps: list[Path] = []
    left_out = Counter[str]()
    beside = cache(lambda place: place.name != "depth" and (place.parent / "depth").is_dir())
    for place, paths in groups.items():
        above = [place, *place.parents][: len(place.relative_to(folder).parts)]
        if any(map(beside, above)):
            left_out.update(f"{place.name}/*{path.suffix}" for path in paths)
        elif (place / "depth").is_dir():
            left_out.update(f"*{path.suffix} beside depth/" for path in paths)
        else:
            maps += _maps_of(paths, kind, left_out)
            check_number(folder, len(maps))
    if maps:
        return sorted(maps, key=natural), left_out
    if left_out:
        raise NoDepthError(
            f"{folder}: holds no {kind} depth maps, only {left_out_text(left_out)}: to take them "
            f"all the same, give a pattern such as '{folder}/*.png'"
        )
    if shards := entries(folder, (".tar",))[0]:
        raise NoDepthError(f"{folder}: its frames are in shards ({shards[0]}), not .png")
    raise NoDepthError(
        f"{folder}: holds no depth maps ({', '.join((*SUFFIXES, *READ_ONLY))}; dumps of "
        "libfreenect2: .bin, .raw, .depth), and is no recording (.bag, .mcap, .db3, .mkv)"
    )


def _images(folder: Path, below: bool) -> Iterator[Path]:
    """Yield a folder's files (and its sub-folders') with a suffix of depth maps."""
    ends = (*SUFFIXES, *READ_ONLY, *DUMPS[:-1])
    if below:
        yield from files_below(folder, ends)
        return
    for place in filter(Path.is_dir, (folder, folder / "depth")):
        yield from (place / name for name in entries(place, ends)[0])


def _maps_of(paths: Sequence[Path], kind: DepthKind, left_out: Counter[str]) -> list[Path]:
    """Return the depth maps among one folder's files; count the other files by pattern."""
    named = {path: other_kind(path.name, kind) for path in paths}
    left_out.update(filter(None, named.values()))
    maps = [path for path, other in named.items() if not other]
    marked = [path for path in maps if (words_of(path.name) or [""])[-1] in _MARKS[kind]]
    marked = marked or [path for path in maps if path.name.lower().startswith("depth")]
    chosen: list[Path] = []
    for ends in _FORMATS:
        chosen = chosen or [p for p in marked or maps if p.suffix.lower() in ends]
    left_out.update(f"*{path.suffix}" for path in {*maps} - {*chosen})
    return chosen


def kind_of(file: Path) -> str:
    """Return the kind of a file of depth maps: "images", "npy", "libfreenect2" or "biwi"."""
    if file.suffix.lower() not in DUMPS:
        return "npy" if file.suffix.lower() in STACKS else "images"
    return "biwi" if file.with_name(BIWI_CALIBRATION).is_file() else "libfreenect2"


def whole_recording(given: Sequence[Path]) -> Path | None:
    """Return the bag or Matroska file that is an input, or is in an input folder without images.

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

    Returns the stated camera (earlier files override later ones), and the first file.

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
        return StatedCamera()  # JSON files of another program
    if size is None:
        return StatedCamera()
    x, y = size[0] / width, size[1] / height
    if not (np.isfinite(matrix).all() and min(matrix[:2]) >= 1 and abs(x / y - 1) < _UNEQUAL):
        raise DatasetError(f"{folder}: its camera fits no depth maps of {size} px")
    fx, fy, cx, cy = matrix
    return StatedCamera(Intrinsics(*size, fx * x, fy * y, cx * x, cy * y), unit_mm=1.0)


def _bop_cameras(file: Path) -> StatedCamera:
    """Return the camera of the first image of BOP's scene_camera.json, and the step of its depth.

    Raises DatasetError if it states none, or several.
    """
    cameras = read_json(file)
    try:
        stated = {(*map(float, c["cam_K"]), float(c["depth_scale"])) for c in cameras.values()}
        fx, _, cx, _, fy, cy, *_, step_mm = min(stated)
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise DatasetError(f"{file}: has no cam_K and depth_scale for each image") from error
    size = _size_of_maps(file.parent)
    if len(stated) > 1 or size is None:
        return StatedCamera(unit_mm=step_mm)  # a zooming camera, or no PNG maps
    return StatedCamera(Intrinsics(*size, fx, fy, cx + 0.5, cy + 0.5), unit_mm=step_mm)


def json_camera(folder: Path, shape: tuple[int, ...]) -> tuple[Intrinsics, Path] | None:
    """Return the only camera of the size of (H, W) maps in JSON files beside them, and its file.

    Read are Open3D's matrix, listed by columns, and keys as librealsense writes them: width,
    height, fx, fy, and ppx, ppy or cx, cy. Of several cameras that named depth is taken. In all of
    them the first pixel's centre is at 0, in glsim at 0.5.
    """
    found: dict[str, tuple[Intrinsics, Path]] = {}
    for file in unread_cameras(folder):
        whole = read_json(file) if file.suffix == ".json" else None
        parts = whole if isinstance(whole, dict) else {}
        for name, table in {"": whole, **parts}.items():
            with suppress(LookupError, ValueError, TypeError):
                if matrix := table.get("intrinsic_matrix") if isinstance(table, dict) else None:
                    table |= {"fx": matrix[0], "fy": matrix[4], "cx": matrix[6], "cy": matrix[7]}
                centre = ("ppx", "ppy") if "ppx" in table else ("cx", "cy")
                keys = ("width", "height", "fx", "fy", *centre)
                width, height, fx, fy, cx, cy = (float(table[key]) for key in keys)
                fits = (height, width) == shape and min(fx, fy) >= 1
                if fits and np.isfinite([fx, fy, cx, cy]).all():
                    camera = Intrinsics(int(width), int(height), fx, fy, cx + 0.5, cy + 0.5)
                    found[f"{file.name} {name}".lower()] = camera, file
    named = {name: camera for name, camera in found.items() if "depth" in name} or found
    return next(iter(named.values())) if len({c for c, _ in named.values()}) == 1 else None


def unread_cameras(folder: Path) -> list[Path]:
    """Return files beside maps that look like a camera description and have no reader by name."""
    places = (folder, folder.parent) if folder.name == "depth" else (folder,)
    files = [place / name for place in places for name in entries(place, _CAMERA_ENDS)[0]]
    own = [file for file in files if file.name not in _READERS]
    return sorted(file for file in own if _CAMERA_WORDS.search(file.name.lower()))


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


#: File that states a camera or a unit -> its reader, the most reliable first.
_READERS: Final[dict[str, Callable[[Path], StatedCamera]]] = {
    CAMERA_FILE: read_camera_file,
    BIWI_CALIBRATION: lambda file: StatedCamera(read_calibration(file)),
    CALIBRATION: _opencv_calibration,
    "intrinsic/intrinsic_depth.txt": _scannet_calibration,
    "scene_camera.json": _bop_cameras,
    "cameras": _polycam_cameras,
    "depth.txt": _tum_list,
    "associations.txt": _tum_list,
    "associated.txt": _tum_list,
}
