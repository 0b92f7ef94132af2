"""Normals of vertices, which heads, people, cloth and beards share, and fewer triangles."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import trimesh

from glsim.core.mesh import reduced, vertex_normals


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


def test_meshes_that_two_threads_reduce_do_not_mix() -> None:
    """A batch loads faces in a thread, and the library keeps its mesh in global variables."""
    spheres = [trimesh.creation.icosphere(subdivisions=5, radius=r) for r in (90.0, 120.0)]
    meshes = [(sphere.vertices, sphere.faces, 0.3) for sphere in spheres]
    alone = [reduced(*mesh) for mesh in meshes]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(reduced, *zip(*(meshes * 4), strict=True)))
    for number, arrays in enumerate(together):
        for expected, actual in zip(alone[number % 2], arrays, strict=True):
            np.testing.assert_array_equal(actual, expected)
