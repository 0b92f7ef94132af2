"""Depth-map files without ground truth: the inputs of ``glsim denoise``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from numpy.typing import NDArray

from glsim.dataset.disk_format import FORMAT, HEADER
from glsim.dataset.header import read_header
from glsim.dataset.reader import open_dataset
from glsim.dataset.record_schema import read_object
from glsim.denoise.calibration import DeviceCalibration
from glsim.denoise.frames import Key, Sample, check_millimetres
from glsim.denoise.interface import Depth
from glsim.depth_frame import DepthFrame
from glsim.depth_protocol import DepthProtocol, offset_to_nearest, stored_protocol, subtract_offset
from glsim.errors import ConfigError, DatasetError
from glsim.files.png import read_depth_png
from glsim.geometry.camera import Intrinsics
from glsim.map_files import FORMATS, SUFFIXES, is_map, read_map_mm
from glsim.recordings.names import depth_pngs, infrared_beside, left_out
from glsim.recordings.names import infrared_files as named_infrared_files
from glsim.settings.schema import SPLIT_NAMES


class MapFrames:
    """Depth-map files as frames without ground truth; the files of a folder are one sequence."""

    identity = ""
    regions: Mapping[str, int] = {}

    def __init__(
        self,
        files: Sequence[Path],
        depth_unit_mm: float,
        device: DeviceCalibration | None = None,
        infrared: Sequence[Path] = (),
        protocol: DepthProtocol = "depth",
    ) -> None:
        """Look up the data sets of the files. Raises DatasetError if one is damaged.

        Args:
            files: 16-bit depth maps.
            depth_unit_mm: their step.
            device: subtract its errors; crops of data sets have their place in its image.
            infrared: one 16-bit image for each map.
            protocol: "depth": as measured, with the offset that a data set states. "paper": the
                nearest point of each map at 1 mm.

        """
        self.protocol: DepthProtocol = protocol
        self._files, self._unit_mm, self._device = files, depth_unit_mm, device
        self._infrared = infrared
        roots = {dataset_root(folder) for folder in {file.parent for file in files}}
        moved = any(root is not None and _stored_nearest_mm(root) is not None for root in roots)
        self._pairs = _dataset_pairs(files) if device is not None or moved else {}

    def __len__(self) -> int:
        return len(self._files)

    def key(self, number: int) -> Key:
        """Return the key of a file; its subject is the folder."""
        return Key(str(self._files[number].parent), "", number)

    def load(self, number: int) -> Sample:
        """Read a map, also used as ``clean_mm``.

        Raises DatasetError if it is no 16-bit depth map, ConfigError if it is none of the device.
        """
        file = self._files[number]
        inside = dataset_root(file.parent)
        stored_mm = self._stored_offset_mm(number)
        depth = read_map_mm(file, self._unit_mm, stored_mm, inside=inside)
        check_millimetres(depth, str(file), self.protocol)
        if self._device is not None:
            pair = self._pairs.get(file.absolute())
            depth = self._device(depth, None if pair is None else pair.intrinsics)
        height, width = depth.shape
        offset_mm = 0.0
        if self.protocol == "paper":
            at_1_mm = inside is not None and stored_protocol(_stored_nearest_mm(inside)) == "paper"
            offset_mm = stored_mm if at_1_mm else offset_to_nearest(depth)
            depth = subtract_offset(depth, offset_mm)
        camera = Intrinsics(width, height, 1.0, 1.0, 0.0, 0.0)
        return Sample(depth, depth, camera, offset_mm=offset_mm)

    def as_stored(self, number: int, depth_mm: Depth, offset_mm: float) -> Depth:
        """Return a denoised map with the offset of its file instead of its ``Sample``'s."""
        change_mm = self._stored_offset_mm(number) - offset_mm
        return subtract_offset(depth_mm, change_mm, self._unit_mm) if change_mm else depth_mm

    def _stored_offset_mm(self, number: int) -> float:
        pair = self._pairs.get(self._files[number].absolute())
        return 0.0 if pair is None else pair.offset_mm

    def infrared(self, number: int) -> NDArray[Any]:
        """Read the infrared counts of a map. Raises DatasetError if they are no 16-bit image."""
        return read_depth_png(self._infrared[number])


def infrared_files(maps: Sequence[Path], given: Path | None) -> list[Path]:
    """Return the infrared image of each depth map: beside it, or as ``given`` says.

    given: see ``glsim.recordings.names.infrared_files``. Raises ConfigError if one is missing.
    """
    if given is not None:
        try:
            return named_infrared_files(maps, given)
        except DatasetError as error:
            raise ConfigError(str(error)) from None
    files = []
    for depth in maps:
        file = infrared_beside(depth)
        if file is None:
            raise ConfigError(
                f"{depth}: has no infrared image beside it ({depth.stem}_infrared.png), which this "
                "denoiser uses: give one with --infrared, or choose the network face"
            )
        files.append(file)
    return files


def dataset_root(folder: Path) -> Path | None:
    """Return the data set of a folder <split>/<subject>/, where one writes maps; else None."""
    split = folder.absolute().parent
    root = split.parent
    path = root / HEADER
    if split.name not in SPLIT_NAMES or not path.is_file():
        return None
    status = path.stat()
    return root if _is_header(path, status.st_mtime_ns, status.st_size) else None


