"""Load the faces of tasks, vary and dress them, one batch ahead of the rendering."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields, is_dataclass, replace
from threading import Lock

import numpy as np

from glsim.core.camera import SensorRig
from glsim.core.errors import GlsimError, MeshError
from glsim.faces.face_source import BadFace, Face, FaceSource
from glsim.faces.variation import vary
from glsim.looks.dress import Dresser
from glsim.looks.room.other_people import OtherPeople
from glsim.settings.schema import Settings
from glsim.simulation.plan.tasks import Task

#: Faces per batch: a matrix product of 32 rows keeps a core busy; their vertices take tens of MB.
_FACE_BATCH = 32

Loaded = list[tuple[Task, Face | BadFace]]


class FaceLoader:
    """Loads the faces of tasks for one rig, together with other people for the background."""

    def __init__(
        self,
        settings: Settings,
        sources: Sequence[FaceSource],
        rig: SensorRig,
        dressers: Sequence[Dresser] | None = None,
        others: OtherPeople | None = None,
    ) -> None:
        """Store settings and sources; loaders can share ``dressers``, one for each source."""
        self.settings, self.sources, self.rig = settings, sources, rig
        self.dressers = dressers or [Dresser(source, settings.appearance) for source in sources]
        self.others = others or OtherPeople(settings, sources, self.dressers, rig)
        self._loading = Lock()  # sub-frames load faces too, while a thread loads ahead
        self._loaded: tuple[Task, Face, Face] | None = None  # as loaded, as changed

    def changed_settings(self, settings: Settings) -> set[str]:
        """Return the names of the settings tables that differ from this loader's."""
        names = type(settings).model_fields
        return {n for n in names if getattr(settings, n) != getattr(self.settings, n)}

    def like(self, settings: Settings, rig: SensorRig) -> FaceLoader:
        """Make a loader for other settings that shares the sources and all unchanged parts."""
        changed = self.changed_settings(settings)
        same_others = rig == self.rig and changed <= {"stage", "pose", "motion"}
        dressers = None if "appearance" in changed else self.dressers
        others = self.others if same_others else None
        return FaceLoader(settings, self.sources, rig, dressers, others)

    def held(self, task: Task) -> Task:
        """Return the task; with ``settings.redraw`` its values are sampled once per sequence."""
        if self.settings.redraw is None:
            return task
        return replace(task, seeds=task.seeds._replace(frame=task.seeds.sequence))

    def load_ahead(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Face | BadFace]]:
        """Yield each task with its face, in order, while a thread loads the next batch."""
        with ThreadPoolExecutor(1, "faces") as reader:
            ahead: deque[Future[Loaded]] = deque()
            for _, run in itertools.groupby(tasks, key=lambda task: task.source):
                while batch := list(itertools.islice(run, _FACE_BATCH)):
                    ahead.append(reader.submit(self.load, batch))
                    if len(ahead) == 2:
                        yield from ahead.popleft().result()
            while ahead:
                yield from ahead.popleft().result()

    def load(self, batch: Sequence[Task]) -> Loaded:
        """Load the faces of one source's tasks; a file that crashes its reader gives a BadFace."""
        source, loaded = self.sources[batch[0].source], Loaded()
        with self._loading:
            for task in batch:
                self.others.load(task.source, self.held(task).seeds)
            while len(loaded) < len(batch):
                rest = batch[len(loaded) :]
                faces = iter(source.load([task.key for task in rest]))
                for task in rest:
                    try:
                        face = next(faces, None)
                        if isinstance(face, Face):
                            face = self._changed(task, face, keep=len(batch) == 1)
                    except GlsimError:
                        raise
                    except Exception as error:
                        if not task.key.path:
                            raise  # the error is not a file's fault
                        loaded.append((task, BadFace(task.key, unusable(task, error))))
                        break  # the iterator has ended; the remaining tasks get a new one
                    if face is None:
                        raise GlsimError(f"source {source.name} gave no face for {task.stem}")
                    loaded.append((task, face))
        return loaded

    def load_at(self, task: Task, time_s: float) -> Face:
        """Load a generated face ``time_s`` seconds after the frame's own time."""
        key = replace(task.key, time_s=task.key.time_s + time_s)
        with self._loading:
            face = next(iter(self.sources[task.source].load([key])))
            if isinstance(face, BadFace):
                raise face.error
            return self._varied(task, face)

    def _varied(self, task: Task, face: Face) -> Face:
        seeds = self.held(task).seeds
        return self.dressers[task.source].dress(vary(face, self.settings.variation, seeds), seeds)

    def _changed(self, task: Task, face: Face, *, keep: bool) -> Face:
        """Vary and dress a face; with ``keep``, reuse the result if the same task comes again."""
        if self._loaded is not None and self._loaded[0] == task and alike(self._loaded[1], face):
            return self._loaded[2]
        changed = self._varied(task, face)
        self._loaded = (task, face, changed) if keep else None
        return changed


def alike(one: object, other: object) -> bool:
    """Return whether two faces, or parts of faces, hold equal values."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)  # type: ignore[arg-type]
    if is_dataclass(one):
        return all(alike(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, tuple):
        pairs = zip(one, other, strict=False)  # type: ignore[call-overload]
        return len(one) == len(other) and all(alike(*pair) for pair in pairs)  # type: ignore[arg-type]
    return bool(one == other)


def unusable(task: Task, error: Exception) -> MeshError:
    """Make the MeshError of a face whose loading raised another exception."""
    what = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}".removesuffix(": ")
    return MeshError(f"{task.key.path or task.stem}: cannot be used ({what})")
