"""Pairs of true and noisy frames to score: a data set of glsim, or a folder of PNG files.

The truth is the layer clean, or expected: clean with the sensor's systematic error.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glsim.dataset import open_dataset
from glsim.dataset.disk_format import HEADER
from glsim.dataset.header import is_dataset
from glsim.dataset.layer_images import decode_layer
from glsim.denoise.calibration import DeviceCalibration
from glsim.denoise.frames import (
    CalibratedFrames,
    Frames,
    Key,
    MovedFrames,
    Sample,
    check_millimetres,
    is_moved,
)
from glsim.denoise.interface import Depth
from glsim.depth_frame import Frames as DepthFrames
from glsim.depth_protocol import MEANING, DepthProtocol
from glsim.errors import ConfigError, DatasetError
from glsim.files.png import MAX_IMAGE_BYTES, MAX_MAP_PX, stated_unit_mm
from glsim.files.regular import read_regular
from glsim.geometry.camera import Intrinsics
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import DEFAULT_SENSOR

#: The layer that predictions are compared with.
TruthLayer = Literal["clean", "expected"]


class DatasetFrames:
    """The frames of one split of a data set, as measured; ``stored`` is the protocol of its files.

    Raises DatasetError if it lacks the maps of the truth.
    """

    protocol: DepthProtocol = "depth"

    def __init__(self, path: Path, split: str, truth: TruthLayer = "clean") -> None:
        dataset = open_dataset(path)
        dataset.require(truth)
        self._truth, self.stored = truth, dataset.protocol
        self.regions: Mapping[str, int] = dataset.regions
        self._split: DepthFrames = dataset.split(split)
        self.identity = f"{zlib.crc32((dataset.path / HEADER).read_bytes()):08x} {split} {truth}"

    def __len__(self) -> int:
        return len(self._split)

    def key(self, number: int) -> Key:
        """Return the key in the manifest."""
        return Key(*self._split.key(number))

    def load(self, number: int) -> Sample:
        """Read a pair and check it against the manifest. Raises DatasetError."""
        pair = self._split[number]
        truth_mm = pair.clean_mm if self._truth == "clean" else pair.expected_mm
        sample = _checked(truth_mm, pair.noisy_mm, pair.intrinsics, pair.name)
        return replace(sample, regions=pair.regions.astype(np.uint8)) if self.regions else sample

    def infrared(self, number: int) -> NDArray[Any]:
        """Read a frame's infrared counts. Raises DatasetError if the set has none."""
        return self._split[number].layer("infrared")


class FolderFrames:
    """Pairs of ``*_clean.png`` (or ``*_expected.png``) and ``*_noisy.png``, 16 bits.

    They are in mm, or in the step that they state (``stated_unit_mm``).

    The folder of a file is the subject, a number at the end of its name the frame. The camera is a
    Kinect V2, or one with focal length ``focal_px`` and its axis through the image centre. The
    protocol is paper if the nearest point of the first truth is at 1 mm; then the distance from the
    camera is unknown.
    """

    regions: Mapping[str, int] = {}

    def __init__(
        self, path: Path, focal_px: float | None = None, truth: TruthLayer = "clean"
    ) -> None:
        self._path, self._truth = path, truth
        self._rig = load_sensor(DEFAULT_SENSOR).rig
        self._focal = None if focal_px is None else (focal_px, focal_px)
        stems = {
            str(file.relative_to(path))[: -len(f"_{layer}.png")]
            for layer in (truth, "noisy")
            for file in path.rglob(f"*_{layer}.png")
        }
        if not stems:
            raise DatasetError(
                f"{path}: is no data set of glsim (it has no {HEADER}), and holds no pairs of "
                f"*_{truth}.png and *_noisy.png"
            )
        self._stems = sorted(stems, key=lambda stem: (_key(stem), stem))
        self.protocol: DepthProtocol = "paper" if self._is_moved() else "depth"
        self.stored = self.protocol
        listing = [(stem, *map(_size, self._files(stem))) for stem in self._stems]
        self.identity = f"{zlib.crc32(repr(listing).encode()):08x} {self._focal} {truth}"

    def __len__(self) -> int:
        return len(self._stems)

    def key(self, number: int) -> Key:
        """Return the key that the path gives."""
        return _key(self._stems[number])

    def load(self, number: int) -> Sample:
        """Read both files of a pair. Raises DatasetError."""
        clean_file, noisy_file = self._files(self._stems[number])
        clean, noisy = _read(clean_file, self._truth), _read(noisy_file, "noisy")
        rig = self._rig.for_map((clean.shape[0], clean.shape[1]), self._focal)
        where = str(self._path / self._stems[number])
        if self.protocol == "depth":
            return _checked(clean, noisy, rig.intrinsics, where)
        return replace(_same_size(clean, noisy, rig.intrinsics, where), offset_mm=float("nan"))

    def _is_moved(self) -> bool:
        try:
            return is_moved(_read(self._files(self._stems[0])[0], self._truth))
        except DatasetError:  # reported when the frame is scored
            return False

    def infrared(self, number: int) -> NDArray[Any]:
        """Read the counts of ``*_infrared.png``. Raises DatasetError if it is missing."""
        return _read(self._path / f"{self._stems[number]}_infrared.png", "infrared")

    def _files(self, stem: str) -> tuple[Path, Path]:
        return self._path / f"{stem}_{self._truth}.png", self._path / f"{stem}_noisy.png"


