"""Files that hold a whole recording: ROS bags and Matroska files, read frame by frame.

Only one frame is in memory at a time, however long the recording is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError, GlsimError, require_package
from glsim.data.map_files import depth_in_mm, floats_in_metres
from glsim.data.recordings.camera_file import StatedCamera

_T = TypeVar("_T")

#: Ends of the names of such files -> what they are called. A ROS 2 bag is a folder.
STREAMS = {".bag": "bag", ".mcap": "bag", ".db3": "bag", ".mkv": "mkv"}
#: Most frames at the end, without infrared, that count as cut off.
_CUT = 3
#: The file of a folder that makes it a ROS 2 bag.
ROS2_FILE = "metadata.yaml"


class FrameStream:
    """A file of many frames, with the infrared images of the same moments.

    Attributes:
        path: of the file.
        kind: "bag" or "mkv".
        step_mm: of whole numbers.
        stated: what it says about its camera.
        notes: what is chosen among its images, in lines for the user.
        camera_notes: what it should say about its camera and does not.
        has_infrared: whether there is infrared beside the depth.
    """

    #: Package that reads the file, and what is said of a file that it cannot read.
    _LIBRARY: ClassVar[str]
    _PROBLEM: ClassVar[str]

    def __init__(self, path: Path) -> None:
        require_package(self._LIBRARY, str(path), "recordings")
        self.path, self.step_mm = path, 1.0
        self.kind = STREAMS.get(path.suffix.lower(), "bag")
        self.notes: tuple[str, ...] = ()
        self._file: Any = None
        self._depth, self._light = self._guarded(self._choose)
        tracks = [track for track in (self._depth, self._light) if track is not None]
        self._times = self._guarded(lambda: self._find_times(tracks))
        light_times = self._times.get(self._light, np.zeros(0, np.int64))
        self._light_of = nearest(self._times[self._depth], light_times)
        paired = [number for number, own in enumerate(self._light_of, 1) if own is not None]
        if paired and 0 < (more := len(self._light_of) - paired[-1]) <= _CUT:
            self._light_of = self._light_of[: paired[-1]]
            self.notes += (f"its last {more} frames have no infrared: they are left out",)
        lit = sum(number is not None for number in self._light_of)
        self.has_infrared = lit == len(self._light_of)
        if lit > 0 and not self.has_infrared:
            self.notes += (f"{lit} of {len(self._light_of)} frames have infrared",)
        self.stated, self.camera_notes = self._guarded(self._read_camera)
        first = self._guarded(lambda: self._image(self._depth, 0))
        #: ROS prescribes metres for floats; some drivers send millimetres.
        self._in_metres = floats_in_metres([first], path)
        if not self._in_metres:
            self.notes += ("floats are taken for mm: their median is too large for metres",)

    def __len__(self) -> int:
        return len(self._light_of)

    def name(self, number: int) -> str:
        """Return the name of a frame, unique in the file."""
        return f"{self.path.stem}_{number:06d}"

    def files(self, number: int) -> tuple[Path, Path | None]:
        """Return the file of depth and that of infrared, which is the same or None."""
        return self.path, self.path if self.has_infrared else None

    def has_infrared_of(self, number: int) -> bool:
        """Whether there is infrared of the same moment as a depth frame."""
        return self._light_of[number] is not None

    def depth(self, number: int) -> tuple[NDArray[np.float32], float]:
        """Read (H, W) float32 depth, mm, 0 = no depth, and its step, mm, 0 of floats (metres).

        Raises DatasetError.
        """
        image = self._guarded(lambda: self._image(self._depth, number))
        step_mm = 0.0 if image.dtype.kind == "f" else self.step_mm
        return depth_in_mm(image, self.step_mm, in_metres=self._in_metres), step_mm

    def infrared(self, number: int) -> NDArray[np.float32] | None:
        """Read the (H, W) float32 counts of the same moment; None without. Raises DatasetError."""
        own = self._light_of[number]
        if own is None:
            return None
        return self._guarded(lambda: self._image(self._light, own)).astype(np.float32)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the open file: each process opens its own."""
        return self.__dict__ | {"_file": None}

    def _guarded(self, read: Callable[[], _T]) -> _T:
        """Return what ``read`` returns; any error of the library becomes a DatasetError."""
        try:
            return read()
        except GlsimError:
            raise
        except Exception as error:  # damaged files raise a dozen kinds
            reason = " ".join(str(error).split()) or repr(error)
            raise DatasetError(f"{self.path}: {self._PROBLEM} ({reason:.200})") from None

    def _choose(self) -> tuple[Any, Any]:
        """Return the track of depth, and that of infrared or None."""
        raise NotImplementedError

    def _find_times(self, tracks: Sequence[Any]) -> dict[Any, NDArray[np.int64]]:
        """Return the rising times of the images of each track."""
        raise NotImplementedError

    def _image(self, track: Any, number: int) -> NDArray[np.generic]:
        """Read an image of a track."""
        raise NotImplementedError

    def _read_camera(self) -> tuple[StatedCamera, tuple[str, ...]]:
        """Return what the file says about its camera, and what is missing."""
        raise NotImplementedError


def is_stream(path: Path) -> bool:
    """Whether a path is a file that holds a whole recording, or a folder that is a ROS 2 bag."""
    return path.suffix.lower() in STREAMS or (path.is_dir() and (path / ROS2_FILE).is_file())


def nearest(times: NDArray[np.int64], others: NDArray[np.int64]) -> list[int | None]:
    """Return, for each time, the number of the other that is nearest.

    None where none is closer than half the usual time between two frames.

    Args:
        times: (N,) of depth frames, rising.
        others: (M,) of infrared frames, rising.
    """
    if len(others) == 0:
        return [None] * len(times)
    steps = np.diff(times if len(times) > 1 else others)
    limit = float(np.median(steps)) / 2 if steps.size else np.inf
    if len(times) == len(others) and (np.abs(times - others) <= limit).all():
        return list(range(len(times)))  # as they follow each other: stamps may be alike
    chosen = np.searchsorted((others[1:] + others[:-1]) / 2, times)
    far = np.abs(others[chosen] - times) > limit
    return [None if away else int(number) for number, away in zip(chosen, far, strict=True)]
