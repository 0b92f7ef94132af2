"""Reader of FaceWarehouse: 150 people with 47 blend shapes and 20 poses each.

    Tester_N/Blendshape/shape.bs         all 47 meshes: int32 number of expressions (46, without the
                                         neutral face), vertices and quads, little-endian; then
                                         (V, 3) float32 positions each, the neutral face first
    Tester_N/Blendshape/shape_K.obj      single meshes, with the topology: quads
    Tester_N/TrainingPose/pose_K.obj     20 fitted poses, 0 is neutral

directly below the root or up to three folders deeper. Folders of one person in several places are
one subject. Sequence "shapes" passes through the blend shapes in order, with ``steps`` frames from
each shape to the next (easing in and out); frame K * steps is shape K. Sequence "poses": the poses.

The files have their own unit, about 100 to 125 mm; it is estimated from the width of the neutral
face. +y is up, +z out of the face.
"""

from __future__ import annotations

import math
import os
import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from glsim.core.errors import MeshError
from glsim.core.files.listing import entries
from glsim.core.mesh import Mesh
from glsim.faces.face_source import Face, FaceKey, FaceSource, MeshFileSettings
from glsim.faces.meshes.alignment import Alignment
from glsim.faces.meshes.load import check_head_size, drop_degenerate, find_alignment_in_format
from glsim.faces.meshes.obj import read_obj, read_vertices
from glsim.faces.scans.file_source import FileFaces, file_contents, one_bad_file

SHAPES: Final = 47
"""The neutral face and 46 expressions; the header of shape.bs counts the expressions alone."""

AXES: Final = "+x+y+z"
FRAMES_PER_SECOND: Final = 30.0
PLAUSIBLE_UNIT_MM: Final = (60.0, 250.0)  # public tools use 100 to 150 mm per unit

_TESTER: Final = re.compile(r"Tester_\d+", re.ASCII)
_MAX_DEPTH: Final = 3

#: Width over the cheek bones as measured by ``mm_per_unit``: mean of 100 random ICT-FaceKit heads,
#: whose unit is known (standard deviation 7.8 mm). Adults have 137 mm by calliper.
FACE_WIDTH_MM: Final = 141.0
#: The width is measured on points up to this distance behind the tip of the nose, in face widths:
#: they include the widest part of the cheeks and exclude the ears.
_DEPTH: Final = 0.55
_ITERATIONS: Final = 30


@dataclass(frozen=True)
class _PersonFiles:
    """The files of a person: shape.bs, and OBJ files by shape number and by pose number."""

    bs: Path | None = None
    shapes: dict[int, Path] = field(default_factory=dict)
    poses: dict[int, Path] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _PersonGeometry:
    """The topology and alignment that all meshes of a person share; ``faces`` is (F, 3) int32.

    ``estimated_scale``: whether the unit comes from the face width.
    """

    faces: NDArray[np.int32]
    vertices: int
    alignment: Alignment
    estimated_scale: bool


