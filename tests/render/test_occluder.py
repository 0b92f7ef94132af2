"""Fewer triangles cast the shadow: their number, their error, and who uses them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import moderngl
import numpy as np
import pytest

from glsim.core.mesh import KEPT_SHARE, Mesh, occluder_of
from glsim.faces.base import Face
from glsim.faces.sources.procedural import ProceduralFaces
from glsim.render.renderer import Renderer
from tests.support.scenes import face_mesh, layers_of, rectangle, rig, sheet

POSE = {"distance_mm": 900.0, "yaw_deg": 15.0}


@pytest.fixture(scope="module")
def heads() -> list[Mesh]:
    """Embedded heads of four people, the last frame of a sequence each: with an expression."""
    source = ProceduralFaces(3)
    keys = [source.frames(subject, 15)[14] for subject in source.subjects(4)]
    return [face.mesh for face in source.load(keys) if isinstance(face, Face)]


def test_the_occluder_is_a_share_of_the_triangles_of_the_same_vertices() -> None:
    mesh = face_mesh()
    occluder = occluder_of(mesh.vertices_mm, mesh.faces)
    assert occluder.dtype == np.int32
    assert len(occluder) == pytest.approx(KEPT_SHARE * len(mesh.faces), rel=0.01)
    assert 0 <= occluder.min() <= occluder.max() < len(mesh.vertices_mm)
    a, b, c = occluder.T
    assert ((a != b) & (b != c) & (c != a)).all()
    np.testing.assert_array_equal(occluder, occluder_of(mesh.vertices_mm, mesh.faces))


def test_the_surface_that_an_emitter_sees_hardly_moves(
    context: moderngl.Context, heads: list[Mesh]
) -> None:
    """The bounds are twice what the docs quote, which is measured on more faces."""
    renderer = Renderer(context, rig((0.049, 0, 0)))
    moved = []
    for mesh in heads:
        assert mesh.occluder is not None
        whole = layers_of(context, renderer, [(mesh, POSE)])["clean"]
        less = layers_of(context, renderer, [(replace(mesh, faces=mesh.occluder), POSE)])["clean"]
        both = (whole > 0) & (less > 0)
        assert ((whole > 0) != (less > 0)).sum() < 0.005 * both.sum()
        moved.append(1000 * np.abs(whole - less)[both])
    errors_mm = np.concatenate(moved)
    assert np.percentile(errors_mm, 50) < 0.05
    assert np.percentile(errors_mm, 99) < 0.6


def test_the_light_on_a_face_is_nearly_that_of_all_its_triangles(
    context: moderngl.Context, heads: list[Mesh]
) -> None:
    renderer = Renderer(context, rig((0.15, 0, 0)))
    for mesh in heads:
        found = layers_of(context, renderer, [(mesh, POSE)])
        exact = layers_of(context, renderer, [(replace(mesh, occluder=None), POSE)])
        np.testing.assert_array_equal(found["clean"], exact["clean"])
        seen = exact["clean"] > 0
        dark = (exact["lit"] < 0.5) & seen
        assert dark.sum() > 50, "there is a shadow to compare"
        other = ((found["lit"] < 0.5) != (exact["lit"] < 0.5)) & seen
        assert other.sum() < 0.003 * seen.sum()


def test_the_occluder_casts_no_spots_on_the_face_itself(context: moderngl.Context) -> None:
    """Where it spans a concave place it rises above the skin: a black spot between the brows."""
    source = ProceduralFaces(1)
    keys = [source.frames(subject, 30)[0] for subject in source.subjects(30)]
    renderer = Renderer(context, rig((0.075, 0, 0), (-0.075, 0, 0)))
    spotted = 0
    for number, face in enumerate(source.load(keys)):
        assert isinstance(face, Face)
        pose = {"distance_mm": 550.0 + 10 * number, "yaw_deg": 2.0 * (number - 15)}
        found = layers_of(context, renderer, [(face.mesh, pose)])["lit"]
        exact = layers_of(context, renderer, [(replace(face.mesh, occluder=None), pose)])["lit"]
        _, spots = cv2.connectedComponents(((found < 0.3) & (exact > 0.7)).astype(np.uint8))
        spotted += int((np.bincount(spots.ravel())[1:] >= 4).any())
    assert spotted <= 1


def test_the_occluder_alone_casts_the_shadow(context: moderngl.Context) -> None:
    """A plate whose occluder is its upper half casts half of its shadow on a wall."""
    plate = sheet(lambda x, _: np.full_like(x, 0.9), (-0.1, 0.1), (-0.12, 0.12), cells=2)
    wall = rectangle((-5, 5), (-5, 5), 1.5)
    renderer = Renderer(context, rig((0.075, 0, 0)))

    def dark(mesh: Mesh) -> int:
        return int((layers_of(context, renderer, [mesh, wall])["lit"] < 0.5).sum())

    whole = dark(plate)
    middle_mm = plate.vertices_mm[plate.faces, 1].mean(axis=1)
    half = replace(plate, occluder=plate.faces[middle_mm > 0])
    assert whole > 500
    assert dark(half) == pytest.approx(0.5 * whole, rel=0.05)
    # The same triangles with another occluder, or none, are another entry of the cache.
    assert dark(plate) == whole
    assert dark(replace(plate, occluder=plate.faces)) == whole
