"""Head poses of the Biwi Kinect Head Pose set, stored as one text file per frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.faces.meshes.obj import read_bytes
from glsim.faces.scans.file_source import one_bad_file

_MAX_TEXT: Final = 10_000
_ROTATION_TOLERANCE: Final = 0.02


@dataclass(frozen=True, eq=False)
class HeadPose:
    """A recorded head pose: x_camera_mm = rotation (3, 3) @ x_template_mm + centre_mm (3,).

    Camera axes: x right, y down, z away.
    """

    rotation: NDArray[np.float64]
    centre_mm: NDArray[np.float64]


def read_pose(path: Path) -> HeadPose:
    """Read ``frame_*_pose.txt``: rows of a rotation, the head's centre in mm. Raises MeshError."""
    with one_bad_file(path):
        numbers = np.array([float(word) for word in read_bytes(path, _MAX_TEXT).split()])
        if len(numbers) != 12 or not np.isfinite(numbers).all():
            raise ValueError(f"it holds {len(numbers)} numbers, not 12 finite ones")
    rotation, centre = numbers[:9].reshape(3, 3), numbers[9:]
    bounded = np.abs(rotation).max() < 1 + _ROTATION_TOLERANCE
    error = np.abs(rotation @ rotation.T - np.eye(3)).max() if bounded else np.inf
    if not (error < _ROTATION_TOLERANCE and np.linalg.det(rotation) > 0):
        raise MeshError(f"{path}: its first nine numbers are no rotation; copy it again")
    if np.abs(centre).max() > 1e5:
        raise MeshError(f"{path}: the head is {np.abs(centre).max():.4g} mm away; copy it again")
    return HeadPose(rotation, centre)
