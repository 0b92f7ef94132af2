"""Opening of depth maps on disk: which files are depth maps, their unit, and their camera.

- data sets of glsim: the noisy or clean layer, and infrared.
- folders, files and patterns: 16-bit PNG and TIFF, OpenEXR, ``.npy`` maps and stacks (T, H, W),
  dumps of libfreenect2, Biwi's ``frame_*_depth.bin`` beside ``depth.cal``. Infrared lies beside
  them (``_ir``, ``_infrared``), or in a folder ``ir`` or ``infrared`` beside the folder ``depth``.
- ROS bags of librealsense or ROS nodes, Matroska files of an Azure Kinect.

A ``camera.toml`` beside the frames (``recordings.camera_file``) describes the camera and overrides
what the files state. Options of commands override both; a contradicting unit is refused.
"""

from __future__ import annotations

import glob
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import DEFAULT_INTRINSICS, Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames, Layer
from glsim.core.depth_protocol import DepthProtocol, stored_protocol
from glsim.core.errors import ConfigError, DatasetError, NoDepthError
from glsim.core.files.atomic import read_json
from glsim.core.files.listing import MOST_FILES, natural
from glsim.core.files.png import SENSOR_KEYWORD, stated_text
from glsim.data.disk_format import FORMAT, HEADER
from glsim.data.header import is_dataset, read_header, simulated_by
from glsim.data.map_files import STACKS, open_stack
from glsim.data.recording import FrameReader, Recording, check_least_size
from glsim.data.recordings.camera_file import StatedCamera, check_size
from glsim.data.recordings.files import FramePlace, MapFiles, agreed_unit_mm
from glsim.data.recordings.folders import (
    json_camera,
    kind_of,
    list_maps,
    stated_camera,
    unread_cameras,
    whole_recording,
)
from glsim.data.recordings.names import DepthKind, infrared_files, note_of_others, other_kind
from glsim.data.recordings.streams import STREAMS, FrameStream, parts_of

#: Suffix of a packed file -> advice how to unpack it.
_PACKED = {
    ".r3d": "its depth is compressed by LZFSE: export EXR + RGB from Record3D",
    ".zip": "unpack it, and give its folder of depth maps (of Polycam: keyframes)",
    ".zstd": "unpack it: zstd -d",
}


