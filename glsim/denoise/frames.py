"""Frames of depth maps for denoisers: files, moved and calibrated ones, and neighbours in time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.dataset.header import read_header
from glsim.dataset.reader import open_dataset
from glsim.denoise.calibration import DeviceCalibration
from glsim.denoise.depth_files import dataset_root
from glsim.denoise.interface import MIN_MEASURED_MM, Depth
from glsim.depth_frame import DepthFrame
from glsim.depth_protocol import (
    NEAREST_MM,
    DepthProtocol,
    offset_to_nearest,
    stored_protocol,
    subtract_offset,
)
from glsim.errors import DatasetError
from glsim.files.png import read_depth_png
from glsim.geometry.camera import Intrinsics
from glsim.map_files import read_map_mm

#: A frame with its nearest point at 1 mm and a smaller median depth, mm, is in whole metres.
_METRES_MM = 10.0


class Key(NamedTuple):
    """Identifies a frame. Statistics are over subjects; a sequence is ordered in time."""

    subject: str
    sequence: str
    frame: int

    def __str__(self) -> str:
        return f"{self.subject}/{self.sequence}_{self.frame:05d}"


@dataclass(frozen=True, eq=False)
class Sample:
    """A pair of depth maps, (H, W) millimetres, 0 = no depth, with their camera.

    Attributes:
        regions: (H, W) numbers of face regions (see ``Frames.regions``), if the set has them.
        offset_mm: offset subtracted from both maps: 0 under the protocol depth; NaN if the distance
            from the camera is unknown.
    """

    clean_mm: Depth
    noisy_mm: Depth
    intrinsics: Intrinsics
    regions: NDArray[np.uint8] | None = None
    offset_mm: float = 0.0

    def noisy_at(self, offset_mm: float) -> Depth:
        """Return the noisy map with another offset, (H, W) millimetres."""
        change_mm = offset_mm - self.offset_mm
        if change_mm == 0 or np.isnan(change_mm):
            return self.noisy_mm
        return subtract_offset(self.noisy_mm, change_mm)


class Frames(Protocol):
    """Frames by number. Those of a sequence are consecutive, in the order of time."""

    #: A text that changes whenever the frames may have changed.
    identity: str
    #: Labelled face regions: name -> number. Empty without labels.
    regions: Mapping[str, int]
    #: Where the depths are counted from.
    protocol: DepthProtocol

    def __len__(self) -> int:
        """Return the number of frames."""
        ...

    def key(self, number: int) -> Key:
        """Return the key of a frame."""
        ...

    def load(self, number: int) -> Sample:
        """Read a frame. Raises DatasetError if it is missing, damaged, or no depth-map pair."""
        ...

    def infrared(self, number: int) -> NDArray[Any]:
        """Read a frame's infrared, (H, W) counts. Raises DatasetError if there is none."""
        ...


def check_millimetres(depth: Depth, where: str, protocol: DepthProtocol = "depth") -> None:
    """Raise DatasetError if most depths are nearer than any camera measures, as in metres.

    The protocol paper accepts a map with its nearest point at 1 mm.
    """
    values = depth[depth > 0]
    least_mm = MIN_MEASURED_MM if protocol == "depth" else _METRES_MM
    if values.size and (middle := float(np.median(values))) < least_mm:
        other = ", or moved to 1 mm (--protocol paper)" if is_moved(depth) else ""
        raise DatasetError(
            f"{where}: its middle depth is {middle:g} mm: is it in metres instead of millimetres"
            f"{other}?"
        )


def is_moved(depth: Depth) -> bool:
    """Return whether a map without metadata has its nearest point at 1 mm, and is not in metres."""
    values = depth[depth > 0]
    if not values.size:
        return False
    return float(values.min()) == NEAREST_MM and float(np.median(values)) >= _METRES_MM


class ChangedFrames(ABC):
    """Frames of a data set or folder whose depth maps, mm, are changed when they are read."""

    def __init__(self, frames: Frames, identity: str, protocol: DepthProtocol) -> None:
        """identity: of the change. protocol: of the changed maps."""
        self._frames, self.regions, self.protocol = frames, frames.regions, protocol
        self.identity = f"{frames.identity} {identity}"

    def __len__(self) -> int:
        return len(self._frames)

    def key(self, number: int) -> Key:
        """Return the key of a frame."""
        return self._frames.key(number)

    def load(self, number: int) -> Sample:
        """Read a frame and change its depth maps, mm. Raises the errors of both steps."""
        return self._changed(self._frames.load(number))

    @abstractmethod
    def _changed(self, sample: Sample) -> Sample: ...

    def infrared(self, number: int) -> NDArray[Any]:
        """Read a frame's infrared."""
        return self._frames.infrared(number)


