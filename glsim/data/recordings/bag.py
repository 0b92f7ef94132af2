"""ROS bags with depth: those of librealsense and its viewer, of ROS nodes, and of glsim export.

A ROS 1 bag is a file ``*.bag``, a ROS 2 bag a folder with ``metadata.yaml``. librealsense names its
topics ``/device_0/sensor_0/Depth_0/image/data`` and ``.../Depth_0/info/camera_info``, its options
``/device_0/sensor_0/option/Depth_Units/value`` (metres) and ``.../Stereo_Baseline/value`` (mm); ROS
nodes ``/camera/depth/image_rect_raw`` and ``/camera/depth/camera_info`` (REP 118: 16UC1 is
millimetres, 32FC1 metres).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Distortion, Intrinsics
from glsim.core.errors import DatasetError
from glsim.core.files.png import MAX_MAP_PX
from glsim.core.files.regular import open_regular
from glsim.data.recordings.camera_file import StatedCamera, opencv_order
from glsim.data.recordings.streams import FrameStream

_IMAGE, _INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
#: Encodings of images of one channel -> numpy's types, without byte order.
_TYPES = {
    "16UC1": "u2", "mono16": "u2", "Z16": "u2", "32FC1": "f4", "8UC1": "u1", "mono8": "u1",
}  # fmt: skip
#: Words in the names of topics: of infrared images, and of depth images that are taken last.
_INFRARED = ("infra", "/ir/", "/ir_")
_LATER = ("aligned", "ground_truth", "clean", "expected", "color", "compressed")


class BagStream(FrameStream):
    """The depth images of a bag, and the infrared images of the same moments."""

    _LIBRARY = "rosbags"
    _PROBLEM = "is no readable bag: if its recording was cut off, repair it by rosbag reindex"

    def __init__(self, path: Path) -> None:
        self._cursors: dict[str, tuple[int, Iterator[Any]]] = {}
        super().__init__(path)

    def _choose(self) -> tuple[str, str | None]:
        images = self._topics()
        depth = [
            t for t, kind in images.items() if kind in ("u2", "f4") and not _count(t, _INFRARED)
        ]
        named = [topic for topic in depth if "depth" in topic.lower()]
        if not depth:
            found = f": its images are {', '.join(sorted(images))}" if images else ""
            raise DatasetError(
                f"{self.path}: holds no depth images (16UC1, mono16 or 32FC1){found}: record the "
                "depth stream, not compressed"
            )
        lights = [t for t, kind in images.items() if kind in ("u1", "u2") and _count(t, _INFRARED)]
        chosen = min(named or depth, key=lambda topic: (_count(topic, _LATER), topic))
        return chosen, min(lights, default=None)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the open file: each process opens its own."""
        return super().__getstate__() | {"_cursors": {}}

    def __del__(self) -> None:
        reader = self.__dict__.get("_file")
        if reader is not None:
            with suppress(Exception):  # it may be closed, or half open
                reader.close()

    def _open(self) -> Any:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        if self._file is None:
            if self.path.is_file():
                open_regular(self.path).close()  # a pipe would wait for ever
            store = get_typestore(Stores.ROS2_HUMBLE)
            reader = AnyReader([self.path], default_typestore=store)
            reader.open()
            self._file = reader
        return self._file

    def _of(self, topic: str) -> list[Any]:
        return [c for c in self._open().connections if c.topic == topic]

    def _topics(self) -> dict[str, str]:
        """Return the topics of images of one channel -> their type, by their first message."""
        reader = self._open()
        found = {}
        for topic in sorted({c.topic for c in reader.connections if c.msgtype == _IMAGE}):
            first = self._first(topic)
            if first is not None:
                found[topic] = _TYPES.get(first.encoding, first.encoding)
        return found

    def _first(self, topic: str) -> Any:
        """Return the first message of a topic, None without one."""
        reader = self._open()
        for connection, _, data in reader.messages(self._of(topic)) if self._of(topic) else ():
            return reader.deserialize(data, connection.msgtype)
        return None

    def _find_times(self, tracks: Sequence[str]) -> dict[str, NDArray[np.int64]]:
        return {topic: self._times_of(topic) for topic in tracks}

    def _times_of(self, topic: str) -> NDArray[np.int64]:
        """Return the times of a topic's messages, ns: from the index of a ROS 1 bag."""
        times: list[int] = []
        for connection in self._of(topic):
            indexes = getattr(connection.owner, "indexes", None)
            if indexes is not None:
                times += [entry.time for entry in indexes[connection.id]]
            else:
                times += [time for _, time, _ in self._open().messages([connection])]
        return np.array(sorted(times), np.int64)

    def _image(self, topic: str, number: int) -> NDArray[np.generic]:
        """Read an image; the next one of a topic goes on where the last was read."""
        times = self._times[topic]
        reader = self._open()
        place, messages = self._cursors.get(topic, (-1, iter(())))
        if place != number:
            place = int(np.searchsorted(times, times[number]))  # of equal times the first
            messages = reader.messages(self._of(topic), start=int(times[number]))
        while place < number:
            next(messages)
            place += 1
        connection, _, data = next(messages)
        self._cursors[topic] = (number + 1, messages)
        return _pixels(reader.deserialize(data, connection.msgtype), f"{self.path}: {topic}")

    def _read_camera(self) -> tuple[StatedCamera, tuple[str, ...]]:
        reader = self._open()
        base = self._depth.partition("/image")[0]
        places = [f"{base}/info/camera_info", f"{base}/camera_info"]
        infos = {c.topic for c in reader.connections if c.msgtype == _INFO}
        info = next((self._first(topic) for topic in places if topic in infos), None)
        camera, lens = (None, ()) if info is None else _camera(info)
        device = self._depth.partition("/sensor_")[0]
        sensor = f"{base.rpartition('/')[0]}/option"
        unit, baseline = (self._number(f"{sensor}/{n}") for n in ("Depth_Units", "Stereo_Baseline"))
        stated = StatedCamera(
            camera,
            lens,
            None if unit is None else round(1000 * unit, 6),
            None if baseline is None else round(abs(baseline) / 1000, 7),
            self._device_name(f"{device}/info"),
        )
        note = f"{self.path}: states no intrinsics of {self._depth}: add a camera.toml"
        return stated, () if camera is not None else (note,)

    def _number(self, option: str) -> float | None:
        """Return the value of one of librealsense's options, if it is recorded and not 0."""
        for name in (option, option.replace("_", " ")):
            if (message := self._first(f"{name}/value")) is not None:
                return float(message.data) or None
        return None

    def _device_name(self, topic: str) -> str:
        """Return the camera's name among librealsense's facts about the device."""
        reader, connections = self._open(), self._of(topic)
        for connection, _, data in reader.messages(connections) if connections else ():
            fact = reader.deserialize(data, connection.msgtype)
            if getattr(fact, "key", "") == "Name":
                return str(fact.value)
        return ""