@dataclass(frozen=True)
class _Loader:
    """Reads the frames of files; maps without a stated camera have the intrinsics ``assumed``."""

    reader: FrameReader
    kind: DepthKind
    mirror: bool
    cameras: Mapping[Path, StatedCamera]
    records: Mapping[Path, DepthFrame] = field(default_factory=dict)
    assumed: Intrinsics = DEFAULT_INTRINSICS
    needs_camera: bool = True

    @property
    def frames(self) -> Frames:
        """All frames of the recording; a frame is read when it is asked for."""
        return Frames(len(self.reader), self, self.key)

    def key(self, number: int) -> FrameKey:
        """Return the key of a frame; the maps of one folder or bag are one sequence."""
        return FrameKey(str(self.reader.files(number)[0].parent), "", number)

    def __call__(self, number: int) -> DepthFrame:
        depth_mm, step_mm = self.reader.depth(number)
        (file, _), name = self.reader.files(number), self.reader.name(number)
        stated, stored = self.cameras[file.parent], self.records.get(file.absolute())
        camera, shape = stated.intrinsics, (depth_mm.shape[0], depth_mm.shape[1])
        if self.needs_camera or stated.along_ray:
            check_size(stated, shape, f"{file}: {name}")
        if stored is not None:
            camera = stored.intrinsics
        elif camera is None or (camera.height, camera.width) != shape:
            camera = self.assumed.for_map(shape)
        depth_mm = self._turned(depth_mm)
        if stated.along_ray:
            depth_mm /= np.sqrt(1 + (camera.rays() ** 2).sum(axis=-1))
        layers: dict[str, Layer] = {f"{self.kind}_mm": depth_mm}
        if self.reader.has_infrared_of(number):
            layers["infrared"] = partial(self._infrared, number)
        record: dict[str, Any] = {"file": str(file)}
        if stored is not None:
            record |= {name: stored.record[name] for name in ("depth_offset_mm", "intrinsics")}
        return DepthFrame(
            self.key(number), camera, layers, step_mm=step_mm, name=name, record=record
        )

    def _infrared(self, number: int) -> NDArray[np.float32]:
        counts = self.reader.infrared(number)
        assert counts is not None, "the layer is there where the reader has the image"
        return self._turned(counts)

    def _turned(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        return image[:, ::-1].copy() if self.mirror else image


def open_maps(
    inputs: Path | str | Sequence[Path | str],
    kind: DepthKind = "noisy",
    *,
    unit_mm: float | None = None,
    channel: str | None = None,
    infrared: Path | None = None,
    mirror: bool = False,
    topic: str | None = None,
    crops: bool = False,
    below: bool = True,
    needs_camera: bool = True,
    along_rays: bool = False,
) -> Recording:
    """Find depth maps on disk; decide their unit and camera from at most 16 sampled maps.

    Args:
        inputs: a data set of glsim, a bag or Matroska file, or folders, files and patterns.
        unit_mm: step of integers, mm. Default: the step that files or data sets state, else 1.
        channel: channel of OpenEXR files. Default: from camera.toml, else the channel named depth.
        infrared: infrared image, or folder of such images. Default: images beside the depth files.
        mirror: whether to flip left and right; images of libfreenect2 are mirrored.
        topic: topic of the depth images in a bag. Default: native images named depth.
        needs_camera: whether maps must have the size of the stated camera.
        along_rays: whether depths are distances along the pixels' rays, as camera.toml may state.
        crops: whether files of a data set get the intrinsics of their (cropped) frame there.

    Raises:
        ConfigError: an input does not exist or has no depth maps (NoDepthError); the topic, the
            step or a camera.toml is wrong.
        DatasetError: a file is damaged, or its numbers cannot be depth.
    """
    texts = [inputs] if isinstance(inputs, Path | str) else list(inputs)
    given = [Path(text) for text in texts]
    for path in given:
        if path.is_file() and (packed := _PACKED.get(path.suffix.lower())):
            raise DatasetError(f"{path}: {packed}")
    if len(given) == 1 and is_dataset(texts[0]):
        return _data_set(texts[0], kind)
    existing = [path for path in given if path.exists()]
    whole = whole_recording(existing)
    if topic is not None and (whole is None or STREAMS.get(whole.suffix.lower()) == "mkv"):
        raise ConfigError(f"--topic {topic}: {given[0]} is no bag")
    if whole:
        return _stream_recording(whole, kind, unit_mm, mirror, infrared, topic)
    maps = _FileList(kind, below)
    for text in texts:
        maps.add(text)
    maps.find_cameras(given, crops)
    reader = maps.reader(unit_mm, channel, infrared)
    cameras = maps.checked_cameras(reader.votes.maps_mm[0].shape, needs_camera, along_rays, mirror)
    stated, notes = cameras[maps.files[0].parent], maps.notes + reader.notes
    loader = _Loader(reader, kind, mirror, cameras, maps.records, needs_camera=needs_camera)
    if others := reader.layers - {"", kind}:
        notes += (f"states the layer {' and '.join(sorted(others))}, taken for {kind}",)
    if reader.ray_channel and not stated.along_ray:
        notes += (
            f"channel {reader.ray_channel} is the distance along the ray: along_ray = true in a "
            "camera.toml, or --along-ray, converts it",
        )
    if stated.intrinsics is None and (unread := unread_cameras(maps.files[0].parent)):
        names = ", ".join(file.name for file in unread)
        notes += (f"{names}: not read; a camera.toml states the camera",)
    recording = Recording(
        given[0], kind_of(maps.files[0]), loader.frames, reader, stated, maps.stated_by, notes,
        maps.left_out, tuple(maps.outputs), maps.protocol, layer=f"{kind}_mm",
        is_one_camera=len({*cameras.values()}) == 1, simulated_by=maps.simulated_by,
    )  # fmt: skip
    return recording if maps.records else _with_camera(recording, loader)


def _with_camera(recording: Recording, loader: _Loader) -> Recording:
    """Assume the intrinsics of the recognised camera if none are stated."""
    if recording.camera is not None:
        return recording
    seen = recording.recognised
    taken, assumed = seen.intrinsics(recording.votes.maps_mm[0].shape)
    frames = replace(loader, assumed=assumed).frames
    return replace(recording, frames=frames, assumed=taken, assumed_camera=assumed, seen=seen)


class _FileList:
    """The files of depth maps of several inputs, in natural order, with their stated cameras.

    Attributes:
        left_out: file-name pattern of images that are not read -> number of images.
        outputs: relative path of each changed map when it is written; set by ``reader``.
        cameras: folder -> stated camera and unit.
        records: absolute path of a data set's file -> its frame there, if the frame is needed.
    """

    def __init__(self, kind: DepthKind, below: bool) -> None:
        self._kind, self._below = kind, below
        self._named: list[tuple[Path, Path]] = []
        self._roots: dict[Path, Path | None] = {}
        self.left_out = Counter[str]()
        self._searched: Path | None = None
        self.outputs: list[Path] = []
        self.cameras: dict[Path, StatedCamera] = {}
        self.stated_by: Path | None = None
        self.simulated_by = ""
        self.notes: tuple[str, ...] = ()
        self.records: Mapping[Path, DepthFrame] = {}
        self.protocol: DepthProtocol = "depth"

    @property
    def files(self) -> list[Path]:
        return [file for file, _ in self._named]

    def add(self, text: Path | str) -> None:
        """Add the files of one input. Raises NoDepthError if it has none."""
        path = Path(text)
        if path.is_dir():
            files, others = list_maps(path, self._kind, self._below)
            self.left_out, self._searched = self.left_out + others, path
            named = [(file, file.relative_to(path)) for file in files]
        else:  # iglob leaves out hidden files, pathlib does not
            names = [text] if path.is_file() else glob.iglob(str(text), recursive=True)  # noqa: PTH207
            named = [(file, Path(file.name)) for file in map(Path, names) if file.is_file()]
            if not named:
                raise NoDepthError(f"{text}: no such file or folder")
            others = Counter(filter(None, (other_kind(f.name, self._kind) for f, _ in named)))
            if others:
                self.notes += (note_of_others(others, text),)
        self._named += named

    def find_cameras(self, given: Sequence[Path], crops: bool) -> None:
        """Find the stated camera of each folder, in its data set or in files beside the maps.

        ``given``: inputs; a folder may have such files above the folders of its maps.
        """
        self._named.sort(key=lambda pair: natural(pair[0]))
        nearest_mm: list[float | None] = []
        for folder in dict.fromkeys(file.parent for file in self.files):
            root = self._roots[folder] = data_set_of(folder)
            by: Path | None = root
            if root is None:
                above = [path for path in given if path in folder.parents]
                stated, by = stated_camera(*above, folder)
                file = next(file for file in self.files if file.parent == folder)
                self.simulated_by = stated_text(file, SENSOR_KEYWORD)
                if not stated.sensor and self.simulated_by:
                    stated, by = replace(stated, sensor=self.simulated_by), by or file
                self.cameras[folder] = stated
            else:
                header = read_header(root)
                nearest_mm.append(header["settings"]["output"].get("nearest_to_mm"))
                self.simulated_by = simulated_by(header)
                unit_mm = float(header["depth_unit_mm"])
                self.cameras[folder] = StatedCamera(unit_mm=unit_mm, sensor=self.simulated_by)
            if len(self.cameras) == 1:
                self.stated_by = by
        self.protocol = stored_protocol(next(filter(None, nearest_mm), None))
        if crops or any(nearest_mm):
            self.records = self._records({*filter(None, self._roots.values())})

    def checked_cameras(
        self, shape: tuple[int, ...], needed: bool, along_rays: bool, mirror: bool
    ) -> dict[Path, StatedCamera]:
        """Return the camera of each folder for maps of a shape (H, W).

        Raises ConfigError: distances along rays need intrinsics; DatasetError: a needed camera has
        another size than the maps.
        """
        cameras = {}
        for folder, stated in self.cameras.items():
            camera = replace(stated, along_ray=stated.along_ray or along_rays)
            if stated.intrinsics is None and (beside := json_camera(folder, shape)):
                camera, self.stated_by = replace(camera, intrinsics=beside[0]), beside[1]
            own = camera.intrinsics
            if camera.along_ray and own is None:
                raise ConfigError(
                    f"{folder}: distances along rays need intrinsics: state width, height and "
                    "focal_px in a camera.toml"
                )
            if needed or camera.along_ray:
                check_size(camera, shape, self.stated_by or self.files[0])
            elif own is not None and (own.height, own.width) != shape:
                camera = replace(camera, intrinsics=None)
                self.notes += (
                    f"{self.stated_by} says {own.width}x{own.height}, but the maps are "
                    f"{shape[1]}x{shape[0]}: its focal_px and centre_px are not used",
                )
            cameras[folder] = _mirrored(camera, mirror)
        return cameras

    def _records(self, roots: set[Path]) -> dict[Path, DepthFrame]:
        from glsim.data.reader import open_dataset

        wanted = {file.absolute() for file in self.files}
        return {
            path: frame
            for root in roots
            for frame in open_dataset(root)
            for file in frame.record["files"].values()
            if (path := root / file["name"]) in wanted
        }

    def reader(self, unit_mm: float | None, channel: str | None, infrared: Path | None) -> MapFiles:
        """Open the files. Raises the errors of ``MapFiles``; ConfigError if stated steps differ."""
        files = self.files
        lights = infrared_files(files, infrared) if infrared else [None] * len(files)
        places: list[FramePlace] = []
        for (file, output), light in zip(self._named, lights, strict=True):
            stored = self.records.get(file.absolute())
            offset_mm = 0.0 if stored is None else float(stored.record["depth_offset_mm"])
            count, root = _count_maps(file), self._roots[file.parent]
            for number in range(count):
                end = f"_{number:05d}" if count > 1 else ""
                name = f"{output.with_suffix('').as_posix()}{end}"
                place = number if count > 1 else None
                places.append(FramePlace(name, file, place, root, light, offset_mm))
                self.outputs.append(output.with_name(f"{output.stem}{end}{output.suffix}"))
            if len(places) > MOST_FILES:
                raise ConfigError(f"{file}: the recording has more than {MOST_FILES} frames")
        stated_mm = _one_step({camera.unit_mm for camera in self.cameras.values()})
        agreed_unit_mm(unit_mm, stated_mm, self.stated_by or files[0])
        channel = channel or self.cameras[files[0].parent].channel
        return MapFiles(places, unit_mm, stated_mm, channel, self._searched)


def _data_set(place: Path | str, kind: DepthKind) -> Recording:
    from glsim.data.reader import open_dataset

    dataset = open_dataset(place)
    if len(dataset) == 0:
        raise DatasetError(f"{place}: has no frames")
    dataset.require(kind)
    frames = dataset.frames()
    sensor = simulated_by(dataset.header)
    stated = StatedCamera(frames.intrinsics, unit_mm=dataset.depth_unit_mm, sensor=sensor)
    outputs = tuple(Path(f"{frame.name}_{kind}.png") for frame in frames)
    return Recording(
        dataset.path, "data set", frames, None, stated, dataset.path, outputs=outputs,
        protocol=dataset.protocol, layer=f"{kind}_mm",
        is_one_camera=dataset.header["settings"]["output"].get("crop") is None,
        simulated_by=sensor,
    )  # fmt: skip


def _count_maps(file: Path) -> int:
    with suppress(DatasetError):  # reading the file reports it later
        return len(open_stack(file)) if file.suffix.lower() in STACKS else 1
    return 1


def data_set_of(folder: Path) -> Path | None:
    """Return the data set of an image folder <split>/<subject>/; None for other folders."""
    split = folder.absolute().parent
    file = split.parent / HEADER
    if not file.is_file():
        return None
    try:
        header = read_json(file)
        ours = header.get("format") == FORMAT and split.name in header["frames"]
    except (DatasetError, LookupError, TypeError):  # a file of that name may have another origin
        return None
    return split.parent if ours else None


def _one_step(units_mm: set[float | None]) -> float | None:
    """Return the step that folders state. Raises ConfigError for two different steps."""
    if units_mm == {None}:
        return None
    steps = {unit_mm or 1.0 for unit_mm in units_mm}
    if len(steps) > 1:
        raise ConfigError(
            "the maps are of different steps, of data sets or as their folders state: take those "
            "of one step at a time"
        )
    return steps.pop()


def _stream_recording(
    path: Path, kind: DepthKind, unit_mm: float | None, mirror: bool, infrared: Path | None,
    topic: str | None,
) -> Recording:  # fmt: skip
    if infrared is not None:
        raise ConfigError(f"--infrared {infrared}: {path} holds the infrared images itself")
    stream = _open_stream(path, topic)
    if len(stream) > MOST_FILES:
        raise DatasetError(f"{path}: the recording has more than {MOST_FILES} frames")
    given, file = stated_camera(path.parent, path if path.is_dir() else path.parent)
    stated = given.over(stream.stated)
    stream.step_mm = agreed_unit_mm(unit_mm, stated.unit_mm, path) or 1.0
    notes = stream.notes + (stream.camera_notes if given.intrinsics is None else ())
    if path.is_dir() and (parts := parts_of(path)):
        notes += (f"its {len(parts)} files are read as the parts of one recording",)
    elif path in (parts := parts_of(path.parent)):
        notes += (f"is one of {len(parts)} parts: give the folder {path.parent} to read all",)
    depth_mm, _ = stream.depth(0)  # a stream without depth is refused here
    check_size(stated, depth_mm.shape, file or path)
    check_least_size(depth_mm.shape, path)
    turned = _mirrored(stated, mirror)
    loader = _Loader(stream, kind, mirror, {path.parent: turned})
    outputs = tuple(Path(f"{stream.name(number)}.png") for number in range(len(stream)))
    recording = Recording(
        path, stream.kind, loader.frames, stream, turned, file or path, notes, outputs=outputs,
        layer=f"{kind}_mm",
    )  # fmt: skip
    return _with_camera(recording, loader)


def _open_stream(path: Path, topic: str | None) -> FrameStream:
    if STREAMS.get(path.suffix.lower(), "bag") == "bag":
        from glsim.data.recordings.bag import BagStream

        return BagStream(path, topic)
    from glsim.data.recordings.mkv import MkvStream

    return MkvStream(path)


def _mirrored(stated: StatedCamera, mirror: bool) -> StatedCamera:
    """Flip left and right; of OpenCV's lens, p2, s1, s2 and the tilt tau_y change sign."""
    own = stated.intrinsics
    if own is None or not mirror:
        return stated
    lens = tuple(-k if n in (3, 8, 9, 13) else k for n, k in enumerate(stated.distortion))
    return replace(stated, intrinsics=replace(own, cx=own.width - own.cx), distortion=lens)
