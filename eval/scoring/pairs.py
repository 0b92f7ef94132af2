"""Pairs of true and noisy frames to score, from a glsim data set or a folder of depth maps.

The truth is the layer "clean", or "expected", which is clean plus the sensor's systematic error.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from glsim.core.camera import DEFAULT_INTRINSICS
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames
from glsim.core.depth_protocol import MEANING, DepthProtocol
from glsim.core.errors import ConfigError, DatasetError, NoDepthError
from glsim.data.disk_format import HEADER
from glsim.data.header import is_dataset
from glsim.data.maps import open_maps
from glsim.data.reader import open_dataset
from glsim.data.recordings.names import DepthKind
from glsim.denoise.calibration import DeviceCalibration
from glsim.denoise.frames import calibrated_frames, check_millimetres, is_moved, moved_frames

#: The layer that predictions are compared with.
TruthLayer = Literal["clean", "expected"]


def _dataset_frames(path: Path, split: str, truth: TruthLayer) -> tuple[Frames, DepthProtocol]:
    """Open the frames of a split, which must have maps of the truth, with their protocol."""
    dataset = open_dataset(path)
    dataset.require(truth)

    def with_truth(frame: DepthFrame) -> DepthFrame:
        return _checked(frame.changed({"clean_mm": frame.layer(f"{truth}_mm")}))

    return dataset.split(split).changed(with_truth, truth), dataset.protocol


def _folder_frames(
    path: Path, focal_px: float | None, truth: TruthLayer
) -> tuple[Frames, DepthProtocol]:
    """Open pairs of files ``*_clean`` (or ``*_expected``) and ``*_noisy`` by ``open_maps``.

    The folder of a file names the subject; a number at the end of its name is the frame. With
    ``focal_px``, the camera has this focal length and its axis in the image centre; otherwise it is
    stated in the folder, or a Kinect V2. If the nearest point of the first truth is at 1 mm, the
    protocol is paper and the distance from the camera is unknown.

    Raises DatasetError without any pair.
    """
    (truths, _), (noisy_maps, note) = _maps(path, truth), _maps(path, "noisy", truth)
    found = {truth: truths, "noisy": noisy_maps}
    stems = sorted({*found[truth], *found["noisy"]}, key=lambda stem: (_key(stem), stem))
    same = {m.file for m in truths.values()} & {m.file for m in noisy_maps.values()}
    if same or not (truths and noisy_maps):
        raise DatasetError(
            f"{path}: is no data set of glsim (it has no {HEADER}), and holds no pairs of "
            f"*_{truth} and *_noisy depth maps; frames of a camera: glsim eval-real {path}"
        )
    protocol: DepthProtocol = "depth"
    with suppress(DatasetError, LookupError):  # scoring reports the frame later
        if is_moved(found[truth][stems[0]].load().layer(f"{truth}_mm")):
            protocol = "paper"

    def load(number: int) -> DepthFrame:
        stem = stems[number]
        for layer, maps in found.items():
            if stem not in maps:
                raise DatasetError(f"{path / stem}_{layer}: is missing")
        noisy = found["noisy"][stem].load()
        clean_mm = found[truth][stem].load().layer(f"{truth}_mm")
        camera = noisy.intrinsics
        if focal_px is not None:
            height, width = clean_mm.shape
            camera = DEFAULT_INTRINSICS.for_map((height, width), (focal_px, focal_px))
        frame = DepthFrame(
            _key(stem),
            camera,
            {"clean_mm": clean_mm, **{name: partial(noisy.layer, name) for name in noisy.layers}},
            name=str(path / stem),
            offset_mm=0.0 if protocol == "depth" else float("nan"),
        )
        return _checked(frame, in_mm=protocol == "depth")

    listing = [
        (stem, *(_size(maps[stem].file) if stem in maps else (0, 0) for maps in found.values()))
        for stem in stems
    ]
    frames = Frames(
        len(stems), load, lambda number: _key(stems[number]), title=str(path),
        identity=f"{zlib.crc32(repr(listing).encode()):08x} {focal_px} {truth}", protocol=protocol,
        note=note,
    )  # fmt: skip
    return frames, protocol


class _Map(NamedTuple):
    """The file of a depth map, and the function that loads it."""

    file: Path
    load: Callable[[], DepthFrame]


def _maps(path: Path, layer: DepthKind, other: str = "") -> tuple[dict[str, _Map], str]:
    """Find a layer's maps by path without suffix; say what is assumed, and left out by both."""
    try:
        recording = open_maps(path, layer)
    except NoDepthError:
        return {}, ""
    for name in [name for name in recording.left_out if name.startswith(f"*_{other}.")]:
        del recording.left_out[name]
    named = zip(recording.outputs, recording.sources, strict=True)
    maps = {
        output.with_suffix("").as_posix().removesuffix(f"_{layer}"): _Map(
            file, partial(recording.frames.load, number)
        )
        for number, (output, file) in enumerate(named)
    }
    return maps, recording.sentence()


def _size(file: Path) -> tuple[int, int]:
    status = file.stat()
    return status.st_size, status.st_mtime_ns


def _key(stem: str) -> FrameKey:
    path = Path(stem)
    name = path.name.rstrip("0123456789")
    digits = path.name[len(name) :]
    subject = path.parent.as_posix()
    return FrameKey(subject if subject != "." else "all", name.rstrip("_"), int(digits or 0))


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
    both = (clean > 0) & (noisy > 0)
    ratio = float(np.median(noisy[both] / clean[both])) if both.any() else 1.0
    if in_mm and not 0.5 < ratio < 2.0:  # chosen: noise is far smaller
        raise DatasetError(f"{frame.name}: noisy is {ratio:.3g} times clean: are units the same?")
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
        focal_px: focal length of the camera of pairs; default: a Kinect V2's.
        truth: layer that becomes ``clean_mm``.
        device: sensor file whose fixed pattern and wiggling are subtracted from noisy maps.
        protocol: origin of depths. Default: protocol of the files.

    Raises:
        DatasetError: there is no such folder, split, layer or pair.
        ConfigError: the device is unusable, or distances are needed and unknown.
    """
    if is_dataset(path):
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
        frames = calibrated_frames(frames, DeviceCalibration(device))
    return moved_frames(frames) if (protocol or stored) == "paper" else frames
