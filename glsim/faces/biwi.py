"""The Biwi Kinect Head Pose set: 24 recordings of 20 people who turn their heads.

    NN.obj                              template of the person in recording NN: mm, camera axes
    NN/frame_FFFFF_pose.txt             how the head stands in a frame (glsim.faces.biwifile)
    NN/frame_FFFFF_depth.bin            what the Kinect measured (``glsim import biwi``)
    NN/depth.cal, NN/rgb.cal            calibrations

below the root or its folder ``hpdb``. The subject is the person, not the recording: 15, 18, 21 and
22 show F03, F05, F02 and M01 again. A frame is the template turned as in the recording; where the
face stands is up to the [pose] settings, as for every source.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.canonical import Canonicalisation, check_axes, check_unit
from glsim.errors import ConfigError, MeshError, did_you_mean
from glsim.faces.base import BadFace, Face, FaceKey
from glsim.faces.biwifile import HeadPose, read_pose
from glsim.faces.tree import check_root, last_number, listing
from glsim.mesh import Mesh
from glsim.meshio import find_known_frame, read_mesh, sized
from glsim.meshlimits import check_size

AXES: Final = "+x-y-z"
FRAMES_PER_SECOND: Final = 30.0
MAX_BYTES: Final = 50_000_000  # a template is 0.6 MB

PEOPLE: Final = (
    "F01", "F02", "F03", "F04", "F05", "F06", "M01", "M02", "M03", "M04", "M05", "M06",
    "M07", "M08", "F03", "M09", "M10", "F05", "M11", "M12", "F02", "M01", "M13", "M14",
)  # fmt: skip
"""The person of recordings 01 to 24 (the set's readme)."""

#: Camera axes (y down, z away) to canonical axes (y up, z out of the face) and back.
_TURN: Final = np.diag([1.0, -1.0, -1.0])


class Biwi:
    """A FaceSource over the Biwi set as it lies on the disk.

    every: take one frame in so many of each recording.
    unit, axes: override the templates' millimetres and +x-y-z.
    Raises ConfigError for a setting that means nothing and a missing root.
    """

    name = "biwi"

    def __init__(
        self, root: Path | str, *, unit: str = "auto", axes: str = "auto", every: int = 1
    ) -> None:
        check_unit(unit)
        check_axes(axes)
        if every < 1:
            raise ConfigError(f"every={every}: take one frame in 1 or more")
        root = check_root(root)
        self.root = root / "hpdb" if (root / "hpdb").is_dir() else root
        self._unit, self._axes, self._every = unit, axes, every
        self._templates: dict[str, tuple[Mesh, Canonicalisation] | MeshError] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be found again."""
        state = self.__dict__ | {"_templates": {}}
        state.pop("_people", None)
        return state

    def subjects(self, count: int | None) -> list[str]:
        """The first ``count`` people. Raises ConfigError: fewer than that, or none."""
        names = list(self._people)
        if not names:
            raise ConfigError(f"{self.root}: no recording NN (01 to 24) with frame_*_pose.txt")
        if count is not None and count > len(names):
            raise ConfigError(f"{self.root}: has {len(names)} subjects, {count} were asked for")
        return names[:count]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """The first ``count`` frames of a person, recording by recording. Raises ConfigError."""
        if subject not in self._people:
            raise ConfigError(
                f"{self.root}: no subject {subject!r} ({did_you_mean(subject, self._people)})"
            )
        keys: list[FaceKey] = []
        for recording in self._people[subject]:
            names = [n for n in listing(self.root / recording) if n.endswith("_pose.txt")]
            numbers = {last_number(name) or 0: name for name in names}
            first = min(numbers, default=0)
            keys += [
                FaceKey(
                    subject,
                    recording,
                    number,
                    (number - first) / FRAMES_PER_SECOND,
                    f"{recording}/{numbers[number]}",
                )
                for number in sorted(numbers)[:: self._every]
            ]
        return keys[:count]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """The template, turned as the pose file says, one a key; recordings share ``faces``."""
        for key in keys:
            try:
                yield self._face(key)
            except MeshError as error:
                yield BadFace(key, error)

    def pose(self, key: FaceKey) -> HeadPose:
        """How the head stands in a frame. Raises MeshError."""
        return read_pose(self.root / key.path)

    def depth_path(self, key: FaceKey) -> Path:
        """The depth file of a frame."""
        return self.root / (key.path.removesuffix("_pose.txt") + "_depth.bin")

    def in_camera(self, key: FaceKey) -> Mesh:
        """The template where the pose file puts it, for a camera at the origin. MeshError.

        Canonical axes; draw it with ``pose_matrix({})``.
        """
        template, frame = self._template(key.sequence)
        pose = self.pose(key)
        turn = (_TURN @ pose.rotation @ _TURN).T
        at_template = template.vertices_mm + np.array(frame.origin_mm)
        return replace(template, vertices_mm=_points(at_template @ turn + pose.centre_mm @ _TURN))

    def _face(self, key: FaceKey) -> Face:
        template, frame = self._template(key.sequence)
        pose = self.pose(key)
        turn = _TURN @ pose.rotation @ _TURN
        if turn[2, 2] < 0:
            raise MeshError(f"{self.root / key.path}: the face looks away from the camera")
        mesh = replace(template, vertices_mm=_points(template.vertices_mm @ turn.T))
        notes: dict[str, object] = {
            **frame.notes(),
            "head_rotation": [[round(float(v), 6) for v in row] for row in pose.rotation],
            "head_centre_mm": [round(float(v), 3) for v in pose.centre_mm],
        }
        return Face(key, mesh, notes=notes)

    def _template(self, recording: str) -> tuple[Mesh, Canonicalisation]:
        if recording not in self._templates:
            try:
                self._templates[recording] = self._read_template(recording)
            except MeshError as error:
                self._templates[recording] = error
        found = self._templates[recording]
        if isinstance(found, MeshError):
            raise found
        return found

    def _read_template(self, recording: str) -> tuple[Mesh, Canonicalisation]:
        path = self.root / f"{recording}.obj"
        check_size(path, MAX_BYTES)
        raw = read_mesh(path)
        unit = "mm" if self._unit == "auto" else self._unit
        frame = find_known_frame(
            path, raw, unit=unit, axes=self._axes, format_axes=AXES, recentre=True
        )
        mesh = sized(path, raw.to_mesh(frame))
        for other in self._templates.values():
            if not isinstance(other, MeshError) and np.array_equal(other[0].faces, mesh.faces):
                mesh = replace(mesh, faces=other[0].faces)
                break
        return mesh, frame

    @cached_property
    def _people(self) -> dict[str, list[str]]:
        """Person -> recordings."""
        found: dict[str, list[str]] = {}
        for number, person in enumerate(PEOPLE, start=1):
            folder = self.root / f"{number:02d}"
            if folder.is_dir() and any(name.endswith("_pose.txt") for name in listing(folder)):
                found.setdefault(person, []).append(folder.name)
        return found


def _points(vertices_mm: NDArray[np.floating]) -> NDArray[np.float32]:
    return np.ascontiguousarray(vertices_mm, dtype=np.float32)
