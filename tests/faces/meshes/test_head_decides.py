"""The head decides size and pose of a mesh, whatever its unit, tilt and surroundings."""

import math
import re
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.faces.meshes.alignment import Alignment, estimate_alignment, rotation
from glsim.faces.sources.procedural import ProceduralFaces
from tests.support.people import needs_anny


@cache
def head(number: int, lowest_mm: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return an embedded head without the triangles below a height, mm."""
    source = ProceduralFaces(seed=7)
    vertices, faces = source.neutral(source.subjects(4)[number])
    return vertices.astype(np.float64), faces[vertices[faces, 1].min(axis=1) > lowest_mm]


def tilt(axis: int, degrees: float) -> NDArray[np.float64]:
    return np.asarray(cv2.Rodrigues(np.eye(3)[axis] * math.radians(degrees))[0])


def align(vertices: NDArray[np.float64], faces: NDArray[np.int32], **given: str) -> Alignment:
    used = np.unique(faces)
    return estimate_alignment(vertices[used], np.searchsorted(used, faces), **given)


def off_upright_deg(alignment: Alignment, turn: NDArray[np.float64]) -> float:
    """Return the angle between a head that was turned by ``turn`` and upright, aligned again."""
    left = rotation(alignment.axes, alignment.rotation_deg) @ turn
    return math.degrees(math.acos(min(1.0, (np.trace(left) - 1) / 2)))


@pytest.mark.parametrize("lowest_mm", [-150.0, -999.0])  # a head, and one with its shoulders
def test_plain_heads_stay_and_raise_no_doubt(lowest_mm: float) -> None:
    for number in range(3):
        alignment = align(*head(number, lowest_mm))
        assert (alignment.unit, alignment.axes, alignment.doubts) == ("mm", "+x+y+z", ())
        assert alignment.rotation_deg == (0, 0, 0)


@pytest.mark.parametrize(("axis", "degrees"), [(0, 35.0), (1, 30.0), (2, -45.0), (0, -58.0)])
def test_tilted_heads_are_turned_upright(axis: int, degrees: float) -> None:
    vertices, faces = head(1, -150.0)
    turn = tilt(axis, degrees)
    alignment = align(vertices @ turn.T / 10, faces)
    assert (alignment.unit, alignment.doubts) == ("cm", ())
    assert off_upright_deg(alignment, turn) < 6
    plain, again = align(vertices, faces), alignment.apply(vertices @ turn.T / 10)
    assert np.linalg.norm(again - plain.apply(vertices), axis=1).max() < 25


def test_a_head_before_a_backdrop_keeps_its_size() -> None:
    vertices, faces = head(2, -150.0)
    far = vertices[:, 2].min() - 50
    wall = np.array([[-450, -300, far], [450, -300, far], [450, 600, far], [-450, 600, far]])
    behind = len(vertices) + np.array([[0, 1, 2], [0, 2, 3]])
    scene, all_faces = np.concatenate([vertices, wall]) / 1000, np.concatenate([faces, behind])
    for unit in ("auto", "m"):
        alignment = align(scene, all_faces, unit=unit)
        assert (alignment.unit, alignment.axes) == ("m", "+x+y+z")
        assert alignment.extent_mm == pytest.approx(900)
        assert abs(alignment.origin_mm[1] - align(vertices, faces).origin_mm[1]) < 1


def test_a_tilted_head_in_the_corner_of_a_room_of_many_triangles_is_found() -> None:
    vertices, faces = head(1, -150.0)
    across, up = np.meshgrid(np.linspace(-900, 900, 25), np.linspace(0, 1800, 25))
    cells = np.arange(24 * 25).reshape(24, 25)[:, :-1].ravel()[:, None]
    squares = np.concatenate([np.add(cells, [0, 1, 25]), np.add(cells, [1, 26, 25])])
    bottom, back = vertices[:, 1].min(), vertices[:, 2].min() - 150
    wall = np.stack([across, bottom + up, np.full_like(up, back)], axis=-1).reshape(-1, 3)
    floor = np.stack([across, np.full_like(up, bottom), back + up], axis=-1).reshape(-1, 3)
    turn = tilt(2, 40)
    scene = np.concatenate([vertices, wall, floor]) @ turn.T / 1000
    triangles = [faces, squares + len(vertices), squares + len(vertices) + len(wall)]
    alignment = align(scene, np.concatenate(triangles))
    assert (alignment.unit, alignment.doubts) == ("m", ())
    assert off_upright_deg(alignment, turn) < 6


@needs_anny
def test_people_are_read_back() -> None:
    from glsim.faces.sources.people import People

    source = People(seed=1)
    for subject in source.subjects(2):
        (face,) = source.load(source.frames(subject, 1))
        alignment = align(face.mesh.vertices_mm.astype(np.float64) / 1000, face.mesh.faces)
        assert (alignment.unit, alignment.axes) == ("m", "+x+y+z")
        assert np.abs(alignment.origin_mm[:2]).max() < 25


def test_feet_are_found_and_doubted_and_a_wrong_unit_is_answered() -> None:
    vertices, faces = head(3, -150.0)
    alignment = align(vertices / 304.8, faces)
    assert alignment.unit == "foot"
    assert "foot is found by the size of the face alone" in alignment.doubts[0]
    assert align(vertices / 304.8, faces, unit="foot").doubts == ()
    with pytest.raises(MeshError, match="times as large as a mean one") as caught:
        align(vertices / 110, faces, unit="m")
    hints = re.findall(r"unit='([^']+)'", str(caught.value))
    assert hints[-1] == "auto"
    assert all(align(vertices / 110, faces, unit=unit).axes == "+x+y+z" for unit in hints)