class MovedFrames(ChangedFrames):
    """Frames under the protocol paper: the nearest point of each clean map is at 1 mm."""

    def __init__(self, frames: Frames) -> None:
        """frames: under either protocol."""
        super().__init__(frames, "paper", "paper")

    def _changed(self, sample: Sample) -> Sample:
        offset_mm = offset_to_nearest(sample.clean_mm)
        return replace(
            sample,
            clean_mm=subtract_offset(sample.clean_mm, offset_mm),
            noisy_mm=subtract_offset(sample.noisy_mm, offset_mm),
            offset_mm=sample.offset_mm + offset_mm,
        )


class CalibratedFrames(ChangedFrames):
    """Frames whose noisy maps are calibrated; clean maps stay."""

    def __init__(self, frames: Frames, device: DeviceCalibration, own_camera: bool) -> None:
        """own_camera: a data set states the intrinsics, so that maps may be crops."""
        super().__init__(frames, device.identity, frames.protocol)
        self._device, self._own_camera = device, own_camera

    def _changed(self, sample: Sample) -> Sample:
        crop = sample.intrinsics if self._own_camera else None
        return replace(sample, noisy_mm=self._device(sample.noisy_mm, crop))


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
        self._roots = {folder: dataset_root(folder) for folder in {f.parent for f in files}}
        #: Data set -> depth of the nearest point of its maps, mm; None: as measured.
        self._nearest_mm = {
            root: read_header(root)["settings"]["output"].get("nearest_to_mm")
            for root in {*self._roots.values()}
            if root is not None
        }
        moved = any(nearest is not None for nearest in self._nearest_mm.values())
        self._pairs = self._dataset_pairs() if device is not None or moved else {}

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
        root = self._roots[file.parent]
        stored_mm = self._stored_offset_mm(number)
        depth = read_map_mm(file, self._unit_mm, stored_mm, inside=root)
        check_millimetres(depth, str(file), self.protocol)
        if self._device is not None:
            pair = self._pairs.get(file.absolute())
            depth = self._device(depth, None if pair is None else pair.intrinsics)
        height, width = depth.shape
        offset_mm = 0.0
        if self.protocol == "paper":
            at_1_mm = root is not None and stored_protocol(self._nearest_mm[root]) == "paper"
            offset_mm = stored_mm if at_1_mm else offset_to_nearest(depth)
            depth = subtract_offset(depth, offset_mm)
        camera = Intrinsics(width, height, 1.0, 1.0, 0.0, 0.0)
        return Sample(depth, depth, camera, offset_mm=offset_mm)

    def as_stored(self, number: int, depth_mm: Depth, offset_mm: float) -> Depth:
        """Return a denoised map with the offset of its file instead of its ``Sample``'s."""
        change_mm = self._stored_offset_mm(number) - offset_mm
        return subtract_offset(depth_mm, change_mm, self._unit_mm) if change_mm else depth_mm

    def infrared(self, number: int) -> NDArray[Any]:
        """Read the infrared counts of a map. Raises DatasetError if they are no 16-bit image."""
        return read_depth_png(self._infrared[number])

    def _stored_offset_mm(self, number: int) -> float:
        pair = self._pairs.get(self._files[number].absolute())
        return 0.0 if pair is None else pair.offset_mm

    def _dataset_pairs(self) -> dict[Path, DepthFrame]:
        """Return the frames of those maps that belong to data sets, by absolute path."""
        wanted = {file.absolute() for file in self._files}
        return {
            path: pair
            for root in self._nearest_mm
            for pair in open_dataset(root)
            for file in pair.record["files"].values()
            if (path := root / file["name"]) in wanted
        }


class Stacks:
    """Reads frames with their neighbours in time; if read in order, each file is read once."""

    def __init__(self, frames: Frames, before: int, after: int) -> None:
        self._frames, self._before, self._after = frames, before, after
        self._cache: OrderedDict[int, Sample | DatasetError] = OrderedDict()

    def sample(self, number: int) -> Sample:
        """Read one frame. Raises DatasetError, also for a frame that failed before."""
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
        """Return the noisy frames around a frame, (T, H, W) millimetres, and its index among them.

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
        sample = self.sample(number)
        key = self._frames.key(number)
        stack: list[Depth] = []
        now = 0
        first, last = max(0, number - before), min(len(self._frames) - 1, number + after)
        for other in range(first, last + 1):
            if other == number:
                now = len(stack)
                stack.append(sample.noisy_mm)
            elif self._frames.key(other)[:2] == key[:2]:
                try:
                    neighbour = self.sample(other).noisy_at(sample.offset_mm)
                except DatasetError:
                    continue
                if neighbour.shape == sample.noisy_mm.shape:
                    stack.append(neighbour)
        return np.stack(stack), now
