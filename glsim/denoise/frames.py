"""Frames of depth maps for denoisers, from files, moved or calibrated, with neighbours in time."""

from __future__ import annotations

from collections import OrderedDict
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from glsim.core.array_types import Depth
from glsim.core.depth_frame import DepthFrame, Frames
from glsim.core.depth_protocol import NEAREST_MM, DepthProtocol, offset_to_nearest
from glsim.core.errors import ConfigError, DatasetError, DenoiserError
from glsim.core.units import subtract_offset
from glsim.data.recording import Recording
from glsim.measures.static import view_change
from glsim.networks.interface import METRES_MM, MIN_MEASURED_MM

if TYPE_CHECKING:
    from glsim.denoise.calibration import DeviceCalibration
    from glsim.denoise.denoiser import Denoiser


def check_millimetres(depth: Depth, where: str, protocol: DepthProtocol = "depth") -> None:
    """Raise DatasetError if the median depth is too small for a camera, as if it were in metres.

    The protocol paper accepts a map with its nearest point at 1 mm.
    """
    values = depth[depth > 0]
    least_mm = MIN_MEASURED_MM if protocol == "depth" else METRES_MM
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
    return float(values.min()) == NEAREST_MM and float(np.percentile(values, 50)) >= METRES_MM


def moved_frames(frames: Frames) -> Frames:
    """Move the depths of frames so that the nearest point of each clean map is at 1 mm."""
    return frames.changed(_move_to_nearest, "paper", "paper")


def _move_to_nearest(frame: DepthFrame) -> DepthFrame:
    offset_mm = offset_to_nearest(frame.clean_mm)
    return frame.changed(
        {name: subtract_offset(frame.layer(name), offset_mm) for name in ("clean_mm", "noisy_mm")},
        offset_mm=frame.offset_mm + offset_mm,
    )


def calibrated_frames(frames: Frames, device: DeviceCalibration) -> Frames:
    """Subtract a device's systematic errors from the noisy maps of frames; clean maps stay.

    Frames of a data set, whose record has their intrinsics, may be crops.
    """
    return frames.changed(partial(_calibrate, device), device.identity)


def _calibrate(device: DeviceCalibration, frame: DepthFrame) -> DepthFrame:
    crop = frame.intrinsics if "intrinsics" in frame.record else None
    return frame.changed({"noisy_mm": device(frame.noisy_mm, crop)})


def prepared_frames(
    recording: Recording, device: DeviceCalibration | None = None, protocol: DepthProtocol = "depth"
) -> Frames:
    """Check, calibrate and move the maps of a recording for a denoiser.

    Returns frames that raise DatasetError if their depths cannot be millimetres.

    Args:
        recording: noisy maps without clean ones.
        protocol: "depth": measured depths. "paper": the nearest point of each map is at 1 mm.
    """
    frames = recording.frames.changed(partial(_check, protocol))
    if device is not None:
        frames = calibrated_frames(frames, device)
    if protocol == "paper":
        move = partial(_move_noisy, recording.protocol == "paper")
        frames = frames.changed(move, "paper", "paper")
    return frames


def _check(protocol: DepthProtocol, frame: DepthFrame) -> DepthFrame:
    check_millimetres(frame.noisy_mm, frame.record.get("file", frame.name), protocol)
    return frame


def _move_noisy(stored: bool, frame: DepthFrame) -> DepthFrame:
    """Move a map to 1 mm: by the offset that its data set stores, else by its nearest point."""
    own_mm = frame.record.get("depth_offset_mm", 0.0) if stored else 0.0
    offset_mm = own_mm or offset_to_nearest(frame.noisy_mm)
    moved = subtract_offset(frame.noisy_mm, offset_mm)
    return frame.changed({"noisy_mm": moved}, offset_mm=offset_mm)


class DenoisedMaps:
    """A reader that denoises the maps of a recording one after the other.

    Attributes:
        frames: the denoised maps; "sigma_mm" is their uncertainty, mm, if it is estimated.
        unchanged: number of maps that the denoiser did not change.
        first_are_still: whether the first two maps show one still view.
    """

    def __init__(self, recording: Recording, denoiser: Denoiser, protocol: DepthProtocol) -> None:
        """Prepare the maps; errors of the denoiser's device are subtracted first.

        Raises ConfigError: the denoiser needs infrared, and a map has none.
        """
        if denoiser.infrared and (dark := recording.first_without_infrared()):
            raise ConfigError(
                f"{dark}: has no infrared image beside it ({dark.stem}_infrared.png), which this "
                "denoiser uses: give one with --infrared, or choose the network face"
            )
        self._denoiser = denoiser
        noisy = prepared_frames(recording, denoiser.device, protocol)
        self._stacks = Stacks(noisy, denoiser.before, denoiser.after)
        self.frames = Frames(len(noisy), self._load, noisy.key)
        self.unchanged, self.first_are_still = 0, False
        self._first: DepthFrame | None = None

    def _load(self, number: int) -> DepthFrame:
        denoiser, (stack, now) = self._denoiser, self._stacks.around(number)
        frame = self._stacks.frame(number)
        if number == 0:
            self._first = frame
        elif number == 1 and (first := self._first) is not None:
            alike = first.key[:2] == frame.key[:2] and first.noisy_mm.shape == frame.noisy_mm.shape
            self.first_are_still = alike and not view_change(first, frame)
        counts = frame.layer("infrared") if denoiser.infrared else None
        estimate = denoiser.estimate(stack, now, counts)
        if denoiser.function.keep_clean:
            self.unchanged += np.array_equal(estimate.depth_mm, stack[now])
        layers = {"noisy_mm": estimate.composite(denoiser.composite or "measured")}
        bad = ~(np.isfinite(layers["noisy_mm"]) & (layers["noisy_mm"] >= 0))
        if bad.any():
            raise DenoiserError(
                f"{denoiser.label}: returned {bad.sum()} depths that are negative or no number for "
                f"{frame.record.get('file', frame.name)}"
            )
        if estimate.sigma_mm is not None:
            layers["sigma_mm"] = estimate.sigma_mm
        return frame.changed(layers)


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

        Neighbours have the same sequence and size, and are shifted to the offset of the frame.
        Unreadable neighbours are left out. Raises DatasetError if the frame itself cannot be read.

        ``before``, ``after``: largest numbers of neighbours. Default: as many as the reader keeps.
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
    """Return the noisy map of a frame, (H, W) mm, shifted to another offset."""
    change_mm = offset_mm - frame.offset_mm
    if change_mm == 0 or np.isnan(change_mm):
        return frame.noisy_mm
    return subtract_offset(frame.noisy_mm, change_mm)
