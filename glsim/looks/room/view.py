"""The visible part of a room: cut to the camera's view, without triangles that face away."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from glsim.core.array_types import Array, Floats, Mask
from glsim.core.bounds import FieldOfView
from glsim.core.camera import SensorRig
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.products import product
from glsim.core.rect import Rect
from glsim.core.units import MM_PER_M, to_mm
from glsim.looks.shapes import Points, Shape, without_slivers

#: Margin around the view, in tangents. Objects inside it are kept, since they may cast a shadow
#: into the view: emitters of the shipped sensors are up to 75 mm beside the lens.
_BESIDE = 0.16
#: Nearest depth of a room, m, where the emitter's z-buffer starts.
_NEAREST_M = 0.3


def tilted(view: Floats, tilt_deg: float) -> Floats:
    """Tilt an object's view matrix for a camera that looks up; its position in the image stays."""
    if tilt_deg == 0.0:
        return view
    c, s = np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    matrix = view.astype(np.float64)
    matrix[:3, :3] = product(turn, matrix[:3, :3])
    return matrix.astype(np.float32)


def camera_place(face_camera_mm: Sequence[float], eye_mm: float, tilt_deg: float) -> Points:
    """Return the camera's position, (3,) mm in room axes, from a face's in camera axes."""
    face = product(_rotation(tilt_deg).T, np.asarray(face_camera_mm, np.float64))
    return np.asarray(np.array([0.0, eye_mm, 0.0]) - face)


#: Largest tilt of the camera, degrees. Chosen: the range of a stand.
_MAX_TILT_DEG = 40.0


def camera_tilt_deg(face_camera_mm: Sequence[float], above_mm: float) -> float:
    """Compute the upward tilt, degrees, of a camera that sees a face ``above_mm`` higher."""
    _, y, z = face_camera_mm
    sine = float(np.clip(above_mm / np.hypot(y, z), -1, 1))
    tilt = float(np.degrees(np.arcsin(sine) + np.arctan2(y, z)))
    return 0.0 if abs(tilt) < 1e-9 else float(np.clip(tilt, -_MAX_TILT_DEG, _MAX_TILT_DEG))


def room_view(camera_mm: Points, tilt_deg: float) -> Array:
    """Return the matrix (4, 4) from room axes, mm, to camera axes, m."""
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation(tilt_deg) / MM_PER_M
    matrix[:3, 3] = -product(matrix[:3, :3], camera_mm)
    return matrix


def _rotation(tilt_deg: float) -> Points:
    """Return the rotation (3, 3) from room axes (y up) to camera axes (y down, z forward)."""
    facing = tilted(to_mm(pose_matrix({})), tilt_deg)
    return np.asarray(np.round(facing[:3, :3].astype(np.float64), 7))


def visible_mesh(
    shapes: Sequence[Shape], view: Array, rig: SensorRig, factor: float = 1.0
) -> Mesh | None:
    """Join the visible part of shapes to one mesh; None if nothing is visible.

    The mesh is in canonical axes around the camera, mm: draw it with ``pose_matrix({})``. ``view``
    is the matrix from the shapes' mm to camera m. ``factor`` scales all albedos, up to 1.
    """
    points = np.concatenate([s.vertices_mm[s.faces] for s in shapes])
    albedo = np.concatenate([np.full(len(s.faces), min(1.0, factor * s.albedo)) for s in shapes])
    triangles = product(points, view[:3, :3].T) + view[:3, 3]
    keep = _towards(triangles, rig)
    triangles, albedo = triangles[keep], albedo[keep]
    for plane in _view_planes(FieldOfView.of(rig)):
        triangles, albedo = _cut(triangles, albedo, plane)
    if len(triangles) == 0:
        return None
    corners = triangles.reshape(-1, 3) * (1000.0, -1000.0, -1000.0)
    rows = np.column_stack([corners, np.repeat(albedo, 3)]).astype(np.float32)
    unique, index = np.unique(rows, axis=0, return_inverse=True)
    faces = without_slivers(index.reshape(-1, 3).astype(np.int32))
    if len(faces) == 0:
        return None
    return Mesh(np.ascontiguousarray(unique[:, :3]), faces, np.ascontiguousarray(unique[:, 3]))