def _count(topic: str, words: Sequence[str]) -> int:
    """Count which of the words the name of a topic holds."""
    return sum(word in topic.lower() for word in words)


def _pixels(message: Any, where: str) -> NDArray[np.generic]:
    """Return the (H, W) pixels of an image message. Raises DatasetError."""
    kind = _TYPES.get(message.encoding)
    height, width, step = int(message.height), int(message.width), int(message.step)
    size = np.dtype(kind or "u1").itemsize
    if kind is None or width * height > MAX_MAP_PX or step < width * size:
        raise DatasetError(
            f"{where}: has images of {width}x{height} in the encoding {message.encoding!r:.40}; "
            f"glsim reads {', '.join(_TYPES)} of at most {MAX_MAP_PX} pixels"
        )
    if len(message.data) < step * height or height * width == 0:
        raise DatasetError(f"{where}: an image of {width}x{height} is cut off")
    rows = np.asarray(message.data, np.uint8)[: step * height].reshape(height, step)
    order = ">" if message.is_bigendian else "<"
    pixels = np.ascontiguousarray(rows[:, : width * size]).view(f"{order}{kind}")
    return pixels.astype(np.dtype(kind))


def _camera(info: Any) -> tuple[Intrinsics | None, tuple[float, ...]]:
    """Return intrinsics and lens of a camera_info; ROS counts from the first pixel's centre."""
    matrix, lens = (np.asarray(getattr(info, n, getattr(info, n.upper(), []))) for n in "kd")
    if matrix.size != 9 or not np.isfinite(matrix).all() or min(matrix[0], matrix[4]) < 1:
        return None, ()
    fx, _, cx, _, fy, cy = (float(value) for value in matrix[:6])
    if min(info.width, info.height) < 1:
        return None, ()
    image = Intrinsics(int(info.width), int(info.height), fx, fy, cx + 0.5, cy + 0.5)
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    model = str(info.distortion_model).lower()
    known = "equidistant" not in model and np.isfinite(lens).all() and lens.size <= len(names)
    values = dict(zip(names, (float(v) for v in lens), strict=False)) if known else {}
    return image, opencv_order(Distortion(**values))
