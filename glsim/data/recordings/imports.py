"""Import recordings as data sets: real noisy depth, and the clean maps of Biwi's templates."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.errors import ConfigError, DatasetError, MeshError, counted
from glsim.core.files.contents import content_hash
from glsim.core.files.listing import entries
from glsim.core.pose import pose_matrix
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.core.units import from_steps, to_metres
from glsim.data.dataset_run import write_dataset
from glsim.data.input_hashes import source_hashes
from glsim.data.maps import open_maps
from glsim.data.progress import FrameProgress, GenerateSummary
from glsim.data.recording import FrameReader, Recording
from glsim.data.recordings.biwi import read_calibration, read_depth_bin
from glsim.data.recordings.streams import STREAMS, is_stream
from glsim.data.run_identity import InputHashes
from glsim.data.worker_processes import Workers
from glsim.faces.face_source import BadFace, Face, FaceKey, FaceSource
from glsim.faces.sources.biwi import Biwi
from glsim.gl.context import describe, open_context
from glsim.gl.targets import Readback
from glsim.render.renderer import Renderer
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.assembly import reconcile_reasons
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.plan.tasks import Task, make_tasks

#: Sensor title in a data set of Biwi's recordings.
_BIWI_TITLE = "Biwi: a real Kinect V1; clean is the person's template, posed"
_RECORDING_TITLE = "a real depth camera; there are no clean maps"
#: Step of depth files that are written for recordings of floats, mm. Chosen: it is a quarter of a
#: Kinect's noise floor, and 16 bits reach 16 m.
FLOAT_UNIT_MM = 0.25
#: Shares of train, val and test: real frames are for testing.
DEFAULT_SPLIT = "0,0,1"


def import_biwi(
    root: Path,
    out: Path,
    *,
    every: int = 1,
    subjects: int | None = None,
    frames_per_subject: int | None = None,
    split: str | None = None,
    workers: Workers = "auto",
    backend: str | None = None,
    progress: Callable[[FrameProgress], None] | None = None,
) -> GenerateSummary:
    """Write the recordings of Biwi as a data set of glsim.

    The noisy map is the Kinect's whole depth.bin; the clean map shows only the head. The notes of a
    record have the colour camera and the head pose.

    ``root``: folder with NN.obj and NN/frame_*_depth.bin.

    Raises ConfigError for a root without recordings, DatasetError by ``write_dataset``.
    """
    options = {"kind": "biwi", "root": root, "every": every}
    options |= {"subjects": subjects, "frames_per_subject": frames_per_subject}
    tree = {"source": {name: value for name, value in options.items() if value is not None}}
    settings = load_settings(overrides=tree | ({"split": split} if split else {}))
    source = Biwi(root, every=every)
    source.repeats = False  # frames are measured, so none may be repeated
    context = open_context(backend)
    renderer = describe(context)["renderer"]
    context.release()
    return write_dataset(
        settings, make_tasks(settings, [source]), out,
        partial(_biwi_frames, source=source, backend=backend),
        sensor={"name": "biwi", "title": _BIWI_TITLE, "width": 640, "height": 480, "stages": []},
        renderer=renderer, workers=workers, progress=progress,
    )  # fmt: skip


def _biwi_frames(
    settings: Settings, tasks: Iterable[Task], *, source: Biwi, backend: str | None
) -> Iterator[Frame | Skipped]:
    """Yield one result per task, in order."""
    context = open_context(backend)
    cameras: dict[Intrinsics, tuple[Renderer, Readback]] = {}
    try:
        for task in tasks:
            try:
                image = read_calibration(source.root / task.key.sequence / "depth.cal")
                if image not in cameras:
                    cameras.clear()
                    cameras[image] = Renderer(context, SensorRig(image)), Readback(context)
                yield _biwi_frame(settings, task, source, image, *cameras[image])
            except (DatasetError, MeshError) as error:
                yield Skipped(task.key, source.name, str(error))
    finally:
        context.release()


def _biwi_frame(
    settings: Settings, task: Task, source: Biwi, image: Intrinsics, renderer: Renderer,
    readback: Readback,
) -> Frame:  # fmt: skip
    path = source.depth_path(task.key)
    noisy_m = to_metres(from_steps(read_depth_bin(path)))
    if noisy_m.shape != (image.height, image.width):
        raise DatasetError(
            f"{path}: {noisy_m.shape[1]} x {noisy_m.shape[0]} pixels, its depth.cal says "
            f"{image.width} x {image.height}"
        )
    clean_m = np.zeros_like(noisy_m)
    with renderer.render([(source.in_camera(task.key), pose_matrix({}))]) as rendered:
        readback.request(rendered.pool, {"clean": rendered.layers["clean"]}, rendered.window)
        clean_m[rendered.window.slices] = readback.arrays()["clean"]
    try:
        rgb = read_calibration(path.with_name("rgb.cal"))
        colour: object = {"focal_px": [rgb.fx, rgb.fy], "centre_px": [rgb.cx, rgb.cy]}
    except DatasetError as error:
        colour = str(error)
    pose = source.pose(task.key)
    dark = np.zeros_like(clean_m)
    reason = reconcile_reasons(clean_m, noisy_m, dark).astype(np.uint8)
    notes = {
        "real": "depth.bin of a Kinect V1, unchanged",
        "clean": "the person's template, posed",
        "head_rotation": [[round(float(v), 6) for v in row] for row in pose.rotation],
        "depth_file": path.relative_to(source.root).as_posix(),
        "colour_camera": colour,
    }
    at = dict(zip(("x_mm", "y_mm", "distance_mm"), map(float, pose.centre_mm), strict=True))
    images = clean_m, noisy_m, dark, reason
    return _frame(settings, task, source, image, *images, notes=notes, pose=at)


def _frame(
    settings: Settings, task: Task, source: FaceSource, image: Intrinsics, *maps: Any, **facts: Any
) -> Frame:
    """Return an uncropped frame with clean and noisy depth, m, infrared and reasons."""
    window = Rect(0, 0, image.width, image.height)
    unit = settings.output.depth_unit_mm
    head = task.key, source.name, task.seeds.frame, image, window
    return Frame(*head, *maps, **facts | {"depth_unit_mm": unit})


class RecordingSource(FaceSource):
    """The recordings in a folder and its sub-folders as a face source; each is a subject.

    Raises ConfigError for a folder that does not exist, DatasetError if it holds no frames.
    """

    name = "kinect2"

    def __init__(
        self, root: Path, unit_mm: float | None = None, mirror: bool = False, every: int = 1,
        topic: str | None = None,
    ):  # fmt: skip
        self.root, self.folder = root, root.parent if root.is_file() else root
        read = partial(open_maps, unit_mm=unit_mm, mirror=mirror, topic=topic, below=False)
        left_out: list[str] = []
        try:
            self.recordings = {_word(root.resolve().name): read(root)}
        except DatasetError:
            if not root.is_dir():
                raise
            streams, folders = entries(root, (*STREAMS,))
            parts = [root / name for name in sorted([*streams, *folders])]
            found: list[tuple[str, Recording]] = []
            for path in parts:
                try:
                    found.append((_word(path.name), read(path)))
                except DatasetError as error:
                    left_out += [f"left out: {error}"] if is_stream(path) else []
            if not found:
                raise
            self.recordings = dict(found)
            if len(self.recordings) < len(found):
                raise DatasetError(
                    f"{root}: two folders have the same name without spaces: rename one"
                ) from None
        if any(recording.kind == "data set" for recording in self.recordings.values()):
            raise DatasetError(f"{root}: is a data set of glsim already")
        self._every, self._facts = every, {"mirror": str(mirror), "topic": str(topic)}
        remarks = filter(None, (r.sentence(real=True) for r in self.recordings.values()))
        #: Lines for the user about choices, assumptions and files left out.
        self.notes = (*left_out, *remarks)

    def subjects(self, count: int | None) -> list[str]:
        """Return the names of the recordings."""
        names = list(self.recordings)
        if count is not None and count > len(names):
            raise ConfigError(f"{self.root}: has {counted(len(names), 'recording')}, not {count}")
        return names[:count]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return the keys of a recording's frames, numbered from 0 in the order of the names."""
        reader = self.reader(subject)
        paths = {
            number: reader.files(number)[0].relative_to(self.folder).as_posix()
            for number in range(0, len(reader), self._every)[:count]
        }
        return [FaceKey(subject, "main", number, path=path) for number, path in paths.items()]

    def reader(self, subject: str) -> FrameReader:
        """Return the reader of a recording's files."""
        reader = self.recordings[subject].reader
        assert reader is not None, "a data set is refused"
        return reader

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Raise: recordings hold images, not faces."""
        raise ConfigError(f"{self.root}: recordings have no meshes: use glsim import kinect2")

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Hash the files and settings that decide the frames of recordings: name -> hash."""
        hashes = dict(self._facts)
        for subject in subjects:
            stated_by = self.recordings[subject].stated_by
            paths = [] if stated_by is None else [stated_by]
            reader = self.reader(subject)
            for number in range(0, len(reader), self._every):
                paths += [path for path in reader.files(number) if path is not None]
            folders = [path for path in dict.fromkeys(paths) if path.is_dir()]  # of bags
            paths += [file for folder in folders for file in sorted(folder.iterdir())]
            hashes |= {os.path.relpath(path, self.folder): content_hash(path) for path in paths}
        return hashes

    @property
    def step_mm(self) -> float:
        """Step of written depth files, mm; integers stay exact, floats are rounded to 0.25 mm."""
        return min(r.frames[0].step_mm or FLOAT_UNIT_MM for r in self.recordings.values())


