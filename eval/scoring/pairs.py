"""Pairs of true and noisy frames to score, from a glsim data set or a folder of PNG files.

The truth is the layer clean, or expected: clean with the sensor's systematic error.
"""

from __future__ import annotations

import zlib
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from glsim.core.array_types import Depth
from glsim.core.camera import DEFAULT_INTRINSICS
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames, Layer
from glsim.core.depth_protocol import MEANING, DepthProtocol
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.listing import files_below
from glsim.core.files.png import MAX_IMAGE_BYTES, MAX_MAP_PX, stated_unit_mm
from glsim.core.files.regular import read_regular
from glsim.data.disk_format import HEADER
from glsim.data.header import is_dataset
from glsim.data.layer_images import decode_layer
from glsim.data.reader import open_dataset
from glsim.denoise.calibration import DeviceCalibration
from glsim.denoise.frames import calibrated_frames, check_millimetres, is_moved, moved_frames

#: The layer that predictions are compared with.
TruthLayer = Literal["clean", "expected"]


def _dataset_frames(path: Path, split: str, truth: TruthLayer) -> tuple[Frames, DepthProtocol]:
    """Open the frames of a split; return them with the depth protocol of its files.

    Raises DatasetError if it lacks the maps of the truth.
    """
    dataset = open_dataset(path)
    dataset.require(truth)

    def with_truth(frame: DepthFrame) -> DepthFrame:
        return _checked(frame.changed({"clean_mm": frame.layer(f"{truth}_mm")}))

    return dataset.split(split).changed(with_truth, truth), dataset.protocol


def _folder_frames(
    path: Path, focal_px: float | None, truth: TruthLayer
) -> tuple[Frames, DepthProtocol]:
    """Open pairs of 16-bit files ``*_clean.png`` (or ``*_expected.png``) and ``*_noisy.png``.

    They are in mm, or in the step that they state (``stated_unit_mm``). The folder of a file is the
    subject, a number at the end of its name the frame. The camera is a Kinect V2, or one with focal
    length ``focal_px`` and its axis through the image centre. The protocol is paper if the nearest
    point of the first truth is at 1 mm; then the distance from the camera is unknown.

    Raises DatasetError without any pair.
    """
    found = {
        str(file.relative_to(path))[: -len(f"_{layer}.png")]
        for layer in (truth, "noisy")
        for file in files_below(path, (f"_{layer}.png",))
    }
    if not found:
        raise DatasetError(
            f"{path}: is no data set of glsim (it has no {HEADER}), and holds no pairs of "
            f"*_{truth}.png and *_noisy.png"
        )
    stems = sorted(found, key=lambda stem: (_key(stem), stem))
    focal = None if focal_px is None else (focal_px, focal_px)
    protocol: DepthProtocol = "depth"
    with suppress(DatasetError):  # reported when the frame is scored
        if is_moved(_read(path / f"{stems[0]}_{truth}.png", truth)):
            protocol = "paper"

    def load(number: int) -> DepthFrame:
        place = path / stems[number]
        clean, noisy = (_read(Path(f"{place}_{layer}.png"), layer) for layer in (truth, "noisy"))
        layers: dict[str, Layer] = {
            "clean_mm": clean,
            "noisy_mm": noisy,
            "infrared": partial(_read, Path(f"{place}_infrared.png"), "infrared"),
        }
        frame = DepthFrame(
            _key(stems[number]),
            DEFAULT_INTRINSICS.for_map((clean.shape[0], clean.shape[1]), focal),
            layers,
            name=str(place),
            offset_mm=0.0 if protocol == "depth" else float("nan"),
        )
        return _checked(frame, in_mm=protocol == "depth")

    listing = [
        (stem, *(_size(path / f"{stem}_{layer}.png") for layer in (truth, "noisy")))
        for stem in stems
    ]
    frames = Frames(
        len(stems),
        load,
        lambda number: _key(stems[number]),
        title=str(path),
        identity=f"{zlib.crc32(repr(listing).encode()):08x} {focal} {truth}",
        protocol=protocol,
    )
    return frames, protocol


def _size(file: Path) -> tuple[int, int]:
    try:
        status = file.stat()
    except OSError:
        return 0, 0
    return status.st_size, status.st_mtime_ns


def _key(stem: str) -> FrameKey:
    path = Path(stem)
    name = path.name.rstrip("0123456789")
    digits = path.name[len(name) :]
    subject = path.parent.as_posix()
    return FrameKey(subject if subject != "." else "all", name.rstrip("_"), int(digits or 0))


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


def _checked(frame: DepthFrame, *, in_mm: bool = True) -> DepthFrame:
    """Return the frame. Raises DatasetError if sizes differ or depths cannot be millimetres."""
    clean, noisy = frame.clean_mm, frame.noisy_mm
    if clean.shape != noisy.shape:
        raise DatasetError(
            f"{frame.name}: clean is {clean.shape[1]} x {clean.shape[0]} pixels, noisy "
            f"{noisy.shape[1]} x {noisy.shape[0]}"
        )
    for layer, depth in (("clean", clean), ("noisy", noisy)):
        if in_mm:
            check_millimetres(depth, f"{frame.name} ({layer})")
    return frame


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
        truth: layer that becomes ``clean_mm``.
        device: sensor file whose fixed pattern and wiggling are subtracted from noisy maps.
        protocol: default: that of the files.

    Raises:
        DatasetError: there is no such folder, split, layer or pair.
        ConfigError: the device is unusable, or distances are needed and unknown.
    """
    own_camera = is_dataset(path)
    if own_camera:
        frames, stored = _dataset_frames(path, split, truth)
    elif path.is_dir():
        folder = path / split if (path / split).is_dir() else path
        frames, stored = _folder_frames(folder, focal_px, truth)
    else:
        raise DatasetError(f"{path}: no such folder")
    if frames.protocol == "paper" and (protocol == "depth" or device is not None):
        option = "--protocol depth" if protocol == "depth" else f"--device {device}"
        raise ConfigError(
            f"{option}: the maps in {path} have {MEANING['paper']}, and no record says how far "
            "from the camera that is: leave the option out, or give the data set"
        )
    if device is not None:
        frames = calibrated_frames(frames, DeviceCalibration(device), own_camera)
    return moved_frames(frames) if (protocol or stored) == "paper" else frames