def visible_part(mesh: Mesh, view: Floats, rig: SensorRig) -> Mesh | None:
    """Remove triangles that face away or lie outside of the view; None if no triangle is left.

    Triangles at the border of the view are not cut. All arrays are new. ``view`` is the matrix
    from the mesh's mm to camera m.
    """
    points = product(mesh.vertices_mm, view[:3, :3].T) + view[:3, 3]
    triangles = points[mesh.faces].astype(np.float64)
    keep = _towards(triangles, rig)
    for normal, offset in _view_planes(FieldOfView.of(rig)):
        keep &= (product(triangles, normal) >= offset).any(axis=1)
    if not keep.any() or float(triangles[keep][..., 2].min()) < _NEAREST_M:
        return None
    used, index = np.unique(mesh.faces[keep], return_inverse=True)
    albedo = None if mesh.albedo is None else mesh.albedo[used]
    strands = None if mesh.strands is None else mesh.strands[used]
    folds = None if mesh.folds is None else mesh.folds[used]
    faces = index.reshape(-1, 3).astype(np.int32)
    return Mesh(mesh.vertices_mm[used], faces, albedo, strands=strands, folds=folds)


def _towards(triangles: Points, rig: SensorRig) -> Mask:
    """Mark the triangles, (T, 3, 3) m, that face a camera or an emitter, (T,)."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    towards = np.zeros(len(triangles), bool)
    for eye in ((0.0, 0.0, 0.0), *(e.position_m for e in rig.emitters)):
        towards |= np.einsum("ij,ij->i", normal, triangles[:, 0] - np.asarray(eye)) < 0
    real = np.linalg.norm(normal, axis=1) > 1e-9  # m^2: a square of 0.03 mm
    return np.asarray(towards & real)


def _view_planes(sight: FieldOfView) -> list[tuple[Points, float]]:
    """Return the planes (normal, offset) of the view: points p inside have normal . p >= offset."""
    columns, rows, rig = sight.columns, sight.rows, sight.rig
    if rig.registered is not None:  # the colour camera sees more beside it, from 0.5 m on
        image = Rect(0, 0, rig.delivered.width, rig.delivered.height)
        seen = [rig.registered.corner_points(image, z_m) for z_m in (0.5, rig.far_m)]
        ends = np.concatenate(seen)
        columns = np.append(columns, ends[:, 0] / ends[:, 2])
        rows = np.append(rows, ends[:, 1] / ends[:, 2])
    left, right = columns.min() - _BESIDE, columns.max() + _BESIDE
    top, bottom = rows.min() - _BESIDE, rows.max() + _BESIDE
    return [
        (np.array([0.0, 0.0, 1.0]), _NEAREST_M),
        (np.array([1.0, 0.0, -left]), 0.0),
        (np.array([-1.0, 0.0, right]), 0.0),
        (np.array([0.0, 1.0, -top]), 0.0),
        (np.array([0.0, -1.0, bottom]), 0.0),
        (np.array([0.0, 0.0, -1.0]), -rig.far_m),
    ]


def _cut(triangles: Points, albedo: Points, plane: tuple[Points, float]) -> tuple[Points, Points]:
    """Clip triangles (T, 3, 3) and their albedos (T,) at a plane; return the inner pieces."""
    normal, offset = plane
    side = product(triangles, normal) - offset
    inside = side >= 0
    count = inside.sum(axis=1)
    kept, values = [triangles[count == 3]], [albedo[count == 3]]
    for corners in (1, 2):
        some = count == corners
        if not some.any():
            continue
        odd = np.argmax(inside[some] if corners == 1 else ~inside[some], axis=1)
        order = (odd[:, None] + np.arange(3)) % 3  # the lone corner comes first
        p = np.take_along_axis(triangles[some], order[..., None], axis=1)
        d = np.take_along_axis(side[some], order, axis=1)
        ends = []
        for n in (1, 2):
            # Cut from the inner to the outer corner, so that neighbours share the cut point.
            a, b = (0, n) if corners == 1 else (n, 0)
            share = (d[:, a] / (d[:, a] - d[:, b]))[:, None]
            ends.append(p[:, a] + share * (p[:, b] - p[:, a]))
        if corners == 1:
            kept.append(np.stack([p[:, 0], ends[0], ends[1]], axis=1))
        else:
            kept.append(np.stack([ends[0], p[:, 1], p[:, 2]], axis=1))
            kept.append(np.stack([ends[0], p[:, 2], ends[1]], axis=1))
        values += [albedo[some]] * corners
    return np.concatenate(kept), np.concatenate(values)