def import_recordings(
    root: Path,
    out: Path,
    *,
    depth_unit_mm: float | None = None,
    mirror: bool = False,
    every: int = 1,
    split: str | None = None,
    topic: str | None = None,
    workers: Workers = "auto",
    progress: Callable[[FrameProgress], None] | None = None,
) -> GenerateSummary:
    """Write the recordings in ``root``, or in its sub-folders, as a data set of glsim.

    Its layers are noisy and, if each frame has it, infrared. Unreadable frames are skipped with the
    reason. Without a stated camera, a Kinect V2 is assumed; ``summary.notes`` and
    "intrinsics_assumed" of each record tell it.

    Args:
        root: a folder that ``open_maps`` reads, or a folder of such folders.
        depth_unit_mm, mirror, topic: see ``open_maps``.
        split: shares of train, val and test. Default: only test.

    Raises ConfigError without such a folder, DatasetError without frames or by ``write_dataset``.
    """
    source = RecordingSource(root, depth_unit_mm, mirror, every, topic)
    frames = [(r, n) for r in map(source.reader, source.recordings) for n in range(len(r))]
    dark = [reader.name(number) for reader, number in frames if reader.files(number)[1] is None]
    layers = ("noisy",) if dark else ("noisy", "infrared")
    tree: dict[str, Any] = {
        "source": {"kind": "kinect2", "root": root, "every": every},
        "output": {"layers": layers, "depth_unit_mm": source.step_mm},
        "split": split or DEFAULT_SPLIT,
    }
    settings = load_settings(overrides=tree)
    camera = next(iter(source.recordings.values())).frames.intrinsics
    sensor: dict[str, Any] = {"name": "recording", "title": _RECORDING_TITLE, "stages": []}
    sensor |= {"width": camera.width, "height": camera.height}
    tasks = make_tasks(settings, [source])
    summary = write_dataset(
        settings, tasks, out, partial(_recorded_frames, source=source), sensor=sensor,
        renderer="none: recorded", workers=workers, progress=progress,
        inputs=lambda: InputHashes(sources=source_hashes([source], tasks)),
    )  # fmt: skip
    notes = source.notes
    if 0 < len(dark) < len(frames):
        lacks = f"{dark[0]} has no infrared image: that of the other frames is left out"
        notes = (*notes, f"{root}: {lacks}")
    return replace(summary, notes=notes)


