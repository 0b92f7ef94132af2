"""ROS bags with depth: those of librealsense and its viewer, of ROS nodes, and of glsim export.

A ROS 1 bag is a file ``*.bag``, a ROS 2 bag a folder with ``metadata.yaml`` or one file ``*.mcap``
or ``*.db3``; a split bag is a folder of such files. librealsense names its topics
``/device_0/sensor_0/Depth_0/image/data`` and ``.../Depth_0/info/camera_info``, its options
``/device_0/sensor_0/option/Depth_Units/value`` (metres) and ``.../Stereo_Baseline/value`` (mm). In
images of ROS nodes, 16UC1 is millimetres and 32FC1 metres (REP 118); their camera_info is beside
the images, above them, or has the same frame_id.
"""

from __future__ import annotations

import re
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from functools import cache
from heapq import merge
from itertools import takewhile
from operator import itemgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Distortion, Intrinsics
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.regular import MOST_HELD, BoundedFile, open_regular, read_regular
from glsim.core.units import MM_PER_M
from glsim.data.recordings.camera_file import StatedCamera, opencv_order
from glsim.data.recordings.ros_images import TYPES, encoding_of, read_pixels
from glsim.data.recordings.streams import ROS2_FILE, FrameStream, parts_of

_INFO = "sensor_msgs/msg/CameraInfo"
_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
#: Lens models with OpenCV's coefficients; a remark names any other model.
_LENSES = ("", "none", "plumb bob", "rational polynomial", "brown conrady")
#: If a camera_info has another size than the images, its scales along x and y may differ by this
#: share: sizes of decimated images are rounded to multiples of 4 px.
_UNEQUAL = 0.02
#: Largest metadata.yaml, bytes, which is read in 3 s; recorders write 1 to 2 kB for each topic.
_METADATA_BYTES = 3 << 16
#: Largest first line of a bag ("#ROSBAG V2.0"), and more than once read parts of an index, bytes;
#: number of records that may be compressed to any size. Chosen.
_LINE_BYTES, _AGAIN_BYTES, _FEW_RECORDS = 64, 1 << 20, 1000


class _Path(type(Path())):  # type: ignore[misc]
    """A path of a bag, of which the library reads bounded parts of regular files."""

    opened: ClassVar[list[BoundedFile]] = []

    def check(self) -> int:
        """Return the size of a regular file; of a bag's folder, links may not lead out of it."""
        folder = self.parent if (self.parent / ROS2_FILE).is_file() else None
        with open_regular(Path(self), inside=folder):
            return int(self.stat().st_size)

    def open(self, mode: str = "r", *others: Any, **named: Any) -> Any:
        if "w" in mode:  # a file that the library unpacks
            return super().open(mode, *others, **named)
        size = self.check()
        problem = "its index lists parts twice"
        file = _PartsFile(open_regular(Path(self)), size + _AGAIN_BYTES, problem)
        self.opened.append(file)
        return file

    def read_text(self, *_: Any, **__: Any) -> str:
        text = read_regular(Path(self), _METADATA_BYTES, inside=self.parent).decode()
        if re.search(r"(?m)(?:^|[\s\[,:{-])[*&]\w", text):
            raise ValueError("its metadata.yaml repeats parts by anchors")
        return text


class _PartsFile(BoundedFile):
    """A file that is read in parts of at most MOST_HELD bytes; ValueError for larger ones.

    While the index is read, ``left`` lets each byte be read once: entries that all name one part
    would take memory without end.
    """

    def read(self, size: int = -1) -> bytes:
        data = super().read(size if 0 <= size <= MOST_HELD else MOST_HELD + 1)
        if len(data) > MOST_HELD:
            raise ValueError(f"a part has more than {MOST_HELD >> 20} MB")
        if data == b"\0":  # the kind of a record of MCAP
            raise ValueError("zeros stand between its records")
        return data

    def readline(self) -> bytes:
        line: bytes = self._file.readline(_LINE_BYTES)
        return line


