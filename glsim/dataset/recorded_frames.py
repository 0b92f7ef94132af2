"""Import recordings of a real depth camera: noisy depth and infrared, no clean map."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from glsim.dataset.driver import write_dataset
from glsim.dataset.identity import InputHashes
from glsim.dataset.inputs import source_hashes
from glsim.dataset.progress import GenerateProgress, GenerateSummary
from glsim.dataset.recordings import CALIBRATION, FrameFiles, find_frames
from glsim.errors import ConfigError, DatasetError, MeshError
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.files.contents import content_hash
from glsim.frame import Frame, Skipped
from glsim.geometry.camera import Intrinsics
from glsim.geometry.rect import Rect
from glsim.plan.tasks import Task, make_tasks
from glsim.reason import Reason
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import DEFAULT_SENSOR, Settings, load_settings
from glsim.worker_processes import Workers

TITLE = "a real depth camera; there are no clean maps"
#: Step of the depth files of recordings that are floats, mm: a quarter of a Kinect's noise floor;
#: 16 bits then reach 16 m.
FLOAT_UNIT_MM = 0.25
#: Real frames are for testing unless the user says otherwise.
DEFAULT_SPLIT = "0,0,1"


class Recordings:
    """The recordings below a folder, as the source of a plan: one subject per folder.

    Raises ConfigError for a folder that does not exist, DatasetError if it holds no frames.
    """

    name = "kinect2"

    def __init__(self, root: Path, unit_mm: float = 1.0, mirror: bool = False, every: int = 1):
        self.root = root
        try:
            self.folders = {_word(root.resolve().name): find_frames(root, unit_mm, mirror)}
        except DatasetError:
            parts = sorted(path for path in root.iterdir() if path.is_dir())
            found = [(p, files) for p in parts if (files := _try(p, unit_mm, mirror)) is not None]
            if not found:
                raise
            self.folders = {_word(path.name): files for path, files in found}
            if len(self.folders) < len(found):
                raise DatasetError(
                    f"{root}: two folders have the same name without spaces: rename one"
                ) from None
        self._every, self._mirror = every, mirror

    def subjects(self, count: int | None) -> list[str]:
        """Return the names of the recordings."""
        names = list(self.folders)
        if count is not None and count > len(names):
            raise ConfigError(f"{self.root}: has {len(names)} recordings, not {count}")
        return names[:count]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return the keys of a recording's frames, numbered from 0 in the order of the names."""
        files = self.folders[subject].frames
        numbers = range(0, len(files), self._every)
        return [
            FaceKey(subject, "main", number, path=self._path(subject, number))
            for number in numbers[:count]
        ]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Raise: recordings hold images, not faces."""
        raise ConfigError(f"{self.root}: recordings have no meshes: use glsim import kinect2")

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Hash the files of recordings, and what else decides their frames: name -> hash."""
        hashes = {"mirror": str(self._mirror)}
        for files in (self.folders[subject] for subject in subjects):
            paths = [files.root / CALIBRATION]
            for frame in files.frames[:: self._every]:
                paths += [p for p in (frame.depth_file, frame.infrared_file) if p is not None]
            hashes |= {os.path.relpath(path, self.root): content_hash(path) for path in paths}
        return hashes

    def _path(self, subject: str, number: int) -> str:
        recorded = self.folders[subject].frames[number]
        return recorded.depth_file.relative_to(self.root).as_posix()

    @property
    def has_infrared(self) -> bool:
        """Whether every frame has an infrared image."""
        return all(f.infrared_file for files in self.folders.values() for f in files.frames)

    @property
    def step_mm(self) -> float:
        """The step of depth files that loses nothing, or hardly anything of floats, mm."""
        steps = {f.frames[0].quantum_mm or FLOAT_UNIT_MM for f in self.folders.values()}
        return min(steps)


def import_recordings(
    root: Path,
    out: Path,
    *,
    depth_unit_mm: float = 1.0,
    mirror: bool = False,
    every: int = 1,
    split: str | None = None,
    workers: Workers = "auto",
    progress: Callable[[GenerateProgress], None] | None = None,
) -> GenerateSummary:
    """Write the recordings in ``root``, or in its sub-folders, as a data set of glsim.

    Its layers are noisy and, if every frame has it, infrared; there is no clean layer. Frames that
    cannot be read are skipped with the reason. The camera is that of ``calib_ir.yaml``, else a
    Kinect V2's. depth_unit_mm: step of integer files, kept in the data set. Raises ConfigError for
    a folder that does not exist, DatasetError without frames, and errors of ``write_dataset``.
    """
    source = Recordings(root, depth_unit_mm, mirror, every)
    layers = ("noisy", "infrared") if source.has_infrared else ("noisy",)
    tree: dict[str, Any] = {
        "source": {"kind": "kinect2", "root": root, "every": every},
        "output": {"layers": layers, "depth_unit_mm": source.step_mm},
        "split": split or DEFAULT_SPLIT,
    }
    settings = load_settings(overrides=tree)
    camera = _camera(next(iter(source.folders.values())), None)
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
    settings: Settings, tasks: Iterable[Task], *, source: Recordings
) -> Iterator[Frame | Skipped]:
    """Yield one result per task, in order; see ``import_recordings``."""
    for task in tasks:
        try:
            yield _frame(settings, task, source)
        except DatasetError as error:
            if settings.strict:
                raise MeshError(str(error)) from None
            yield Skipped(task.key, source.name, str(error))


def _frame(settings: Settings, task: Task, source: Recordings) -> Frame:
    files = source.folders[task.key.subject]
    recorded = files.frames[task.key.frame]
    noisy_m = recorded.depth_mm() / np.float32(1000)
    infrared = recorded.infrared()
    if infrared is not None and infrared.shape != noisy_m.shape:
        raise DatasetError(
            f"{recorded.infrared_file}: is {infrared.shape[1]}x{infrared.shape[0]}, its depth map "
            f"{noisy_m.shape[1]}x{noisy_m.shape[0]}"
        )
    if not noisy_m.any():
        raise DatasetError(f"{recorded.depth_file}: no pixel has depth (all are 0)")
    camera = _camera(files, noisy_m.shape)
    nothing = np.zeros_like(noisy_m)
    notes: dict[str, object] = {"real": f"{files.kind}, frame {recorded.name}", "clean": "none"}
    own = files.intrinsics is not None and camera == files.intrinsics
    notes["camera"] = "calib_ir.yaml" if own else f"assumed: {DEFAULT_SENSOR}"
    if own and files.distortion:
        notes["distortion_not_removed"] = [float(k) for k in files.distortion]
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


def _camera(files: FrameFiles, shape: tuple[int, ...] | None) -> Intrinsics:
    """Return the calibrated camera if it fits the image, else a Kinect V2's."""
    if shape is None:
        shape = files.frames[0].depth_mm().shape
    own = files.intrinsics
    if own is not None and (own.height, own.width) == shape:
        return own
    return load_sensor(DEFAULT_SENSOR).rig.for_map((shape[0], shape[1])).intrinsics


def _try(path: Path, unit_mm: float, mirror: bool) -> FrameFiles | None:
    try:
        return find_frames(path, unit_mm, mirror)
    except DatasetError:
        return None


def _word(name: str) -> str:
    """Make a folder's name a path-safe word."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "recording"