def _recorded_frames(
    settings: Settings, tasks: Iterable[Task], *, source: RecordingSource
) -> Iterator[Frame | Skipped]:
    """Yield one result per task, in order."""
    for task in tasks:
        try:
            yield _recorded_frame(settings, task, source)
        except DatasetError as error:
            yield Skipped(task.key, source.name, str(error))


def _recorded_frame(settings: Settings, task: Task, source: RecordingSource) -> Frame:
    recording = source.recordings[task.key.subject]
    recorded = recording.frames[task.key.frame]
    noisy_m, infrared = recorded.in_metres("noisy_mm"), recorded.infrared
    if infrared is not None and infrared.shape != noisy_m.shape:
        raise DatasetError(
            f"{recording.path}: {recorded.name}: the infrared image is {infrared.shape[1]}x"
            f"{infrared.shape[0]}, its depth map {noisy_m.shape[1]}x{noisy_m.shape[0]}"
        )
    if not noisy_m.any():
        raise DatasetError(f"{recording.path}: {recorded.name}: no pixel has depth (all are 0)")
    camera = recorded.intrinsics
    nothing = np.zeros_like(noisy_m)
    notes: dict[str, object] = {"real": f"{recording.kind}, frame {recorded.name}", "clean": "none"}
    if recording.assumed:
        notes |= {"camera": f"assumed: {(name := recording.assumed)}", "intrinsics_assumed": name}
    elif recording.stated_by is not None:
        notes["camera"] = recording.stated_by.name
    if recording.distortion:
        notes["distortion_not_removed"] = [float(k) for k in recording.distortion]
    reasons = np.where(noisy_m > 0, Reason.VALID, Reason.NO_SURFACE).astype(np.uint8)
    light = nothing if infrared is None else infrared
    return _frame(settings, task, source, camera, nothing, noisy_m, light, reasons, notes=notes)


def _word(name: str) -> str:
    """Return a folder's name without characters that paths must not have."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "recording"