class FaceWarehouseSettings(MeshFileSettings):
    """FaceWarehouse in its original layout: blend shapes and training poses of 150 people."""

    steps: int | None = Field(None, ge=1, description="frames per blend shape")
    poses: bool | None = Field(None, description="also the training poses")
    expressions: bool | None = Field(None, description="only the 19 non-neutral training poses")

    def open(self, seed: int) -> FaceSource:
        """Open the set. Raises ConfigError without its folder."""
        poses, alone = self.poses is not False, bool(self.expressions)
        return FaceWarehouse(self.folder, self.unit, self.axes, self.steps or 1, poses, alone)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Return 1 if there are folders named Tester_N, else 0."""
        return float(any(re.fullmatch(r"Tester_\d+", folder.name) for folder in folders))


class FaceWarehouse(FileFaces):
    """The source of FaceWarehouse. Raises ConfigError for an invalid setting or a missing root.

    Args:
        steps: frames from a blend shape to the next.
        poses, expressions: whether to include the poses, or to take the 19 non-neutral ones alone.
        unit: "auto" makes the neutral face 141 mm wide; a number is the millimetres per unit.
    """

    name = "facewarehouse"
    nothing = "no folder Tester_N with a Blendshape or TrainingPose in it"

    def __init__(
        self, root: Path | str, unit: str = "auto", axes: str = "auto", steps: int = 1,
        poses: bool = True, expressions: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(root, unit, axes)
        self._steps, self._poses, self._expressions = steps, poses, expressions

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return a person's first ``count`` keys: shapes, then poses. Raises ConfigError."""
        files = self.files_of(subject)
        keys = []
        for number in range((SHAPES - 1) * self._steps + 1):
            low, share = divmod(number, self._steps)
            path = files.bs or files.shapes.get(low)
            if path and (files.bs or not share or low + 1 in files.shapes):
                time_s = number / FRAMES_PER_SECOND if self._steps > 1 else 0.0
                keys.append(FaceKey(subject, "shapes", number, time_s, self._name(path)))
        if self._poses:
            keys += [
                FaceKey(subject, "poses", number, 0.0, self._name(path))
                for number, path in sorted(files.poses.items())
            ]
        if self._expressions:
            keys = [key for key in keys if key.sequence == "poses" and key.frame]
        return keys[:count]

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Hash the files of these people, with the OBJ files of their topology."""
        paths: list[Path] = []
        for subject in subjects:
            files = self.files_of(subject)
            paths += [*([files.bs] if files.bs else []), *files.shapes.values()]
            paths += [*files.poses.values(), *self._topology_file(subject)]
        return file_contents(self.root, paths)

    def _face(self, key: FaceKey) -> Face:
        """Return a frame's face; people of one topology share one ``faces`` array."""
        person = self.read_once(key.subject, self._geometry_of)
        weights = self._weights(key)
        points = self._points(key, weights, person.vertices)
        vertices_mm = person.alignment.apply(points)
        mesh = Mesh(vertices_mm, person.faces)
        mesh = check_head_size(self.root / key.path, mesh, person.alignment)
        notes = person.alignment.notes()
        if person.estimated_scale:
            notes["scale"] = "from the width of the neutral face"
        expression = {f"shape_{number}": share for number, share in weights.items() if number}
        return Face(key, mesh, expression, notes)

    def _weights(self, key: FaceKey) -> dict[int, float]:
        """Return a frame's shape weights, number -> weight, with sum 1; empty for a pose."""
        if key.sequence != "shapes":
            return {}
        low, step = divmod(key.frame, self._steps)
        share = (1 - math.cos(math.pi * step / self._steps)) / 2
        return {low: 1 - share, low + 1: share} if step else {low: 1.0}

    def _points(
        self, key: FaceKey, weights: dict[int, float], count: int
    ) -> NDArray[np.floating[Any]]:
        """Read the vertices (V, 3) of a frame, in the file's unit."""
        files = self.files_of(key.subject)
        if files.bs and weights:
            meshes: list[NDArray[np.floating[Any]]] = [*read_blend_shapes(files.bs, weights)]
        else:
            paths = [files.shapes[number] for number in weights] or [self.root / key.path]
            meshes = [read_vertices(path) for path in paths]
        shares = list(weights.values())
        points = meshes[0] if len(meshes) == 1 else shares[0] * meshes[0] + shares[1] * meshes[1]
        if len(points) != count or not np.isfinite(points).all():
            raise MeshError(
                f"{self.root / key.path}: not {count} finite vertices as the topology; "
                "copy the set's files again"
            )
        return points

    def _geometry_of(self, subject: str) -> _PersonGeometry:
        """Measure a person's topology and alignment on the neutral face. Raises MeshError."""
        files = self.files_of(subject)
        faces, count = self._topology(subject)
        neutral = files.bs or files.shapes.get(0) or files.poses.get(0)
        if neutral is None:
            raise MeshError(
                f"{self.root}: {subject} has no neutral face (shape.bs, shape_0.obj or pose_0.obj) "
                "to find the scale from; restore one of them"
            )
        key = FaceKey(subject, "poses" if neutral == files.poses.get(0) else "shapes", 0)
        points = self._points(replace(key, path=self._name(neutral)), self._weights(key), count)
        file_mesh = drop_degenerate(neutral, np.asarray(points, np.float64), faces, None)
        unit, estimated_scale = self._unit, self._unit == "auto"
        if estimated_scale:
            length = mm_per_unit(file_mesh.vertices)
            low_mm, high_mm = PLAUSIBLE_UNIT_MM
            if not low_mm <= length <= high_mm:
                raise MeshError(
                    f"{neutral}: an adult face would need {length:.4g} mm a unit, and the set has "
                    f"{low_mm:.0f} to {high_mm:.0f}; give it, such as unit=cm"
                )
            unit = f"{length:.6g}"
        alignment = find_alignment_in_format(
            neutral, file_mesh, unit=unit, axes=self._axes, format_axes=AXES
        )
        if alignment.flip_winding:
            faces = faces[:, ::-1]
        shared = self.shared(np.ascontiguousarray(faces, dtype=np.int32))
        return _PersonGeometry(shared, count, alignment, estimated_scale)

    def _topology(self, subject: str) -> tuple[NDArray[np.int64], int]:
        """Read the triangles (F, 3) and the number of vertices. Raises MeshError."""
        for path in self._topology_file(subject):
            obj = read_obj(path)
            triangles, _ = obj.triangles(path)
            if len(triangles):
                return triangles, len(obj.vertices)
        raise MeshError(f"{self.root}: no shape_K.obj or pose_K.obj tells the topology")

    def _topology_file(self, subject: str) -> list[Path]:
        """Return an OBJ file with the triangles, another person's if needed; [] if none."""
        files = [self.files_of(subject), *self.people.values()]
        return [path for f in files for path in (*f.shapes.values(), *f.poses.values())][:1]

    def _name(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()

    @cached_property
    def people(self) -> dict[str, _PersonFiles]:
        """Files of each person; the tree is listed once."""
        people: dict[str, _PersonFiles] = {}
        for folder in _tester_folders(self.root, _MAX_DEPTH):
            known = people.get(folder.name, _PersonFiles())
            bs = folder / "Blendshape" / "shape.bs"
            people[folder.name] = _PersonFiles(
                known.bs or (bs if bs.is_file() else None),
                _numbered(folder / "Blendshape", "shape") | known.shapes,
                _numbered(folder / "TrainingPose", "pose") | known.poses,
            )
        return {name: f for name, f in people.items() if f.bs or f.shapes or f.poses}


def _tester_folders(folder: Path, depth: int) -> Iterator[Path]:
    """Yield the Tester_N folders, at most ``depth`` levels below sub-folders."""
    for name in entries(folder, ())[1]:
        if _TESTER.fullmatch(name):
            yield folder / name
        elif depth:
            yield from _tester_folders(folder / name, depth - 1)


def _numbered(folder: Path, stem: str) -> dict[int, Path]:
    """Return the files ``stem_NUMBER.obj`` of a folder, number -> path."""
    names = entries(folder, (".obj",))[0] if folder.is_dir() else []
    matches = [re.fullmatch(rf"{stem}_(\d{{1,3}})\.obj", name, re.ASCII) for name in names]
    return {int(match[1]): folder / match[0] for match in matches if match}


def read_blend_shapes(path: Path, numbers: Iterable[int]) -> list[NDArray[np.float32]]:
    """Read meshes (V, 3) of a ``shape.bs`` by their numbers, 0 = neutral. Raises MeshError."""
    with one_bad_file(path), path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        expressions, vertices, _ = struct.unpack("<iii", file.read(12))
        if expressions not in (SHAPES - 1, SHAPES) or size != 12 + SHAPES * 12 * vertices:
            raise ValueError(
                f"{size} bytes are not {SHAPES} meshes: the header says {expressions} expressions "
                f"of {vertices} vertices"
            )
        meshes = []
        for number in numbers:
            file.seek(12 + number * 12 * vertices)
            meshes.append(np.frombuffer(file.read(12 * vertices), "<f4").reshape(-1, 3))
    return meshes


def mm_per_unit(vertices: NDArray[np.floating]) -> float:
    """Return the mm per unit at which the face is FACE_WIDTH_MM wide; 0 if it has no width.

    Only points within 0.55 widths behind and 0.4 widths above the nose tip count; this window
    depends on the width, hence the iteration. ``vertices``: (V, 3), y up, z out of the face.
    """
    x, y, z = vertices.T
    middle, width = (x.min() + x.max()) / 2, float(np.ptp(x))
    for _ in range(_ITERATIONS):
        near = np.abs(x - middle) < 0.1 * width
        if not near.any():
            return 0.0
        tip_y, tip_z = y[near][np.argmax(z[near])], z[near].max()
        front = (z > tip_z - _DEPTH * width) & (y > tip_y) & (y < tip_y + 0.4 * width)
        if not front.any():
            return 0.0
        narrower = float(np.ptp(x[front]))
        if abs(narrower - width) <= 1e-6 * width:
            break
        width = narrower
    return FACE_WIDTH_MM / width if width > 0 else 0.0
