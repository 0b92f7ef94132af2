"""Where the frames of ``glsim live`` come from: a recording that begins again at its end."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.geometry.camera import Intrinsics
from glsim.recordings.recording import Recording

#: Frames a second of a recording: those of every camera that glsim knows, in their usual modes.
RATE_HZ: Final = 30.0


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """One measured frame.

    Attributes:
        number: from 0; that of the recording, or counted since the camera was opened.
        depth_mm: (H, W) float32, 0 = no depth.
        infrared: (H, W) float32 counts; None without.
        camera: its intrinsics.
    """

    number: int
    depth_mm: NDArray[np.float32]
    infrared: NDArray[np.float32] | None
    camera: Intrinsics


class Source(Protocol):
    """What gives frame after frame, on one thread.

    Attributes:
        title: for people.
        frames: number of frames; None: a camera's, without end.
    """

    title: str
    frames: int | None

    def next(self) -> LiveFrame:
        """Return the next frame. Raises DatasetError or DeviceError; the one after may be good."""
        ...

    def close(self) -> None:
        """Let the camera go."""
        ...


class RecordingSource:
    """The frames of a recording at RATE_HZ at most, from the first one again after the last."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.title = recording.path.name or str(recording.path)
        self.frames: int | None = len(recording.files)
        self._next, self._due_s = 0, 0.0

    def next(self) -> LiveFrame:
        """Return the next frame, not before its time. Raises DatasetError if it is unreadable."""
        number, self._next = self._next, (self._next + 1) % len(self._recording.files)
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = time.monotonic() + 1 / RATE_HZ
        frame = self._recording.frame(number)
        return LiveFrame(number, np.nan_to_num(frame.depth_mm), frame.infrared, frame.camera)

    def close(self) -> None:
        """Do nothing: files are open only while they are read."""
