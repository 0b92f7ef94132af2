"""Build the scene of a frame: its face, varied and dressed, its pose, the room and other people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.errors import GlsimError, MeshError
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.faces.base import BadFace, Face, FaceSource, WornPart
from glsim.faces.head_motion import head_motion, move_pose
from glsim.faces.landmarks import landmark_vertices, to_camera
from glsim.faces.neck import bend_neck
from glsim.faces.regions import RegionLabels
from glsim.faces.variation import draw_variation, vary
from glsim.looks.dress import Dresser, worn_regions
from glsim.looks.room.other_people import OtherPeople
from glsim.looks.room.scenery import Prop, body_of, build_scenery, check_behind, scene_regions
from glsim.looks.room.view import tilted
from glsim.settings.schema import SPEEDS, Settings
from glsim.settings.source_settings import generates
from glsim.simulation.plan.tasks import Task


@dataclass(frozen=True, eq=False)
class FrameScene:
    """What a frame shows.

    Attributes:
        meshes: each with its (4, 4) matrix from canonical mm to camera m; the face comes first.
        labels: per mesh the (V,) region numbers of its vertices, or None; empty without regions.
        crop: the delivered part of the image.
        pose: its values, with motion.
        drawn: values that were drawn for the face, what it wears and the room, by their names.
        head_to_camera_m: (4, 4), both in metres.
        landmarks_m: (68, 3) camera-frame metres, or None.
    """

    face: Face
    meshes: Sequence[tuple[Mesh, NDArray[np.float32]]]
    labels: Sequence[NDArray[np.float32] | None]
    crop: Rect
    pose: Mapping[str, float]
    drawn: Mapping[str, float]
    head_to_camera_m: NDArray[np.float64]
    landmarks_m: NDArray[np.float64] | None


class FrameScenes:
    """Loads faces and builds scenes for one rig. It keeps the last scene, which may come again."""

    def __init__(
        self,
        settings: Settings,
        sources: Sequence[FaceSource],
        rig: SensorRig,
        *,
        regions: bool,
        dressers: Sequence[Dresser] | None = None,
        others: OtherPeople | None = None,
    ) -> None:
        """Prepare the labels and what is worn. Raises ConfigError for regions of other faces.

        Args:
            regions: whether scenes have labels.
            dressers: one per source, to share them; default: new ones.
            others: to share them; default: new ones.
        """
        self._settings, self._sources, self._rig, self._regions = settings, sources, rig, regions
        further = [*scene_regions(settings.scene), *worn_regions(settings.appearance, sources)]
        self._labels = RegionLabels(sources, further) if regions else None
        self._dressers = dressers or [Dresser(source, settings.appearance) for source in sources]
        self._others = others or OtherPeople(settings, sources, self._dressers, rig)
        self._loading = Lock()
        self._loaded: tuple[Task, Face, Face] | None = None  # as loaded, and as changed
        self._last: tuple[Task, FrameScene] | None = None

    def builds(self, settings: Settings, rig: SensorRig, *, regions: bool) -> bool:
        """Return whether the scenes of other settings are these."""
        same = rig == self._rig and regions == self._regions
        return same and self._changed_settings(settings) <= {"stage"}

    def like(self, settings: Settings, rig: SensorRig, *, regions: bool) -> FrameScenes:
        """Return scenes of the same sources for other settings."""
        changed = self._changed_settings(settings)
        same_others = rig == self._rig and changed <= {"stage", "pose", "motion"}
        return FrameScenes(
            settings,
            self._sources,
            rig,
            regions=regions,
            dressers=None if "appearance" in changed else self._dressers,
            others=self._others if same_others else None,
        )

    def _changed_settings(self, settings: Settings) -> set[str]:
        names = type(settings).model_fields
        return {n for n in names if getattr(settings, n) != getattr(self._settings, n)}

    @property
    def region_numbers(self) -> Mapping[str, int]:
        """Name -> number of the regions."""
        return {} if self._labels is None else self._labels.numbers

    def held(self, task: Task) -> Task:
        """Return the task with the seeds of its settings; those of its noise are its own."""
        if self._settings.redraw is None:
            return task
        return replace(task, seeds=task.seeds.held_in_sequence())

    def load(self, batch: Sequence[Task]) -> list[tuple[Task, Face | BadFace]]:
        """Load the faces of one source. A file that its source cannot survive is a bad face."""
        with self._loading:  # sub-frames load faces too, while a thread loads ahead
            return self._load(batch)

    def _load(self, batch: Sequence[Task]) -> list[tuple[Task, Face | BadFace]]:
        for task in batch:
            self._others.load(task.source, self.held(task).seeds)
        source = self._sources[batch[0].source]
        loaded: list[tuple[Task, Face | BadFace]] = []
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
                        raise  # no file is to blame
                    loaded.append((task, BadFace(task.key, unusable(task, error))))
                    break  # the iterator has ended: the others get a new one
                if face is None:
                    raise GlsimError(f"source {source.name} gave no face for {task.stem}")
                loaded.append((task, face))
        return loaded

    def _changed(self, task: Task, face: Face, *, keep: bool) -> Face:
        """Vary a face, then dress it: what is worn follows the varied mesh.

        Args:
            keep: for a task that comes alone, which may come again: the same face is not changed
                anew.
        """
        if self._loaded is not None and self._loaded[0] == task and _alike(self._loaded[1], face):
            return self._loaded[2]
        seeds = self.held(task).seeds
        varied = vary(face, self._settings.variation, seeds)
        changed = self._dressers[task.source].dress(varied, seeds)
        self._loaded = (task, face, changed) if keep else None
        return changed

    def build(self, task: Task, face: Face) -> FrameScene:
        """Build the scene of a loaded face; the same object again for the same task and face.

        Raises MeshError for a face that cannot stand in its scene.
        """
        if self._last is not None and self._last[0] == task and self._last[1].face is face:
            return self._last[1]
        scene = self._build(task, face)
        self._last = task, scene
        return scene

    def moved(self, task: Task, face: Face, times_s: Sequence[float]) -> list[FrameScene] | None:
        """Build the scene at other times of the frame's exposure; None if nothing moves.

        Raises MeshError as ``build``.

        Args:
            task: the frame.
            face: as ``load`` gave it.
            times_s: from the frame's instant, seconds.
        """
        speeds = {SPEEDS[n.removeprefix("motion.")]: v for n, v in self.speeds(task).items()}
        follows = generates(self._sources[task.source].name)
        if not follows and not any(speeds.values()):
            return None
        scenes = []
        for time_s in times_s:
            then = self._face_at(task, time_s) if follows else face
            moment = face if _alike(then, face) else then
            scenes.append(self._build(task, moment, time_s, speeds))
        still = self.build(task, face)
        same = all(s.face is face and _stands_alike(s, still) for s in scenes)
        return None if same else scenes

    def speeds(self, task: Task) -> dict[str, float]:
        """Draw the speeds of [motion]: "motion.NAME" -> mm or degrees per second."""
        seeds, motion = self.held(task).seeds, self._settings.motion
        return {f"motion.{n}": getattr(motion, n).draw(seeds, f"motion.{n}") for n in SPEEDS}

    def _face_at(self, task: Task, time_s: float) -> Face:
        """Return the face of a generated sequence at another time of the frame."""
        key = replace(task.key, time_s=task.key.time_s + time_s)
        seeds = self.held(task).seeds
        with self._loading:
            face = next(iter(self._sources[task.source].load([key])))
            if isinstance(face, BadFace):
                raise face.error
            varied = vary(face, self._settings.variation, seeds)
            return self._dressers[task.source].dress(varied, seeds)

    def _build(
        self,
        task: Task,
        face: Face,
        after_s: float = 0.0,
        speeds: Mapping[str, float] | None = None,
    ) -> FrameScene:
        settings, rig = self._settings, self._rig
        seeds = self.held(task).seeds
        pose = {
            name: getattr(settings.pose, name).draw(seeds, f"pose.{name}")
            for name in type(settings.pose).model_fields
        }
        still, motion = pose, pose.pop("motion")
        if generates(self._sources[task.source].name):  # recorded faces move by themselves
            offsets = head_motion(task.seeds.sequence, task.key.time_s + after_s)
            offsets = {name: motion * offset for name, offset in offsets.items()}
            pose = move_pose(pose, offsets, face.neck)
        if speeds is not None and any(speeds.values()):
            pose = move_pose(pose, {n: after_s * v for n, v in speeds.items()}, face.neck)
        drawn = draw_variation(settings.variation, seeds)
        drawn |= self._dressers[task.source].drawn(face, seeds)
        body = body_of(face) if settings.scene.room != "none" else None
        scenery = build_scenery(settings.scene, settings.pose, seeds, rig, body)
        drawn |= scenery.drawn
        person = [
            bend_neck(mesh, face.neck, pose, still)
            for mesh in (face.mesh, *(part.mesh for part in face.parts))
        ]
        view = tilted(pose_matrix(pose), scenery.tilt_deg)
        check_behind(scenery, person, view)
        others = self._others.props(task.source, seeds, scenery) if body is not None else []
        further = [*scenery.props, *others]
        labels: list[NDArray[np.float32] | None] = []
        if self._labels is not None:
            named: list[WornPart | Prop] = [*face.parts, *further]
            labels = [
                self._labels.of(task.source, len(face.mesh.vertices_mm)),
                *(self._labels.uniform(x.region, len(x.mesh.vertices_mm)) for x in named),
            ]
        head_to_camera, landmarks_m = view.astype(np.float64), None
        if settings.output.landmarks:
            chosen = landmark_vertices(self._sources[task.source])
            landmarks_m = to_camera(person[0].vertices_mm[chosen], head_to_camera)
        head_to_camera[:3, :3] *= 1000.0  # the view takes millimetres, this matrix metres
        return FrameScene(
            face=face,
            meshes=[
                *((mesh, view) for mesh in person),
                *((prop.mesh, prop.view) for prop in further),
            ],
            labels=labels,
            crop=crop_window(rig.intrinsics, still, settings.output.crop),
            pose=pose,
            drawn=drawn,
            head_to_camera_m=head_to_camera,
            landmarks_m=landmarks_m,
        )


def _stands_alike(one: FrameScene, other: FrameScene) -> bool:
    """Return whether two scenes have the same meshes at the same places."""
    pairs = zip(one.meshes, other.meshes, strict=True)
    return all(_alike(a, b) and np.array_equal(v, w) for (a, v), (b, w) in pairs)


def _alike(one: object, other: object) -> bool:
    """Return whether two faces, or two of their parts, hold equal values."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)  # type: ignore[arg-type]
    if is_dataclass(one):
        return all(_alike(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, tuple):
        pairs = zip(one, other, strict=False)  # type: ignore[call-overload]
        return len(one) == len(other) and all(_alike(*pair) for pair in pairs)  # type: ignore[arg-type]
    return bool(one == other)


def unusable(task: Task, error: Exception) -> MeshError:
    """Return the MeshError of a face for which a source or NumPy raised another exception."""
    what = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}".removesuffix(": ")
    return MeshError(f"{task.key.path or task.stem}: cannot be used ({what})")


def crop_window(image: Intrinsics, pose: Mapping[str, float], side: int | None) -> Rect:
    """Return the delivered square, centred on the face and shifted into the image.

    Args:
        side: pixels; None delivers the whole image.
    """
    if side is None:
        return Rect(0, 0, image.width, image.height)
    # A face at or behind the camera has no place in the image; the renderer reports it.
    depth_mm = max(pose["distance_mm"], 1.0)
    centre = image.project(np.array([[pose["x_mm"], pose["y_mm"], depth_mm]]))[0]
    left = int(np.clip(round(centre[0] - side / 2), 0, image.width - side))
    top = int(np.clip(round(centre[1] - side / 2), 0, image.height - side))
    return Rect(left, top, side, side)