def _check_database(file: _Path) -> None:
    """Raise ValueError for an SQLite file with computed or endless tables, or too long values."""
    rows = file.check() // 4  # an entry takes more bytes; pages that name each other have no end
    with closing(sqlite3.connect(f"{file.absolute().as_uri()}?immutable=1", uri=True)) as database:
        run = database.execute
        schema = run("SELECT type, name, tbl_name, sql FROM sqlite_master LIMIT 100").fetchall()
        for kind, name, table, text in schema:
            if kind not in ("table", "index") or re.search(r"(?i)\b(virtual|as)\b", text or ""):
                raise ValueError(f"its {kind} {name!a:.40} is computed, which no recorder makes")
            index = "" if kind == "table" else f" INDEXED BY {_quoted(name)}"
            count = f"SELECT count(*) FROM (SELECT 1 FROM {_quoted(table)}{index} LIMIT {rows + 1})"
            if run(count).fetchone()[0] > rows:
                raise ValueError(f"its {kind} {name!a:.40} has no end")
            for _, column, *_ in run(f"PRAGMA table_info({_quoted(name)})").fetchall():
                long = f"length({_quoted(column)}) > {MOST_HELD} LIMIT 1"
                if run(f"SELECT 1 FROM {_quoted(name)} WHERE {long}").fetchone():
                    raise ValueError(f"its {name!a:.40} has a value of more than {MOST_HELD} bytes")


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _unpack(decompressor: Any, data: bytes) -> bytes:
    """Decompress a part of a bag, as the library does, within half of MOST_HELD: it is held twice.

    Raises ValueError for more.
    """
    unpacked: bytes = decompressor.decompress(data, MOST_HELD // 2)
    if not decompressor.eof:
        raise ValueError(f"a part is cut short, or unpacks to more than {MOST_HELD >> 21} MB")
    return unpacked


def _unpack_records(decompressor: Any, data: bytes) -> bytes:
    """Decompress a chunk of MCAP as ``_unpack`` does. Raises ValueError for too many records.

    A record takes 5 bytes and more, however well it is compressed, since its time is its own.
    """
    unpacked, place, count = _unpack(decompressor, data), 0, 0
    while place < len(unpacked):
        place += 9 + int.from_bytes(unpacked[place + 1 : place + 9], "little")
        count += 1
        if count > _FEW_RECORDS + len(data) // 4:
            raise ValueError(f"a part of {len(data)} bytes has more than {count - 1} records")
    return unpacked


def _open_packed(file: Any, mode: str) -> BoundedFile:
    """Open a file that the library unpacks to disk."""
    from rosbags.rosbag2.storage_mcap import zstd

    problem = "a file unpacks to more than half of the free space of TMPDIR"
    free = shutil.disk_usage(tempfile.gettempdir()).free
    return BoundedFile(zstd.open(file, mode), free // 2, problem)


def _words(words: str) -> re.Pattern[str]:
    return re.compile(rf"(?<![a-z])({words})\d*(?![a-z])")


#: Kind of images -> words of topics' names that mark it; the first matching kind counts.
_ROLES = {
    "other": _words(
        "confidence|conf|disparity|amplitude|intensity|noise|gr[ae]y|thermal|labels?|mask|normals?|"
        "semantic|segmentation|uncertainty|variance|sigma|std(dev)?|reflectivity|ambient|flow|mono"
    ),
    "infrared": _words("infrared|infra|n?ir"),
    "depth": re.compile("depth"),
}
#: Topics of images resampled for another camera, or filtered; they are the last choice.
_RESAMPLED = re.compile(
    _words("aligned|registered|q?hd|colou?r|rgb|ground_truth|clean|expected|filtered").pattern
    + "|_to_"
)


@cache
def _types(ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)


class BagStream(FrameStream):
    """The depth images of a bag, and infrared images of the same times."""

    _LIBRARY = "rosbags"
    _PROBLEM = "is no readable bag; one that was cut off: repair it by rosbag reindex, mcap recover"

    def __init__(self, path: Path, topic: str | None = None) -> None:
        split = path.is_dir() and not (path / ROS2_FILE).is_file()
        self._parts = parts_of(path) if split else [path]
        self._is_ros1 = self._parts[0].suffix.lower() == ".bag"
        self._cursors: dict[str, tuple[int, Iterator[Any]]] = {}
        self._asked = topic
        super().__init__(path)

    def _choose(self) -> tuple[str, str | None]:
        firsts = {t: self._first(t) for t in self._names(*_IMAGES)}
        images = {t: (encoding_of(m), m) for t, m in sorted(firsts.items()) if m is not None}
        known = [t for t, (name, _) in images.items() if TYPES.get(name, "u1") != "u1"]
        named = [topic for topic in known if _role(topic) == "depth"]
        # 16-bit grey images are depth only if their topic's name marks depth.
        depth = named or [t for t in known if not _role(t) and images[t][0] != "mono16"]
        found = ", ".join(f"{t} ({name or m.format})" for t, (name, m) in images.items())
        if self._asked is not None:
            if self._asked not in known:
                raise ConfigError(f"--topic {self._asked}: {self.path} has {found or 'no images'}")
            depth = [self._asked, *(topic for topic in depth if topic != self._asked)]
        elif not depth or (len(depth) > 1 and not named):
            raise DatasetError(
                f"{self.path}: holds no images whose name says depth, of 16UC1, mono16 or 32FC1"
                f"{f': choose by --topic of {found}' if found else ''}"
            )
        chosen = self._asked or min(depth, key=_rank)
        if others := [topic for topic in depth if topic != chosen]:
            self.notes = (f"the depth is that of {chosen}; --topic chooses {', '.join(others)}",)
        shape = self._shape(chosen)
        lights = [
            topic
            for topic, (name, message) in images.items()
            if TYPES.get(name) in ("u1", "u2")
            and _role(topic) == "infrared"
            and (getattr(message, "height", 0), getattr(message, "width", 0)) == shape
            and _shared(topic, chosen) == max(_shared(topic, other) for other in depth)
        ]
        light = min(lights, key=lambda topic: (-_shared(topic, chosen), topic), default=None)
        return chosen, light

    def _names(self, *kinds: str) -> set[str]:
        return {c.topic for part in self._open() for c in part.connections if c.msgtype in kinds}

    def _shape(self, topic: str) -> tuple[int, ...]:
        """Return (height, width) of the first image of a topic."""
        return read_pixels(self._first(topic), f"{self.path}: {topic}").shape

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the open file: each process opens its own."""
        return super().__getstate__() | {"_cursors": {}}

    def __del__(self) -> None:
        for reader in self.__dict__.get("_file") or ():
            with suppress(Exception):  # it may be closed, or half open
                reader.close()

    def _open(self) -> Any:
        from bz2 import BZ2Decompressor

        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
        from rosbags.rosbag1 import reader as ros1
        from rosbags.rosbag2 import reader as ros2
        from rosbags.rosbag2 import storage_mcap as mcap
        from rosbags.rosbag2 import storage_sqlite3 as sqlite

        zstd = mcap.zstd.ZstdDecompressor
        ros1.decompressors["bz2"] = lambda data: _unpack(BZ2Decompressor(), data)
        ros1.decompressors["lz4"] = lambda data: _unpack(LZ4FrameDecompressor(), data)
        mcap.DECOMPRESSORS["lz4"] = lambda data, _: _unpack_records(LZ4FrameDecompressor(), data)
        mcap.DECOMPRESSORS["zstd"] = lambda data, _: _unpack_records(zstd(), data)
        ros2.zstd = SimpleNamespace(
            decompress=lambda data: _unpack(zstd(), data), open=_open_packed
        )
        # Settings of the transport, in YAML, which is slow to read; glsim needs none of them.
        ros2.parse_qos = sqlite.parse_qos = mcap.get_qos = lambda _: []
        ros2.Path = _Path

        class Database(sqlite.Sqlite3Reader):  # type: ignore[misc]
            def open(self) -> None:
                _check_database(_Path(self.path))
                super().open()

        ros2.Reader.STORAGE_PLUGINS = ros2.Reader.STORAGE_PLUGINS | {".db3": Database}
        folders = ros2.DirectoryReader
        folders.STORAGE_PLUGINS = folders.STORAGE_PLUGINS | {"sqlite3": Database}
        if self._file is None:
            readers = []
            for path in map(_Path, self._parts):
                if not path.is_dir():
                    path.check()  # a pipe would wait for ever
                readers.append((ros1 if self._is_ros1 else ros2).Reader(path))
                readers[-1].open()
            while _Path.opened:
                _Path.opened.pop().left = sys.maxsize
            self._file = readers
        return self._file

    def _read(self, data: bytes, kind: str) -> Any:
        """Decode a message by ROS' own definition: a bag's own may have fields without end."""
        types = _types(self._is_ros1)
        return (types.deserialize_ros1 if self._is_ros1 else types.deserialize_cdr)(data, kind)

    def _messages(self, topic: str, start: int | None = None) -> Iterator[Any]:
        """Yield connection, time (from ``start``, ns) and data of a topic's messages, by time."""
        parts = [
            reader.messages(own, start=start)
            for reader in self._open()
            if (own := [c for c in reader.connections if c.topic == topic])
        ]
        return merge(*parts, key=itemgetter(1))

    def _first(self, topic: str) -> Any:
        """Return the first message of a topic, None without one."""
        for connection, _, data in self._messages(topic):
            return self._read(data, connection.msgtype)
        return None

    def _find_times(self, tracks: Sequence[str]) -> dict[str, NDArray[np.int64]]:
        """Return the times of each topic's messages, ns; a ROS 1 bag lists them in its index."""
        found: dict[str, list[int]] = {topic: [] for topic in tracks}
        for topic, times in found.items():
            if self._is_ros1:
                for reader in self._open():
                    own = [c.id for c in reader.connections if c.topic == topic]
                    times += [entry.time for number in own for entry in reader.indexes[number]]
            else:
                times += [time for _, time, _ in self._messages(topic)]
        return {topic: np.array(sorted(times), np.int64) for topic, times in found.items()}

    def _image(self, topic: str, number: int) -> NDArray[np.generic]:
        """Read an image; reading continues at the topic's last image if possible."""
        times = self._times[topic]
        place, messages = self._cursors.get(topic, (-1, iter(())))
        if place != number:
            place = int(np.searchsorted(times, times[number]))  # first of equal times
            messages = self._messages(topic, int(times[number]))
        while place < number:
            next(messages)
            place += 1
        connection, _, data = next(messages)
        self._cursors[topic] = (number + 1, messages)
        return read_pixels(self._read(data, connection.msgtype), f"{self.path}: {topic}")

    def _read_camera(self) -> tuple[StatedCamera, tuple[str, ...]]:
        camera, lens, remarks = self._find_camera()
        base = self._depth.partition("/image")[0]
        device = self._depth.partition("/sensor_")[0]
        sensor = f"{base.rpartition('/')[0]}/option"
        unit, baseline = (self._number(f"{sensor}/{n}") for n in ("Depth_Units", "Stereo_Baseline"))
        facts = (self._read(data, c.msgtype) for c, _, data in self._messages(f"{device}/info"))
        stated = StatedCamera(
            camera,
            lens,
            None if unit is None else round(MM_PER_M * unit, 6),
            None if baseline is None else round(abs(baseline) / MM_PER_M, 7),
            next((str(fact.value) for fact in facts if getattr(fact, "key", "") == "Name"), ""),
        )
        return stated, tuple(remarks)

    def _find_camera(self) -> tuple[Intrinsics | None, tuple[float, ...], list[str]]:
        """Return intrinsics and lens of the nearest usable camera_info, and remarks."""
        topic, shape = self._depth, self._shape(self._depth)
        frame = str(self._first(topic).header.frame_id)
        images, infos = self._names(*_IMAGES), self._names(_INFO)
        resampled, target = _RESAMPLED.search(topic.lower()), re.search(r"_to_([^/]+)", topic)
        ranked = []
        for name in sorted(infos):
            info = self._first(name)
            if info is None:
                continue
            shared, same = _shared(name, topic), frame == str(info.header.frame_id) != ""
            parts = _parts(name)[shared:]
            folders = [part for part in parts[:-1] if part != "info"]
            foreign = any(
                _role(part) in ("other", "infrared") or _RESAMPLED.search(part) for part in parts
            )
            nearest = shared == max(_shared(name, other) for other in images)
            only = not folders or (len(infos) == len(images) == 1)
            of_depth = shared and nearest and (same or "depth" in "/".join(folders))
            aligned = resampled and (same or (target and target[1].lower() in folders))
            if aligned or (not foreign and (only or (of_depth and not resampled))):
                alike = (info.height, info.width) == shape
                ranked.append(((shared, alike, same, _role(name) == "depth"), name, info))
        remarks: list[str] = []
        for _, name, info in sorted(ranked, key=lambda entry: entry[0], reverse=True):
            camera, lens, remark = _camera(info, shape, topic)
            remarks += [f"{name} {remark}"] if remark else []
            if camera is not None:
                return camera, lens, remarks
        if infos and not ranked:
            remarks = [f"{', '.join(sorted(infos))}: none is of {topic}"]
        return None, (), remarks

    def _number(self, option: str) -> float | None:
        """Return the value of a recorded librealsense option; None if it is missing or 0."""
        for name in (option, option.replace("_", " ")):
            if (message := self._first(f"{name}/value")) is not None:
                return float(message.data) or None
        return None


def _plain(topic: str) -> str:
    """Return a topic's name without the suffix of its image transport."""
    return re.sub(r"/compressed(depth)?$", "", topic.lower())


def _role(topic: str) -> str:
    """Return the kind of images by a topic's name: "other", "infrared", "depth" or ""."""
    for part in reversed(re.sub(r"_to_[^/]*", "", _plain(topic)).split("/")):
        for role, words in _ROLES.items():
            if words.search(part):
                return role
    return ""


def _rank(topic: str) -> tuple[object, ...]:
    """Return a sort key of depth topics: native, uncompressed, unrectified images first."""
    last = _plain(topic).rpartition("/")[2]
    resampled = len(_RESAMPLED.findall(topic.lower()))
    return resampled, _plain(topic) != topic.lower(), "rect" in last, "raw" not in last, topic


def _parts(topic: str) -> list[str]:
    return _plain(topic).strip("/").split("/")


def _shared(topic: str, other: str) -> int:
    """Count the equal leading parts of two topics' names."""
    pairs = zip(_parts(topic), _parts(other), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def _camera(
    info: Any, shape: tuple[int, ...], topic: str
) -> tuple[Intrinsics | None, tuple[float, ...], str]:
    """Return intrinsics and lens of (H, W) images from a camera_info, and a remark or "".

    Rectified images have the projection P and no lens, other images K and D. Sizes, offsets and
    binning refer to the whole image. In ROS, the centre of the first pixel is at 0.
    """
    k, d, p = (np.asarray(getattr(info, n, getattr(info, n.upper(), ())), float) for n in "kdp")
    last = _plain(topic).rpartition("/")[2]
    rectified = "rect" in last or ("registered" in topic.lower() and "raw" not in last)
    matrix = p if rectified and p.size == 12 and min(p[0], p[5]) >= 1 else k
    if matrix.size not in (9, 12) or not np.isfinite(matrix).all():
        return None, (), "has no usable matrix"
    (fx, _, cx), (_, fy, cy) = matrix.reshape(3, -1)[:2, :3].tolist()
    whole, roi, (rows, columns) = (int(info.width), int(info.height)), info.roi, shape
    if min(fx, fy) < 1 or min(whole) < 1:
        return None, (), "has no focal lengths or no size"
    left, top, size = 0, 0, whole
    if min(roi.width, roi.height) > 0 and whole != (columns, rows):
        left, top, size = roi.x_offset, roi.y_offset, (int(roi.width), int(roi.height))
    x, y = columns / size[0], rows / size[1]
    bins = max(1, info.binning_x), max(1, info.binning_y)
    if (size[0] // bins[0], size[1] // bins[1]) == (columns, rows):
        x, y = 1 / bins[0], 1 / bins[1]
    elif abs(x / y - 1) > _UNEQUAL:
        return None, (), f"is of {size[0]}x{size[1]}, the images are {columns}x{rows}"
    remark = f"of {size[0]}x{size[1]} is scaled to {columns}x{rows}" if (x, y) != (1, 1) else ""
    image = Intrinsics(columns, rows, fx * x, fy * y, (cx + 0.5 - left) * x, (cy + 0.5 - top) * y)
    if rectified or not d.any():
        return image, (), remark
    model = str(info.distortion_model).lower().replace("_", " ")
    if model not in _LENSES or not np.isfinite(d).all() or d[8:].any():
        return image, (), f"{remark} has the lens {model!r}, which is not read".strip()
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return image, opencv_order(Distortion(**dict(zip(names, d.tolist(), strict=False)))), remark
