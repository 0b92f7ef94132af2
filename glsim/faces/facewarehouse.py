"""FaceWarehouse: 150 people in 47 blend shapes and 20 poses each.

    Tester_N/Blendshape/shape.bs         all 47 meshes (glsim.faces.shapefile)
    Tester_N/Blendshape/shape_K.obj      the same one by one, and the topology: quads
    Tester_N/TrainingPose/pose_K.obj     20 fitted poses, 0 is neutral

below the root, directly or up to three folders deeper. One person's folders in several places are
one subject. Sequence "shapes" goes through the blend shapes in order, ``steps`` frames from one to
the next (easing in and out); its frame K * steps is shape K. Sequence "poses" holds the poses.

The files have a unit of their own, about 100 to 125 mm; the width of the neutral face sets it
(glsim.faces.headscale). +y is up, +z out of the face.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.canonical import Canonicalisation, check_axes, check_unit
from glsim.errors import ConfigError, MeshError, did_you_mean
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.headscale import mm_per_unit
from glsim.faces.shapefile import SHAPES, open_shapes
from glsim.faces.tree import check_root, listing
from glsim.mesh import Mesh
from glsim.meshio import clean, find_known_frame, sized
from glsim.meshlimits import check_size
from glsim.objfile import read_obj, read_vertices

AXES: Final = "+x+y+z"
FRAMES_PER_SECOND: Final = 30.0
PLAUSIBLE_MM: Final = (60.0, 250.0)  # public tools use 100 to 150 mm a unit
MAX_BYTES: Final = 50_000_000  # an OBJ of the set is 2 MB

_TESTER: Final = re.compile(r"Tester_\d+", re.ASCII)
_DEPTH: Final = 3
_TRIES: Final = 3  # damaged files in a row before the topology is given up


@dataclass(frozen=True)
class _Tester:
    """A person's files: shape.bs, shape number -> OBJ, pose number -> OBJ."""

    bs: Path | None = None
    shapes: dict[int, Path] = field(default_factory=dict)
    poses: dict[int, Path] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Person:
    """What all meshes of a person share: (F, 3) int32 triangles, vertex count, and the frame."""

    faces: NDArray[np.int32]
    vertices: int
    frame: Canonicalisation
    scaled: bool


