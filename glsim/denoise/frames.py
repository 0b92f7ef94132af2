"""Frames of depth maps for denoisers, from files, moved or calibrated, with neighbours in time."""

from __future__ import annotations

from collections import OrderedDict
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from glsim.core.array_types import Depth
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames, Layer
from glsim.core.depth_protocol import (
    NEAREST_MM,
    DepthProtocol,
    offset_to_nearest,
    stored_protocol,
    subtract_offset,
)
from glsim.core.errors import DatasetError
from glsim.data.recordings.files import MapFiles
from glsim.denoise.depth_files import dataset_root
from glsim.measures.static import view_change
from glsim.networks.interface import MIN_MEASURED_MM

if TYPE_CHECKING:
    from glsim.denoise.calibration import DeviceCalibration

#: A frame with its nearest point at 1 mm and a smaller median depth, mm, is in whole metres.
_METRES_MM = 10.0


def check_millimetres(depth: Depth, where: str, protocol: DepthProtocol = "depth") -> None:
    """Raise DatasetError if the median depth is too small for a camera, as if it were in metres.

    The protocol paper accepts a map with its nearest point at 1 mm.
    """
    values = depth[depth > 0]
    least_mm = MIN_MEASURED_MM if protocol == "depth" else _METRES_MM
    if values.size and (middle := float(np.percentile(values, 50))) < least_mm:
        other = ", or moved to 1 mm (--protocol paper)" if is_moved(depth) else ""
        raise DatasetError(
            f"{where}: its middle depth is {middle:g} mm: is it in metres instead of millimetres"
            f"{other}?"
        )


def is_moved(depth: Depth) -> bool:
    """Return whether a map has its nearest point at exactly 1 mm, and is not in metres."""
    values = depth[depth > 0]
    if not values.size:
        return False
    return float(values.min()) == NEAREST_MM and float(np.percentile(values, 50)) >= _METRES_MM


def moved_frames(frames: Frames) -> Frames:
    """Move the depths of frames so that the nearest point of each clean map is at 1 mm."""
    return frames.changed(_move_to_nearest, "paper", "paper")


def _move_to_nearest(frame: DepthFrame) -> DepthFrame:
    offset_mm = offset_to_nearest(frame.clean_mm)
    return frame.changed(
        {name: subtract_offset(frame.layer(name), offset_mm) for name in ("clean_mm", "noisy_mm")},
        offset_mm=frame.offset_mm + offset_mm,
    )


def calibrated_frames(frames: Frames, device: DeviceCalibration, own_camera: bool) -> Frames:
    """Subtract a device's systematic errors from the noisy maps of frames.

    Args:
        frames: their clean maps stay.
        device: whose errors are subtracted.
        own_camera: a data set states the intrinsics, so that maps may be crops.
    """
    return frames.changed(partial(_calibrate, device, own_camera), device.identity)


def _calibrate(device: DeviceCalibration, own_camera: bool, frame: DepthFrame) -> DepthFrame:
    crop = frame.intrinsics if own_camera else None
    return frame.changed({"noisy_mm": device(frame.noisy_mm, crop)})


