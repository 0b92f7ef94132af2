"""Build the scene of a frame: the face in its pose, the room, and other people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from glsim.core.array_types import Array, Floats
from glsim.core.camera import SensorRig
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.core.units import MM_PER_M
from glsim.faces.face_source import Face, WornPart
from glsim.faces.neck import bend_neck, head_motion, move_pose
from glsim.faces.regions import RegionLabels, landmark_vertices, to_camera
from glsim.faces.variation import sample_variation
from glsim.looks.dress import worn_regions
from glsim.looks.room.scenery import Prop, body_of, build_scenery, check_behind, scene_regions
from glsim.looks.room.view import tilted
from glsim.settings.schema import SPEEDS
from glsim.settings.source_settings import generates
from glsim.simulation.face_loader import FaceLoader, alike
from glsim.simulation.plan.tasks import Task

#: Pixel size at the face, mm, from which the occluder is rendered instead of the mesh. The
#: difference is then hidden by the noise, 3 mm there (Kinect V2, 1.5 m); its size is in
#: docs/results/speed.md. The value was chosen, not measured.
_FAR_PIXEL_MM = 4.0


@dataclass(frozen=True, eq=False)
class FrameScene:
    """All meshes of a frame in camera coordinates, with their labels and sampled values.

    Attributes:
        meshes: each mesh with its (4, 4) matrix from canonical mm to camera m; the face is first.
        labels: for each mesh the (V,) region numbers of its vertices or None; or empty.
        sampled: sampled values of the face, its clothes and the room, by their names.
        head_to_camera_m: (4, 4) from the head frame, metres, to the camera frame, metres.
        landmarks_m: (68, 3) camera-frame metres, or None.
    """

    face: Face
    meshes: Sequence[tuple[Mesh, Floats]]
    labels: Sequence[Floats | None]
    crop: Rect
    pose: Mapping[str, float]
    sampled: Mapping[str, float]
    head_to_camera_m: Array
    landmarks_m: Array | None


class FrameScenes:
    """Builds the scenes of a loader's faces, and keeps the last scene for reuse."""

    def __init__(self, loader: FaceLoader, *, regions: bool) -> None:
        """Prepare region labels if requested. Raises ConfigError if the sources have none."""
        settings, self.loader, self.regions = loader.settings, loader, regions
        worn = worn_regions(settings.appearance, loader.sources)
        further = [*scene_regions(settings.scene), *worn]
        self._labels = RegionLabels(loader.sources, further) if regions else None
        self.region_numbers = {} if self._labels is None else self._labels.numbers
        self._last: tuple[Task, FrameScene] | None = None

    def build(self, task: Task, face: Face) -> FrameScene:
        """Build a face's scene; the same task and face give the same object. Raises MeshError."""
        if self._last is not None and self._last[0] == task and self._last[1].face is face:
            return self._last[1]
        scene = self._build(task, face)
        self._last = task, scene
        return scene

    def moved(self, task: Task, face: Face, times_s: Sequence[float]) -> list[FrameScene] | None:
        """Build the scenes at other times, s, like ``build``; None if nothing moves."""
        speeds = {SPEEDS[n.removeprefix("motion.")]: v for n, v in self.speeds(task).items()}
        follows = generates(self.loader.sources[task.source].name)
        if not follows and not any(speeds.values()):
            return None
        scenes = []
        for time_s in times_s:
            then = self.loader.load_at(task, time_s) if follows else face
            moment = face if alike(then, face) else then
            scenes.append(self._build(task, moment, time_s, speeds))
        still = self.build(task, face)
        if all(s.face is face and alike(s.meshes, still.meshes) for s in scenes):
            return None
        return scenes

    def speeds(self, task: Task) -> dict[str, float]:
        """Sample the speeds in [motion]: "motion.NAME" -> mm or degrees per second."""
        seeds, motion = self.loader.held(task).seeds, self.loader.settings.motion
        return {f"motion.{n}": getattr(motion, n).sample(seeds, f"motion.{n}") for n in SPEEDS}

    def _build(
        self,
        task: Task,
        face: Face,
        after_s: float = 0.0,
        speeds: Mapping[str, float] | None = None,
    ) -> FrameScene:
        loader, settings, rig = self.loader, self.loader.settings, self.loader.rig
        source, seeds = loader.sources[task.source], loader.held(task).seeds
        pose = {
            name: getattr(settings.pose, name).sample(seeds, f"pose.{name}")
            for name in type(settings.pose).model_fields
        }
        still, motion = pose, pose.pop("motion")
        if generates(source.name):  # recorded faces move by themselves
            offsets = head_motion(task.seeds.sequence, task.key.time_s + after_s)
            offsets = {name: motion * offset for name, offset in offsets.items()}
            pose = move_pose(pose, offsets, face.neck)
        if speeds is not None and any(speeds.values()):
            pose = move_pose(pose, {n: after_s * v for n, v in speeds.items()}, face.neck)
        sampled = sample_variation(settings.variation, seeds)
        sampled |= loader.dressers[task.source].sampled(face, seeds)
        body = body_of(face) if settings.scene.room != "none" else None
        scenery = build_scenery(settings.scene, settings.pose, seeds, rig, body)
        sampled |= scenery.sampled
        meshes = [face.mesh, *(part.mesh for part in face.parts)]
        person = bend_neck(meshes, face.neck, pose, still)
        view = tilted(pose_matrix(pose), scenery.tilt_deg)
        check_behind(scenery, person, view)
        others = loader.others.props(task.source, seeds, scenery) if body is not None else []
        further = [*scenery.props, *others]
        labels: list[Floats | None] = []
        if self._labels is not None:
            named: list[WornPart | Prop] = [*face.parts, *further]
            labels = [
                self._labels.of(task.source, len(face.mesh.vertices_mm)),
                *(self._labels.uniform(x.region, len(x.mesh.vertices_mm)) for x in named),
            ]
        head_to_camera, landmarks_m = view.astype(np.float64), None
        if settings.output.landmarks:
            chosen = landmark_vertices(source)
            landmarks_m = to_camera(person[0].vertices_mm[chosen], head_to_camera)
        head_to_camera[:3, :3] *= 1000.0  # the view takes millimetres, this matrix metres
        placed = [*((mesh, view) for mesh in person), *((x.mesh, x.view) for x in further)]
        return FrameScene(
            face=face,
            meshes=tuple((_as_seen(mesh, place, rig), place) for mesh, place in placed),
            labels=labels,
            crop=crop_window(rig, still, settings.output.crop),
            pose=pose,
            sampled=sampled,
            head_to_camera_m=head_to_camera,
            landmarks_m=landmarks_m,
        )


