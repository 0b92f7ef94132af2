"""Reader of the Biwi Kinect Head Pose set: 24 recordings of 20 people who turn their heads.

    NN.obj                              template of the person in recording NN: mm, camera axes
    NN/frame_FFFFF_pose.txt             head pose of a frame (see head_pose)
    NN/frame_FFFFF_depth.bin            depth measured by the Kinect (``glsim import biwi``)
    NN/depth.cal, NN/rgb.cal            calibrations

below the root or its folder ``hpdb``. The subject is the person, not the recording: 15, 18, 21 and
22 show F03, F05, F02 and M01 again. A frame is the template rotated as in the recording; [pose]
positions it, as for every source.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from glsim.core.errors import MeshError
from glsim.core.files.listing import entries
from glsim.core.mesh import Mesh
from glsim.core.products import product
from glsim.faces.face_source import Face, FaceKey, FaceSource, MeshFileSettings
from glsim.faces.meshes.alignment import Alignment
from glsim.faces.meshes.load import check_head_size, find_alignment_in_format, read_mesh
from glsim.faces.scans.file_source import FileFaces, file_contents
from glsim.faces.scans.file_tree import last_number
from glsim.faces.scans.head_pose import HeadPose, read_pose

AXES: Final = "+x-y-z"
FRAMES_PER_SECOND: Final = 30.0
_POSE: Final = "_pose.txt"  # end of the names of pose files

PEOPLE: Final = (
    "F01", "F02", "F03", "F04", "F05", "F06", "M01", "M02", "M03", "M04", "M05", "M06",
    "M07", "M08", "F03", "M09", "M10", "F05", "M11", "M12", "F02", "M01", "M13", "M14",
)  # fmt: skip
"""The person of recordings 01 to 24 (the set's readme)."""

#: Converts camera axes (y down, z away) to canonical axes (y up, z out of the face) and back.
_FLIP_YZ: Final = np.diag([1.0, -1.0, -1.0])


class BiwiSettings(MeshFileSettings):
    """The Biwi Kinect Head Pose set in its original layout: templates at recorded poses."""

    every: int | None = Field(None, ge=1, description="take every n-th frame")

    def open(self, seed: int) -> FaceSource:
        """Open the set. Raises ConfigError without its folder."""
        return Biwi(self.folder, unit=self.unit, axes=self.axes, every=self.every or 1)

    @classmethod
    def likeness(cls, root: Path, folders: Sequence[Path]) -> float:
        """Return 1 if a folder named by two digits holds head poses, else 0."""
        named = (folder for folder in folders if re.fullmatch(r"\d\d", folder.name))
        return float(any(any(folder.glob("frame_*_pose.txt")) for folder in named))


class Biwi(FileFaces):
    """The face source of the Biwi set in its original layout: every n-th frame of each recording.

    ``unit`` and ``axes`` override the templates' millimetres and +x-y-z. Raises ConfigError for an
    invalid setting or a missing root.
    """

    name = "biwi"
    nothing = "no recording NN (01 to 24) with frame_*_pose.txt"

    def __init__(
        self, root: Path | str, *, unit: str = "auto", axes: str = "auto", every: int = 1
    ) -> None:
        below = Path(root) / "hpdb"
        super().__init__(below if below.is_dir() else root, unit, axes)
        self._every = every

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return the keys of a person's first ``count`` frames. Raises ConfigError."""
        keys: list[FaceKey] = []
        for recording in self.files_of(subject):
            names, _ = entries(self.root / recording, (_POSE,))
            numbers = {last_number(name) or 0: name for name in names}
            first = min(numbers, default=0)
            for number in sorted(numbers)[:: self._every]:
                time_s = (number - first) / FRAMES_PER_SECOND
                path = f"{recording}/{numbers[number]}"
                keys.append(FaceKey(subject, recording, number, time_s, path))
        return keys[:count]

    def contents(self, subjects: Sequence[str]) -> dict[str, str]:
        """Hash the templates and pose files of these people: file -> hash."""
        keys = [key for subject in subjects for key in self.frames(subject, None)]
        templates = dict.fromkeys(self.root / f"{key.sequence}.obj" for key in keys)
        return file_contents(self.root, [*templates, *(self.root / key.path for key in keys)])

    def pose(self, key: FaceKey) -> HeadPose:
        """Read the head pose of a frame. Raises MeshError."""
        return read_pose(self.root / key.path)

    def depth_path(self, key: FaceKey) -> Path:
        """Return the path of a frame's depth file."""
        return self.root / (key.path.removesuffix(_POSE) + "_depth.bin")

    def in_camera(self, key: FaceKey) -> Mesh:
        """Return the template at its recorded pose, for a camera at the origin. Raises MeshError.

        Canonical axes; render it with ``pose_matrix({})``.
        """
        template, alignment = self._template(key.sequence)
        pose = self.pose(key)
        rotation = product(product(_FLIP_YZ, pose.rotation), _FLIP_YZ).T
        in_template = template.vertices_mm + np.array(alignment.origin_mm)
        in_camera = product(in_template, rotation) + product(pose.centre_mm, _FLIP_YZ)
        return replace(template, vertices_mm=_as_float32(in_camera))

    def _face(self, key: FaceKey) -> Face:
        """Return the person's template, rotated by the frame's pose file."""
        template, alignment = self._template(key.sequence)
        pose = self.pose(key)
        rotation = product(product(_FLIP_YZ, pose.rotation), _FLIP_YZ)
        if rotation[2, 2] < 0:
            raise MeshError(f"{self.root / key.path}: the face looks away from the camera")
        mesh = replace(template, vertices_mm=_as_float32(product(template.vertices_mm, rotation.T)))
        notes: dict[str, object] = {
            **alignment.notes(),
            "head_rotation": [[round(float(v), 6) for v in row] for row in pose.rotation],
            "head_centre_mm": [round(float(v), 3) for v in pose.centre_mm],
        }
        return Face(key, mesh, notes=notes)

    def _template(self, recording: str) -> tuple[Mesh, Alignment]:
        return self.read_once(recording, self._read_template)

    def _read_template(self, recording: str) -> tuple[Mesh, Alignment]:
        path = self.root / f"{recording}.obj"
        file_mesh = read_mesh(path)
        unit = "mm" if self._unit == "auto" else self._unit
        alignment = find_alignment_in_format(
            path, file_mesh, unit=unit, axes=self._axes, format_axes=AXES
        )
        mesh = check_head_size(path, file_mesh.to_mesh(alignment), alignment)
        return replace(mesh, faces=self.shared(mesh.faces)), alignment

    @cached_property
    def people(self) -> dict[str, list[str]]:
        """Recordings of each person, person -> folder names."""
        people: dict[str, list[str]] = {}
        for number, person in enumerate(PEOPLE, start=1):
            folder = self.root / f"{number:02d}"
            if folder.is_dir() and entries(folder, (_POSE,))[0]:
                people.setdefault(person, []).append(folder.name)
        return people


def _as_float32(vertices_mm: NDArray[np.floating]) -> NDArray[np.float32]:
    return np.ascontiguousarray(vertices_mm, dtype=np.float32)
