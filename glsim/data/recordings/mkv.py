"""Matroska files of an Azure Kinect or a Femto, as k4arecorder writes them.

The track DEPTH is 16-bit grey, big endian (b16g), in steps of 1 mm. The track IR has the same
format, in counts. Tracks that were compressed again, such as by FFV1, are read as well. The factory
calibration of the device is an attachment, calibration.json, normalised to the whole chip.
Sources: Microsoft's page on the format of recordings, and mode_specific_calibration.c of the
Azure-Kinect-Sensor-SDK for the part of the chip that each mode shows.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Distortion, Intrinsics
from glsim.core.errors import DatasetError
from glsim.core.files.png import MAX_MAP_PX
from glsim.core.files.regular import BoundedFile, open_regular
from glsim.data.recordings.camera_file import StatedCamera, opencv_order
from glsim.data.recordings.streams import FrameStream

#: Size of the chip, px, to which the calibration is normalised.
_CHIP_PX = 1024
#: Bytes that are read until frames begin, and for one packet; a frame of 1024 x 1024 px
#: has 2 MB, and attachments some kB. ffmpeg allocates the stated length of an element. Chosen.
_PART_BYTES = 1 << 25
#: Largest calibration.json, bytes; that of a device has 7 kB. A list of lists takes 22 times more.
_CALIBRATION_BYTES = 1 << 20
#: (width, height) of a mode -> chip pixels per pixel along each axis; first column and first row on
#: the chip, in pixels of the mode; glsim's sensor.
_MODES = {
    (640, 576): (1, 192, 180, "azure-kinect"),
    (320, 288): (2, 96, 90, "azure-kinect-nfov-binned"),
    (512, 512): (2, 0, 0, "azure-kinect-wfov"),
    (1024, 1024): (1, 0, 0, "azure-kinect-wfov-unbinned"),
}
#: Names of the tracks, in lower case; without these names, the first tracks are used.
_DEPTH, _LIGHT = ("depth",), ("ir", "infrared")
_GREY = ("gray16be", "gray16le")
#: Order of the model's parameters in the calibration (k4a_calibration_intrinsic_parameters_t).
_PARAMETERS = (
    "cx", "cy", "fx", "fy", "k1", "k2", "k3", "k4", "k5", "k6", "codx", "cody", "p2", "p1",
)  # fmt: skip


class MkvStream(FrameStream):
    """The depth track of a Matroska file, and infrared images of the same times."""

    _LIBRARY = "av"
    _PROBLEM = "is no readable Matroska file"

    def _open(self) -> Any:
        import av

        if self._file is None:
            with self._bounded() as head, suppress(av.error.FFmpegError):  # raised below
                av.open(head, format="matroska").close()  # attachments come first
            self._file = av.open(str(self.path), format="matroska")
        return self._file

    def _bounded(self) -> BoundedFile:
        problem = f"has {_PART_BYTES >> 20} MB or more before a frame: record it again"
        return BoundedFile(open_regular(self.path), _PART_BYTES, problem)

    def _choose(self) -> tuple[int, int | None]:
        """Find the tracks of depth and infrared. Raises DatasetError without depth."""
        videos = self._open().streams.video
        grey = [v for v in videos if v.codec_context.pix_fmt in _GREY]
        names = {v.index: v.metadata.get("title", "").lower() for v in grey}
        named = [v.index for v in grey if names[v.index] in _DEPTH]
        unnamed = [v.index for v in grey if names[v.index] not in (*_DEPTH, *_LIGHT)]
        found = [*named, *unnamed]
        if not found:
            tracks = ", ".join(
                f"{v.metadata.get('title', 'unnamed')} ({v.codec_context.pix_fmt})" for v in videos
            )
            raise DatasetError(
                f"{self.path}: has no depth track of 16-bit grey"
                f"{f', only {tracks}' if tracks else ''}: record with depth, as k4arecorder does"
            )
        lights = [v.index for v in grey if names[v.index] in _LIGHT]
        context = self._open().streams[found[0]].codec_context
        if context.width * context.height > MAX_MAP_PX:
            raise DatasetError(
                f"{self.path}: its images are {context.width} x {context.height} pixels, more than "
                f"the {MAX_MAP_PX} pixels that glsim reads"
            )
        return found[0], next(iter([*lights, *found[1:]]), None)

    def _find_times(self, tracks: Sequence[int]) -> dict[int, NDArray[np.int64]]:
        """Return the times of complete frames of each track; the file is read once."""
        import av

        times: dict[int, list[int]] = {number: [] for number in tracks}
        try:
            with self._bounded() as file, av.open(file, format="matroska") as container:
                file.left = _PART_BYTES
                for packet in container.demux():
                    file.left = _PART_BYTES
                    if packet.pts is None or packet.stream.index not in times:
                        continue
                    context = packet.stream.codec_context
                    size = 2 * context.width * context.height
                    if context.name != "rawvideo" or packet.size == size:
                        times[packet.stream.index].append(packet.pts)
        except av.error.FFmpegError:
            if not times[tracks[0]]:
                raise
        if not times[tracks[0]]:
            raise DatasetError(f"{self.path}: its depth track has no frames: record it again")
        return {number: np.array(sorted(t), np.int64) for number, t in times.items()}

    def _image(self, track: int, number: int) -> NDArray[np.generic]:
        time = int(self._times[track][number])
        container = self._open()
        stream = container.streams[track]
        container.seek(time, stream=stream)
        for packet in container.demux(stream):
            for frame in packet.decode():
                if frame.pts is not None and frame.pts >= time:
                    pixels: NDArray[np.generic] = frame.to_ndarray().astype(np.uint16)
                    return pixels
        raise DatasetError(f"{self.path}: the frame at {time * float(stream.time_base):.3f} s ends")

    def _read_camera(self) -> tuple[StatedCamera, tuple[str, ...]]:
        container = self._open()
        context = container.streams[self._depth].codec_context
        size = context.width, context.height
        texts = [
            bytes(s.data)
            for s in container.streams
            if s.type == "attachment" and s.name.endswith(".json")
        ]
        if (mode := _MODES.get(size)) is None:
            why = f"{size[0]}x{size[1]} is no mode of an Azure Kinect: calibration is not read"
            return StatedCamera(unit_mm=1.0), (why,)
        if texts and (found := _factory_camera(texts[0], size, mode)) is not None:
            return StatedCamera(*found, 1.0, sensor=mode[-1]), ()
        why = "its calibration.json cannot be used" if texts else "it has no calibration.json"
        return StatedCamera(unit_mm=1.0, sensor=mode[-1]), (why,)


def _factory_camera(
    text: bytes, size: tuple[int, int], mode: tuple[int, int, int, str]
) -> tuple[Intrinsics, tuple[float, ...]] | None:
    """Return a mode's intrinsics and lens from the factory's JSON; None for another JSON file."""
    try:
        if len(text) > _CALIBRATION_BYTES:
            return None
        cameras = json.loads(text)["CalibrationInformation"]["Cameras"]
        own = next(c for c in cameras if c["Purpose"] == "CALIBRATION_CameraPurposeDepth")
        numbers = [float(v) for v in own["Intrinsics"]["ModelParameters"]]
        p = dict(zip(_PARAMETERS, numbers, strict=True))
    except (ValueError, KeyError, TypeError, StopIteration, RecursionError):
        return None
    binning, column, row, _ = mode
    side = _CHIP_PX / binning
    if not np.isfinite(numbers).all() or min(p["fx"], p["fy"]) * side < 1:
        return None
    fx, fy = p["fx"] * side, p["fy"] * side
    image = Intrinsics(*size, fx, fy, p["cx"] * side - column, p["cy"] * side - row)
    lens = Distortion(**{n: p[n] for n in ("k1", "k2", "k3", "p1", "p2", "k4", "k5", "k6")})
    return image, opencv_order(lens)
