"""Import recordings of a depth camera: noisy depth and infrared, no clean map."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from glsim.core.errors import ConfigError, DatasetError, MeshError
from glsim.core.files.contents import content_hash
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.data.driver import write_dataset
from glsim.data.identity import InputHashes
from glsim.data.inputs import source_hashes
from glsim.data.progress import GenerateProgress, GenerateSummary
from glsim.data.recordings.recording import FrameReader, Recording, open_recording
from glsim.data.recordings.streams import is_stream
from glsim.data.worker_processes import Workers
from glsim.faces.base import BadFace, Face, FaceKey, FaceSource
from glsim.settings.schema import DEFAULT_SENSOR, Settings, load_settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.plan.tasks import Task, make_tasks

TITLE = "a real depth camera; there are no clean maps"
#: Step of the depth files of recordings of floats, mm. Chosen: a quarter of a Kinect's noise floor,
#: and 16 bits reach 16 m.
FLOAT_UNIT_MM = 0.25
#: Shares of train, val and test: real frames are for testing.
DEFAULT_SPLIT = "0,0,1"


class RecordingSource(FaceSource):
    """The recordings in a folder and its sub-folders, as the source of a plan: a subject each.

    Raises ConfigError for a folder that does not exist, DatasetError if it holds no frames.
    """

    name = "kinect2"

    def __init__(
        self, root: Path, unit_mm: float | None = None, mirror: bool = False, every: int = 1
    ):
        self.root, self.folder = root, root.parent if root.is_file() else root
        try:
            self.recordings = {_word(root.resolve().name): open_recording(root, unit_mm, mirror)}
        except DatasetError:
            if root.is_file():
                raise
            parts = sorted(path for path in root.iterdir() if path.is_dir() or is_stream(path))
            found = [(p, r) for p in parts if (r := _try(p, unit_mm, mirror)) is not None]
            if not found:
                raise
            self.recordings = {_word(path.name): recording for path, recording in found}
            if len(self.recordings) < len(found):
                raise DatasetError(
                    f"{root}: two folders have the same name without spaces: rename one"
                ) from None
        if any(recording.kind == "data set" for recording in self.recordings.values()):
            raise DatasetError(f"{root}: is a data set of glsim already")
        self._every, self._mirror = every, mirror

    def subjects(self, count: int | None) -> list[str]:
        """Return the names of the recordings."""
        names = list(self.recordings)
        if count is not None and count > len(names):
            raise ConfigError(f"{self.root}: has {len(names)} recordings, not {count}")
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
        """Return what reads the files of a recording."""
        reader = self.recordings[subject].reader
        assert reader is not None, "a data set is refused"
        return reader

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Raise: recordings hold images, not faces."""
        raise ConfigError(f"{self.root}: recordings have no meshes: use glsim import kinect2")

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Hash the files of recordings, and what else decides their frames: name -> hash."""
        hashes = {"mirror": str(self._mirror)}
        for subject in subjects:
            stated_by = self.recordings[subject].stated_by
            paths = [] if stated_by is None else [stated_by]
            reader = self.reader(subject)
            for number in range(0, len(reader), self._every):
                paths += [path for path in reader.files(number) if path is not None]
            hashes |= {os.path.relpath(path, self.folder): content_hash(path) for path in paths}
        return hashes

    @property
    def has_infrared(self) -> bool:
        """Whether every frame has an infrared image."""
        readers = map(self.reader, self.recordings)
        return all(r.files(number)[1] for r in readers for number in range(len(r)))

    @property
    def step_mm(self) -> float:
        """The step of depth files, mm, that keeps integers exactly and floats nearly so."""
        return min(r.frames[0].step_mm or FLOAT_UNIT_MM for r in self.recordings.values())


def import_recordings(
    root: Path,
    out: Path,
    *,
    depth_unit_mm: float | None = None,
    mirror: bool = False,
    every: int = 1,
    split: str | None = None,
    workers: Workers = "auto",
    progress: Callable[[GenerateProgress], None] | None = None,
) -> GenerateSummary:
    """Write the recordings in ``root``, or in its sub-folders, as a data set of glsim.

    Its layers are noisy and, if every frame has it, infrared. Unreadable frames are skipped with
    the reason. The camera is the stated one, else a Kinect V2's.

    Args:
        root: a folder that ``open_recording`` reads, or a folder of such folders.
        out: folder of the data set.
        depth_unit_mm: step of integer files, mm, kept in the data set; default: as the recording
            says, else 1.
        mirror: flip left and right, as dumps of libfreenect2 need.
        every: use every n-th frame.
        split: shares of train, val and test; default: all test.
        workers: number of processes.
        progress: called with the state after each frame.

    Raises:
        ConfigError: no such folder.
        DatasetError: no frames, or an error of ``write_dataset``.

    """
    source = RecordingSource(root, depth_unit_mm, mirror, every)
    layers = ("noisy", "infrared") if source.has_infrared else ("noisy",)
    tree: dict[str, Any] = {
        "source": {"kind": "kinect2", "root": root, "every": every},
        "output": {"layers": layers, "depth_unit_mm": source.step_mm},
        "split": split or DEFAULT_SPLIT,
    }
    settings = load_settings(overrides=tree)
    camera = next(iter(source.recordings.values())).frames.intrinsics
    sensor: dict[str, Any] = {"name": "recording", "title": TITLE, "stages": []}
    sensor |= {"width": camera.width, "height": camera.height}
    tasks = make_tasks(settings, [source])
    return write_dataset(
        settings,
        tasks,
        out,
        partial(recorded_frames, source=source),
        sensor=sensor,
        renderer="none: recorded",
        workers=workers,
        progress=progress,
        inputs=lambda: InputHashes(sources=source_hashes([source], tasks)),
    )


def recorded_frames(
    settings: Settings, tasks: Iterable[Task], *, source: RecordingSource
) -> Iterator[Frame | Skipped]:
    """Yield one result per task, in order; see ``import_recordings``."""
    for task in tasks:
        try:
            yield _frame(settings, task, source)
        except DatasetError as error:
            if settings.strict:
                raise MeshError(str(error)) from None
            yield Skipped(task.key, source.name, str(error))


def _frame(settings: Settings, task: Task, source: RecordingSource) -> Frame:
    recording = source.recordings[task.key.subject]
    recorded = recording.frames[task.key.frame]
    noisy_m, infrared = recorded.noisy_mm / np.float32(1000), recorded.infrared
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
    own = recording.camera is not None and camera == recording.camera
    stated_by = recording.stated_by.name if own and recording.stated_by is not None else ""
    notes["camera"] = stated_by or f"assumed: {DEFAULT_SENSOR}"
    if own and recording.distortion:
        notes["distortion_not_removed"] = [float(k) for k in recording.distortion]
    return Frame(
        task.key,
        source.name,
        task.seeds.frame,
        camera,
        Rect(0, 0, camera.width, camera.height),
        nothing,
        noisy_m,
        nothing if infrared is None else infrared,
        np.where(noisy_m > 0, Reason.VALID, Reason.NO_SURFACE).astype(np.uint8),
        depth_unit_mm=settings.output.depth_unit_mm,
        notes=notes,
    )


def _try(path: Path, unit_mm: float | None, mirror: bool) -> Recording | None:
    try:
        return open_recording(path, unit_mm, mirror)
    except DatasetError:
        return None


def _word(name: str) -> str:
    """Return a folder's name without characters that paths do not take."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "recording"
