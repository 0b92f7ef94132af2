"""Normals of vertices, which heads, people, cloth and beards share."""

from __future__ import annotations

import numpy as np
import trimesh

from glsim.core.mesh import vertex_normals


def test_normals_of_a_sphere_point_outwards() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=90.0)
    points = np.asarray(sphere.vertices)
    normals = vertex_normals(points, np.asarray(sphere.faces))
    cosines = (normals * points / 90.0).sum(axis=1)
    assert cosines.min() > np.cos(np.radians(1.0))


def test_large_triangles_count_more() -> None:
    """At the origin meet a triangle of 6 mm^2 in the plane z = 0 and one of 1.5 mm^2 in y = 0."""
    points = np.array([[0, 0, 0], [4, 0, 0], [0, 3, 0], [0, 0, 3], [1, 0, 0], [9, 9, 9]], float)
    triangles = np.array([[0, 1, 2], [0, 3, 4]])
    normals = vertex_normals(points, triangles)
    np.testing.assert_allclose(normals[0], np.array([0.0, 1.5, 6.0]) / np.hypot(1.5, 6.0))
    np.testing.assert_allclose(normals[1:5], [[0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 1, 0]])
    assert not normals[5].any()  # no triangle is there
