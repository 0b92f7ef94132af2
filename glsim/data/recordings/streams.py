"""Files that hold a whole recording: ROS bags and Matroska files, read frame by frame.

Only one frame is in memory at a time, however long the recording is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError, GlsimError, counted, require_package
from glsim.core.files.listing import entries
from glsim.data.map_files import DUMPS, READ_ONLY, SUFFIXES, depth_in_mm, floats_in_metres
from glsim.data.recordings.camera_file import StatedCamera

_T = TypeVar("_T")

#: Suffix of a file with a whole recording -> its kind. A ROS 2 bag may also be a folder.
STREAMS = {".bag": "bag", ".mcap": "bag", ".db3": "bag", ".mkv": "mkv"}
#: Up to this number of last frames may lack infrared, since the file may have been cut off.
_CUT = 3
#: The file of a folder that makes it a ROS 2 bag.
ROS2_FILE = "metadata.yaml"
#: Name of a part of a split bag: name, the part's own date and time, number, suffix.
_PART = re.compile(r"(.*?)(?:\d{4}(?:-\d\d){5})?_(\d{1,9})(\.bag|\.mcap|\.db3)", re.ASCII)


class FrameStream:
    """A file with many depth frames, and the infrared images of the same times.

    Attributes:
        notes: lines for the user about chosen topics or tracks.
        camera_notes: lines for the user about missing statements of the camera.
    """

    #: Package that reads the file, and message about a file that it cannot read.
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
            self.notes += (f"the last {counted(more, 'frame')}, without infrared, left out",)
        lit = sum(number is not None for number in self._light_of)
        self.has_infrared = lit == len(self._light_of)
        if lit > 0 and not self.has_infrared:
            self.notes += (f"{lit} of {counted(len(self._light_of), 'frame')} with infrared",)
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
        """Return the file of the depth, and the file of the infrared: the same file or None."""
        return self.path, self.path if self.has_infrared else None

    def has_infrared_of(self, number: int) -> bool:
        """Whether an infrared image has the same time as a depth frame."""
        return self._light_of[number] is not None

    def depth(self, number: int) -> tuple[NDArray[np.float32], float]:
        """Read (H, W) float32 depth in mm, 0 = no depth; and its step in mm, 0 for floats.

        Raises DatasetError.
        """
        image = self._guarded(lambda: self._image(self._depth, number))
        step_mm = 0.0 if image.dtype.kind == "f" else self.step_mm
        return depth_in_mm(image, self.step_mm, in_metres=self._in_metres), step_mm

    def infrared(self, number: int) -> NDArray[np.float32] | None:
        """Read (H, W) float32 infrared counts of the same time, or None. Raises DatasetError."""
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
        """Return the depth track, and the infrared track or None."""
        raise NotImplementedError

    def _find_times(self, tracks: Sequence[Any]) -> dict[Any, NDArray[np.int64]]:
        """Return the rising times of the images of each track."""
        raise NotImplementedError

    def _image(self, track: Any, number: int) -> NDArray[np.generic]:
        """Read an image of a track."""
        raise NotImplementedError

    def _read_camera(self) -> tuple[StatedCamera, tuple[str, ...]]:
        """Return the stated camera, and remarks about missing statements."""
        raise NotImplementedError


def is_stream(path: Path) -> bool:
    """Whether a path is a file that holds a whole recording, or a folder that is a bag."""
    folder = path.is_dir() and ((path / ROS2_FILE).is_file() or bool(parts_of(path)))
    return folder or path.suffix.lower() in STREAMS


def parts_of(folder: Path) -> list[Path]:
    """Return the files of a folder in the order of their numbers, if they are one split bag.

    They are NAME_0.bag, NAME_1.bag and so on, without a gap and with no other recording or map
    beside them (.mcap and .db3 likewise). Each name may have its own date, as rosbag record --split
    writes them. [] for other folders.
    """
    names, _ = entries(folder, (*STREAMS,))
    parts = sorted(filter(None, map(_PART.fullmatch, names)), key=lambda part: int(part[2]))
    split = len(names) > 1 and [int(part[2]) for part in parts] == [*range(len(names))]
    if not split or len({(part[1], part[3]) for part in parts}) > 1:
        return []
    maps, _ = entries(folder, (*SUFFIXES, *READ_ONLY, *DUMPS))
    return [] if maps else [folder / part[0] for part in parts]


def nearest(times: NDArray[np.int64], others: NDArray[np.int64]) -> list[int | None]:
    """Return the number of the nearest infrared frame for each depth frame.

    None if no infrared frame is closer than half the median time between two frames.

    Args:
        times: (N,) times of the depth frames, rising.
        others: (M,) times of the infrared frames, rising.
    """
    if len(others) == 0:
        return [None] * len(times)
    steps = np.diff(times if len(times) > 1 else others)
    limit = float(np.median(steps)) / 2 if steps.size else np.inf
    if len(times) == len(others) and (np.abs(times - others) <= limit).all():
        return list(range(len(times)))  # in order, since time stamps may be equal
    chosen = np.searchsorted((others[1:] + others[:-1]) / 2, times)
    far = np.abs(others[chosen] - times) > limit
    return [None if away else int(number) for number, away in zip(chosen, far, strict=True)]