def _size(file: Path) -> tuple[int, int]:
    try:
        status = file.stat()
    except OSError:
        return 0, 0
    return status.st_size, status.st_mtime_ns


def _key(stem: str) -> Key:
    path = Path(stem)
    name = path.name.rstrip("0123456789")
    digits = path.name[len(name) :]
    subject = path.parent.as_posix()
    return Key(subject if subject != "." else "all", name.rstrip("_"), int(digits or 0))


def _read(path: Path, layer: str) -> Depth:
    try:
        data = read_regular(path, MAX_IMAGE_BYTES)
    except FileNotFoundError:
        raise DatasetError(f"{path}: is missing") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    depth: Depth = decode_layer(data, layer, str(path), MAX_MAP_PX).astype(np.float32)
    unit_mm = stated_unit_mm(path)
    return depth if unit_mm is None else depth * np.float32(unit_mm)


def _checked(clean: Depth, noisy: Depth, intrinsics: Intrinsics, where: str) -> Sample:
    """Return the pair. Raises DatasetError if sizes differ or depths cannot be millimetres."""
    sample = _same_size(clean, noisy, intrinsics, where)
    for layer, depth in (("clean", clean), ("noisy", noisy)):
        check_millimetres(depth, f"{where} ({layer})")
    return sample


def _same_size(clean: Depth, noisy: Depth, intrinsics: Intrinsics, where: str) -> Sample:
    if clean.shape != noisy.shape:
        raise DatasetError(
            f"{where}: clean is {clean.shape[1]} x {clean.shape[0]} pixels, noisy "
            f"{noisy.shape[1]} x {noisy.shape[0]}"
        )
    return Sample(clean, noisy, intrinsics)


def open_frames(
    path: Path,
    split: str,
    focal_px: float | None = None,
    truth: TruthLayer = "clean",
    device: Path | None = None,
    protocol: DepthProtocol | None = None,
) -> Frames:
    """Open a split of a data set, or the pairs of a folder.

    Args:
        path: a data set, or a folder of pairs, whose sub-folder ``split`` is taken if it exists.
        split: train, val or test.
        focal_px: focal length of the camera of pairs; default: a Kinect V2's.
        truth: layer that becomes ``Sample.clean_mm``.
        device: sensor file whose fixed pattern and wiggling are subtracted from noisy maps.
        protocol: default: that of the files.

    Raises:
        DatasetError: there is no such folder, split, layer or pair.
        ConfigError: the device is unusable, or distances are needed and unknown.

    """
    files = _open(path, split, focal_px, truth)
    if files.protocol == "paper" and (protocol == "depth" or device is not None):
        option = "--protocol depth" if protocol == "depth" else f"--device {device}"
        raise ConfigError(
            f"{option}: the maps in {path} have {MEANING['paper']}, and no record says how far "
            "from the camera that is: leave the option out, or give the data set"
        )
    frames: Frames = files
    if device is not None:
        own_camera = isinstance(files, DatasetFrames)
        frames = CalibratedFrames(files, DeviceCalibration(device), own_camera)
    return MovedFrames(frames) if (protocol or files.stored) == "paper" else frames


def _open(
    path: Path, split: str, focal_px: float | None, truth: TruthLayer
) -> DatasetFrames | FolderFrames:
    if is_dataset(path):
        return DatasetFrames(path, split, truth)
    if not path.is_dir():
        raise DatasetError(f"{path}: no such folder")
    part = path / split
    return FolderFrames(part if part.is_dir() else path, focal_px, truth)