@lru_cache(maxsize=8)
def _is_header(path: Path, _modified_ns: int, _size: int) -> bool:
    """Return whether a file is the header of a data set; it is read once for all maps."""
    try:
        header, _ = read_object(path)
    except DatasetError:  # a file of that name may have another origin
        return False
    return bool(header.get("format") == FORMAT)


def _stored_nearest_mm(root: Path) -> float | None:
    """Return the depth of the nearest point of a data set's maps, mm; None: as measured."""
    nearest_mm: float | None = read_header(root)["settings"]["output"].get("nearest_to_mm")
    return nearest_mm


def _dataset_pairs(files: Sequence[Path]) -> dict[Path, DepthFrame]:
    """Return the frames of those maps that belong to data sets, by absolute path."""
    wanted = {file.absolute() for file in files}
    roots = {root for folder in {f.parent for f in wanted} if (root := dataset_root(folder))}
    return {
        path: pair
        for root in sorted(roots)
        for pair in open_dataset(root)
        for file in pair.record["files"].values()
        if (path := root / file["name"]) in wanted
    }


def _matching(pattern: Path) -> list[Path]:
    """Return the files that match a quoted pattern."""
    relative = pattern.relative_to(pattern.anchor)
    return sorted(Path(pattern.anchor or ".").glob(str(relative))) if relative.parts else []


def _of_one(text: str, out: Path) -> list[tuple[Path, Path]]:
    """Pair the files of one input. Raises ConfigError if there is none."""
    path = Path(text)
    if path.is_dir():
        pairs = [(file, out / file.relative_to(path)) for file in maps_in(path, "noisy")]
    else:
        files = [path] if path.is_file() else _matching(path)
        pairs = [(file, out / file.name) for file in files]
    if not pairs:
        raise ConfigError(f"{text}: no such file, folder of depth maps, or pattern")
    return pairs


def maps_in(folder: Path, kind: Literal["clean", "noisy"]) -> list[Path]:
    """Return the depth maps in a folder and below it: PNG files of a kind, else files of others.

    Raises ConfigError without any, see ``depth_pngs``.
    """
    others = _without_png(folder)
    return others or depth_pngs(folder, kind)[0]


def left_out_of(inputs: Sequence[Path], kind: Literal["clean", "noisy"]) -> Counter[str]:
    """Count what ``maps_in`` leaves out of those inputs that are folders."""
    return left_out([path for path in inputs if path.is_dir() and not _without_png(path)], kind)


def _without_png(folder: Path) -> list[Path]:
    """Return the depth maps of a folder that holds no PNG files, sorted; else an empty list."""
    files = sorted(file for file in folder.rglob("*") if is_map(file))
    return [] if any(file.suffix.lower() == ".png" for file in files) else files


def check_name(out: Path, form: str | None = None) -> None:
    """Raise ConfigError for the name of an output that is no depth map, or not of the format."""
    suffixes = SUFFIXES if form is None else FORMATS[form]
    if out.suffix.lower() not in suffixes:
        raise ConfigError(
            f"-o {out}: give a name that ends in {', '.join(suffixes)}, or an existing folder"
        )


def _shared(paths: Sequence[Path]) -> Path | None:
    """Return a path that is there more than once; None without one."""
    return next((path for path, count in Counter(paths).items() if count > 1), None)


def find_maps(inputs: Sequence[str], out: Path, form: str | None = None) -> list[tuple[Path, Path]]:
    """Pair input files with output files.

    Args:
        inputs: files, quoted patterns, and folders, of which ``depth_pngs`` are taken.
        out: folder, or file name for one map.
        form: format of the output, one of ``FORMATS``; default: by the suffix.

    Returns:
        (input, output) of each map. Where two have the same name, all keep their folders below the
        one that they share.

    Raises:
        ConfigError: no file matches, one is given twice, or one would be overwritten.

    """
    pairs = [pair for text in inputs for pair in _of_one(text, out)]
    if len(pairs) == 1 and not out.is_dir() and not Path(inputs[0]).is_dir():
        check_name(out, form)
        pairs = [(pairs[0][0], out)]
    elif out.is_file():
        raise ConfigError(f"-o {out}: is a file; for several maps give a folder")
    elif out.suffix.lower() in SUFFIXES and not out.is_dir():
        raise ConfigError(f"-o {out}: is the name of one map; for several give that of a folder")
    elif form is not None:
        pairs = [(source, target.with_suffix(FORMATS[form][0])) for source, target in pairs]
    if _shared([target for _, target in pairs]):
        shared = os.path.commonpath([source.absolute().parent for source, _ in pairs])
        pairs = [(source, out / source.absolute().relative_to(shared)) for source, _ in pairs]
        if twice := _shared([source for source, _ in pairs]):
            raise ConfigError(f"{twice}: is given twice")
        if same := _shared([target for _, target in pairs]):
            raise ConfigError(f"-o {out}: two maps would be {same}: denoise them one by one")
    for source, target in pairs:
        if target.exists() and target.samefile(source):
            raise ConfigError(f"-o {out}: would overwrite {source}")
    return pairs