def _as_seen(mesh: Mesh, view: Floats, rig: SensorRig) -> Mesh:
    """Return a mesh as a far camera sees it, reduced to the triangles that cast its shadows."""
    pixel_mm = MM_PER_M * float(view[2, 3]) / rig.intrinsics.fx
    if mesh.occluder is None or mesh.folds is not None or pixel_mm < _FAR_PIXEL_MM:
        return mesh
    return replace(mesh, faces=mesh.occluder, occluder=None)


def crop_window(rig: SensorRig, pose: Mapping[str, float], side: int | None) -> Rect:
    """Return the delivered square, centred on the face but inside the image; None: the image."""
    image = rig.delivered
    if side is None:
        return Rect(0, 0, image.width, image.height)
    # A face at or behind the camera has no position in the image; the renderer reports it.
    depth_mm = max(pose["distance_mm"], 1.0)
    place = np.array([[pose["x_mm"], pose["y_mm"], depth_mm]])
    if rig.registered is not None:
        place = to_camera(place / MM_PER_M, rig.registered.from_depth())
    centre = image.project(place)[0]
    left = int(np.clip(round(centre[0] - side / 2), 0, image.width - side))
    top = int(np.clip(round(centre[1] - side / 2), 0, image.height - side))
    return Rect(left, top, side, side)