class MapReader:
    """A reader of depth-map files without ground truth; a folder's files are one sequence."""

    def __init__(
        self,
        maps: MapFiles,
        device: DeviceCalibration | None = None,
        infrared: bool = False,
        protocol: DepthProtocol = "depth",
    ) -> None:
        """Find the data sets to which the files belong. Raises DatasetError for a damaged data set.

        Args:
            maps: as ``map_files`` opens them.
            device: subtract its errors; crops of data sets have their place in its image.
            infrared: frames have it.
            protocol: "depth": as measured, with the offset that a data set states. "paper": the
                nearest point of each map at 1 mm.
        """
        self._protocol: DepthProtocol = protocol
        self._maps, self._files, self._device = maps, maps.paths, device
        self._infrared = infrared
        self._roots = {folder: dataset_root(folder) for folder in {f.parent for f in self._files}}
        #: Data set -> depth of the nearest point of its maps, mm; None: as measured.
        self._nearest_mm: dict[Path, float | None] = {}
        for root in filter(None, {*self._roots.values()}):
            from glsim.data.header import read_header

            output = read_header(root)["settings"]["output"]
            self._nearest_mm[root] = output.get("nearest_to_mm")
        moved = any(nearest is not None for nearest in self._nearest_mm.values())
        self._pairs = self._dataset_pairs() if device is not None or moved else {}

    def frames(self) -> Frames:
        """Return the maps as frames, with the folder of a file as its subject."""
        return Frames(len(self._files), self._load, self._key, protocol=self._protocol)

    def _key(self, number: int) -> FrameKey:
        return FrameKey(str(self._files[number].parent), "", number)

    def _load(self, number: int) -> DepthFrame:
        """Read a map. Raises DatasetError, or ConfigError if it does not fit the device."""
        file = self._files[number]
        root = self._roots[file.parent]
        stored_mm = self._stored_offset_mm(number)
        depth, _ = self._maps.depth(number, stored_mm, root)
        check_millimetres(depth, str(file), self._protocol)
        if self._device is not None:
            pair = self._pairs.get(file.absolute())
            depth = self._device(depth, None if pair is None else pair.intrinsics)
        height, width = depth.shape
        offset_mm = 0.0
        if self._protocol == "paper":
            at_1_mm = root is not None and stored_protocol(self._nearest_mm[root]) == "paper"
            offset_mm = stored_mm if at_1_mm else offset_to_nearest(depth)
            depth = subtract_offset(depth, offset_mm)
        layers: dict[str, Layer] = {"noisy_mm": depth}
        if self._infrared and (counts := self._maps.infrared(number)) is not None:
            layers["infrared"] = counts
        camera = Intrinsics(width, height, 1.0, 1.0, 0.0, 0.0)
        return DepthFrame(self._key(number), camera, layers, offset_mm=offset_mm, name=str(file))

    def first_are_still(self) -> bool:
        """Return whether the first two maps show one still view; False if one cannot be read."""
        if len(self._files) > 1 and self._key(0)[:2] == self._key(1)[:2]:
            with suppress(DatasetError):
                return not view_change(self._load(0), self._load(1))
        return False

    def as_stored(self, number: int, depth_mm: Depth, offset_mm: float) -> Depth:
        """Return a denoised map, moved from the offset of its frame to the offset of its file."""
        change_mm = self._stored_offset_mm(number) - offset_mm
        return subtract_offset(depth_mm, change_mm, self._maps.step_mm) if change_mm else depth_mm

    def _stored_offset_mm(self, number: int) -> float:
        pair = self._pairs.get(self._files[number].absolute())
        return 0.0 if pair is None else float(pair.record["depth_offset_mm"])

    def _dataset_pairs(self) -> dict[Path, DepthFrame]:
        """Find the frames of data sets to which the files belong: absolute path -> frame."""
        from glsim.data.reader import open_dataset

        wanted = {file.absolute() for file in self._files}
        return {
            path: pair
            for root in self._nearest_mm
            for pair in open_dataset(root)
            for file in pair.record["files"].values()
            if (path := root / file["name"]) in wanted
        }


class Stacks:
    """A reader of frames with their neighbours in time, which reads each file once, in order."""

    def __init__(self, frames: Frames, before: int, after: int) -> None:
        self._frames, self._before, self._after = frames, before, after
        self._cache: OrderedDict[int, DepthFrame | DatasetError] = OrderedDict()

    def frame(self, number: int) -> DepthFrame:
        """Read a frame. Raises DatasetError, again for a frame that failed before."""
        if number not in self._cache:
            try:
                self._cache[number] = self._frames.load(number)
            except DatasetError as error:
                self._cache[number] = error
            while len(self._cache) > self._before + self._after + 1:
                self._cache.popitem(last=False)
        cached = self._cache[number]
        if isinstance(cached, DatasetError):
            raise cached
        return cached

    def around(
        self, number: int, before: int | None = None, after: int | None = None
    ) -> tuple[Depth, int]:
        """Return a frame with its neighbours in time, (T, H, W) noisy mm, and the frame's index.

        Neighbours are of the same sequence and size, moved to the offset of the frame; unreadable
        ones are left out.

        Args:
            number: of the frame.
            before, after: most neighbours; default: as many as the reader holds.

        Raises:
            DatasetError: if the frame itself cannot be read.
        """
        before = self._before if before is None else before
        after = self._after if after is None else after
        frame = self.frame(number)
        key = self._frames.key(number)
        stack: list[Depth] = []
        now = 0
        first, last = max(0, number - before), min(len(self._frames) - 1, number + after)
        for other in range(first, last + 1):
            if other == number:
                now = len(stack)
                stack.append(frame.noisy_mm)
            elif self._frames.key(other)[:2] == key[:2]:
                try:
                    neighbour = _noisy_at(self.frame(other), frame.offset_mm)
                except DatasetError:
                    continue
                if neighbour.shape == frame.noisy_mm.shape:
                    stack.append(neighbour)
        return np.stack(stack), now


def _noisy_at(frame: DepthFrame, offset_mm: float) -> Depth:
    """Return the noisy map of a frame, (H, W) mm, counted from another offset."""
    change_mm = offset_mm - frame.offset_mm
    if change_mm == 0 or np.isnan(change_mm):
        return frame.noisy_mm
    return subtract_offset(frame.noisy_mm, change_mm)
