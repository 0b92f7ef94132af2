"""Landmarks, pose matrix and normals of rendered frames."""

from dataclasses import replace

import numpy as np
import pytest
from moderngl import Context

from glsim.core import depth_map
from glsim.core.errors import ConfigError
from glsim.faces.face_source import FaceSource, Topology
from glsim.faces.one_mesh import OneMesh
from glsim.faces.regions import landmark_vertices
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from tests.support.scenes import face_mesh, only_frame, settings_for

POSE = {"distance_mm": 900, "yaw_deg": 20, "pitch_deg": -5, "x_mm": 12}
LAYERS = ("clean", "noisy", "normals")
MESH = face_mesh()


class MarkedFace(OneMesh):
    """The analytic face with landmarks on vertices all over it, the last one behind its nose."""

    @property
    def topology(self) -> Topology:
        landmarks = np.linspace(0, len(MESH.vertices_mm) - 1, 68).astype(np.int64)
        return Topology(MESH.faces, landmarks=landmarks)


def frame_of(context: Context, source: FaceSource, crop: int | None = 200) -> Frame:
    output = {"crop": crop, "landmarks": True, "layers": LAYERS}
    settings = settings_for(pose=POSE, output=output)
    return only_frame(simulate(settings, sources=[source], context=context, layers=LAYERS))


def test_landmarks_lie_where_their_vertices_are_drawn(context: Context) -> None:
    frame = frame_of(context, MarkedFace(MESH))
    head_m = MESH.vertices_mm[MarkedFace(MESH).topology.landmarks] / 1000.0
    expected = head_m @ frame.head_to_camera[:3, :3].T + frame.head_to_camera[:3, 3]
    np.testing.assert_allclose(frame.landmarks.points_m, expected, atol=1e-6)
    np.testing.assert_allclose(frame.landmarks.pixels, frame.intrinsics.project(expected))
    rotation = frame.head_to_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-5)
    assert frame.head_to_camera[:3, 3] == pytest.approx([0.012, 0, 0.9], abs=1e-6)
    seen = frame.landmarks.visible
    assert 40 <= seen.sum() < 68  # some are on the far side of the turned face
    column, row = np.floor(frame.landmarks.pixels[seen]).astype(int).T
    depth_m = frame.clean[row, column] / 1000.0
    np.testing.assert_allclose(depth_m, frame.landmarks.points_m[seen, 2], atol=0.006)


def test_a_crop_moves_the_pixels_only(context: Context) -> None:
    whole, part = (frame_of(context, MarkedFace(MESH), crop) for crop in (None, 200))
    np.testing.assert_array_equal(whole.landmarks.points_m, part.landmarks.points_m)
    moved = whole.landmarks.pixels - part.landmarks.pixels
    shift = [whole.intrinsics.cx - part.intrinsics.cx, whole.intrinsics.cy - part.intrinsics.cy]
    np.testing.assert_allclose(moved, np.broadcast_to(shift, moved.shape), atol=1e-9)
    np.testing.assert_array_equal(whole.landmarks.visible, part.landmarks.visible)


def test_the_normals_are_those_of_the_surface(context: Context) -> None:
    frame = frame_of(context, MarkedFace(MESH))
    assert frame.normals.shape == (200, 200, 3)
    seen = frame.clean_m > 0
    assert ((frame.normals.any(axis=-1)) == (frame.clean > 0)).all()
    rays = frame.intrinsics.rays()[frame.window.slices]
    by_depth = depth_map.normals(frame.clean_m, rays)
    angle = np.degrees(np.arccos(np.clip((by_depth * frame.normal).sum(-1)[seen], -1, 1)))
    assert np.median(angle) < 2.0


def test_a_source_without_landmarks_says_so(context: Context) -> None:
    with pytest.raises(ConfigError, match=r"does not know the landmarks .* output\.landmarks"):
        landmark_vertices(OneMesh(MESH))
    without = replace(frame_of(context, MarkedFace(MESH)), normal=None)
    with pytest.raises(ConfigError, match="without the layer 'normals'"):
        _ = without.normals