class FaceWarehouse:
    """A FaceSource over FaceWarehouse as it lies on the disk.

    steps: frames from one blend shape to the next, 1 or more. poses: whether poses are used too.
    unit: "auto" makes the neutral face 141 mm wide; a number is the millimetres of a unit.
    Raises ConfigError for a setting that means nothing and a missing root.
    """

    name = "facewarehouse"

    def __init__(
        self,
        root: Path | str,
        *,
        unit: str = "auto",
        axes: str = "auto",
        steps: int = 1,
        poses: bool = True,
    ) -> None:
        check_unit(unit)
        check_axes(axes)
        if steps < 1:
            raise ConfigError(f"steps={steps}: 1 or more frames lead from one shape to the next")
        self.root = check_root(root)
        self._unit, self._axes, self._steps, self._poses = unit, axes, steps, poses
        self._people: dict[str, _Person | MeshError] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be found again."""
        state = self.__dict__ | {"_people": {}}
        state.pop("_testers", None)
        return state

    def subjects(self, count: int | None) -> list[str]:
        """The first ``count`` people. Raises ConfigError: fewer than that, or none."""
        names = list(self._testers)
        if not names:
            raise ConfigError(
                f"{self.root}: no folder Tester_N with a Blendshape or TrainingPose in it"
            )
        if count is not None and count > len(names):
            raise ConfigError(f"{self.root}: has {len(names)} subjects, {count} were asked for")
        return names[:count]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """The first ``count`` frames: the shapes, then the poses. Raises ConfigError."""
        tester = self._tester(subject)
        keys = []
        for number in range((SHAPES - 1) * self._steps + 1):
            low, share = divmod(number, self._steps)
            path = tester.bs or tester.shapes.get(low)
            if path and (tester.bs or not share or low + 1 in tester.shapes):
                time_s = number / FRAMES_PER_SECOND if self._steps > 1 else 0.0
                keys.append(FaceKey(subject, "shapes", number, time_s, self._name(path)))
        if self._poses:
            keys += [
                FaceKey(subject, "poses", number, 0.0, self._name(path))
                for number, path in sorted(tester.poses.items())
            ]
        return keys[:count]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Read one mesh a key. All people of one topology share one ``faces`` array."""
        for key in keys:
            try:
                yield self._face(key)
            except MeshError as error:
                yield BadFace(key, error)

    def _face(self, key: FaceKey) -> Face:
        person = self._person(key.subject)
        weights = self._weights(key)
        points = self._points(key, weights, person.vertices)
        mesh = sized(self.root / key.path, Mesh(person.frame.points(points), person.faces))
        notes = person.frame.notes()
        if person.scaled:
            notes["scale"] = "from the width of the neutral face"
        expression = {f"shape_{number}": share for number, share in weights.items() if number}
        return Face(key, mesh, expression, notes)

    def _weights(self, key: FaceKey) -> dict[int, float]:
        """Shape number -> share, adding up to 1; empty for a pose."""
        if key.sequence != "shapes":
            return {}
        low, step = divmod(key.frame, self._steps)
        share = (1 - math.cos(math.pi * step / self._steps)) / 2
        return {low: 1 - share, low + 1: share} if step else {low: 1.0}

    def _points(
        self, key: FaceKey, weights: dict[int, float], count: int
    ) -> NDArray[np.floating[Any]]:
        """(V, 3) in the file's unit."""
        tester = self._tester(key.subject)
        if not weights:
            return _read_points(self.root / key.path, count)
        meshes: list[NDArray[np.floating[Any]]]
        if tester.bs:
            file = open_shapes(tester.bs)
            _same_count(tester.bs, file.vertices, count)
            meshes = list(file.read(weights))
        else:
            meshes = [_read_points(tester.shapes[number], count) for number in weights]
        shares = list(weights.values())
        return meshes[0] if len(meshes) == 1 else shares[0] * meshes[0] + shares[1] * meshes[1]

    def _person(self, subject: str) -> _Person:
        """Topology, scale, winding and origin from the neutral face. Raises MeshError."""
        if subject not in self._people:
            try:
                self._people[subject] = self._find(subject)
            except MeshError as error:
                self._people[subject] = error
        found = self._people[subject]
        if isinstance(found, MeshError):
            raise found
        return found

    def _find(self, subject: str) -> _Person:
        tester = self._tester(subject)
        faces, count = self._topology(subject)
        neutral = tester.bs or tester.shapes.get(0) or tester.poses.get(0)
        if neutral is None:
            raise MeshError(
                f"{self.root}: {subject} has no neutral face (shape.bs, shape_0.obj or pose_0.obj) "
                "to find the scale from; restore one of them"
            )
        key = FaceKey(subject, "poses" if neutral == tester.poses.get(0) else "shapes", 0)
        points = self._points(replace(key, path=self._name(neutral)), self._weights(key), count)
        raw = clean(neutral, np.asarray(points, np.float64), faces, None)
        unit, scaled = self._unit, self._unit == "auto"
        if scaled:
            length = mm_per_unit(raw.vertices)
            if not PLAUSIBLE_MM[0] <= length <= PLAUSIBLE_MM[1]:
                raise MeshError(
                    f"{neutral}: an adult face would need {length:.4g} mm a unit, and the set has "
                    f"{PLAUSIBLE_MM[0]:.0f} to {PLAUSIBLE_MM[1]:.0f}; give the unit yourself"
                )
            unit = f"{length:.6g}"
        frame = find_known_frame(
            neutral, raw, unit=unit, axes=self._axes, format_axes=AXES, recentre=True
        )
        if frame.flip_winding:
            faces = faces[:, ::-1]
        shared = np.ascontiguousarray(faces, dtype=np.int32)
        for other in self._people.values():
            if isinstance(other, _Person) and np.array_equal(other.faces, shared):
                shared = other.faces
                break
        return _Person(shared, count, frame, scaled)

    def _topology(self, subject: str) -> tuple[NDArray[np.int64], int]:
        """(F, 3) triangles and the number of vertices, from the first OBJ that can be read.

        The set has one topology, so that another person's file will do where one's own are gone.
        """
        error = MeshError(f"{self.root}: no shape_K.obj or pose_K.obj tells the topology")
        own = self._tester(subject)
        first = [own, *(tester for tester in self._testers.values() if tester is not own)]
        candidates = [
            path
            for tester in first
            for path in list(
                (tester.shapes | {-1 - k: p for k, p in tester.poses.items()}).values()
            )
        ]
        for path in candidates[:_TRIES]:
            try:
                check_size(path, MAX_BYTES)
                obj = read_obj(path)
                triangles, _ = obj.triangles()
                if len(triangles) == 0:
                    raise MeshError(f"{path}: no faces in it; copy it again")
                return triangles, len(obj.vertices)
            except MeshError as problem:
                error = problem
        raise error

    def _tester(self, subject: str) -> _Tester:
        if subject not in self._testers:
            raise ConfigError(
                f"{self.root}: no subject {subject!r} ({did_you_mean(subject, self._testers)})"
            )
        return self._testers[subject]

    def _name(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()

    @cached_property
    def _testers(self) -> dict[str, _Tester]:
        found: dict[str, _Tester] = {}
        for folder in _folders(self.root, _DEPTH):
            known = found.get(folder.name, _Tester())
            bs = folder / "Blendshape" / "shape.bs"
            found[folder.name] = _Tester(
                known.bs or (bs if bs.is_file() else None),
                _numbered(folder / "Blendshape", "shape") | known.shapes,
                _numbered(folder / "TrainingPose", "pose") | known.poses,
            )
        return {name: t for name, t in found.items() if t.bs or t.shapes or t.poses}


def _folders(folder: Path, depth: int) -> Iterator[Path]:
    for name in listing(folder):
        path = folder / name
        if not path.is_dir():
            continue
        if _TESTER.fullmatch(name):
            yield path
        elif depth:
            yield from _folders(path, depth - 1)


def _numbered(folder: Path, stem: str) -> dict[int, Path]:
    """Number -> ``stem_number.obj``."""
    names = listing(folder) if folder.is_dir() else []
    matches = [re.fullmatch(rf"{stem}_(\d{{1,3}})\.obj", name, re.ASCII) for name in names]
    return {int(match[1]): folder / match[0] for match in matches if match}


def _read_points(path: Path, count: int) -> NDArray[np.float64]:
    check_size(path, MAX_BYTES)
    points = read_vertices(path)
    _same_count(path, len(points), count)
    if not np.isfinite(points).all():
        raise MeshError(f"{path}: a vertex is at NaN or infinity; copy it again")
    return points


def _same_count(path: Path, vertices: int, count: int) -> None:
    if vertices != count:
        raise MeshError(
            f"{path}: {vertices} vertices, the topology has {count}; copy the set's files again"
        )
