"""The camera in a room: its place, its tilt, and the part of the room that it sees."""

from dataclasses import replace

import numpy as np
import pytest
from moderngl import Context

from glsim.core.camera import SensorRig
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.gl.targets import Readback
from glsim.looks.room.room import build_room
from glsim.looks.room.view import (
    camera_place,
    camera_tilt_deg,
    room_view,
    tilted,
    visible_mesh,
    visible_part,
)
from glsim.looks.shapes import box, plate
from glsim.render.renderer import Renderer
from tests.looks.test_room import NUMBERS
from tests.support.scenes import V2

FACE = (120.0, -80.0, 1400.0)  # camera mm


@pytest.mark.parametrize("tilt", [0.0, 20.0, -15.0])
def test_the_face_is_at_its_place_in_the_image_and_in_the_room(tilt: float) -> None:
    camera = camera_place(FACE, 1250.0, tilt)
    seen = room_view(camera, tilt) @ [0.0, 1250.0, 0.0, 1.0]
    np.testing.assert_allclose(seen[:3], np.array(FACE) / 1000, atol=1e-6)
    up = room_view(camera, tilt)[:3, :3] @ [0, 1000.0, 0]
    assert np.degrees(np.arctan2(up[2], -up[1])) == pytest.approx(tilt, abs=1e-4)


def test_the_camera_tilts_to_the_face() -> None:
    tilt = camera_tilt_deg(FACE, 300.0)
    assert camera_place(FACE, 1250.0, tilt)[1] == pytest.approx(950.0, abs=0.01)
    assert camera_tilt_deg((0, 0, 800), 0.0) == 0.0
    assert camera_tilt_deg((0, 0, 800), 5000.0) == 40.0


def test_an_upright_person_stays_upright_under_a_tilted_camera() -> None:
    view = tilted(pose_matrix({"distance_mm": 1400.0, "x_mm": 120.0, "y_mm": -80.0}), 20.0)
    camera = camera_place(FACE, 1250.0, 20.0)
    room = room_view(camera, 20.0)
    for point in ((0, 0, 0), (0, -1250, 0), (200, 100, 50)):
        person = view @ [*point, 1.0]
        there = room @ [point[0], point[1] + 1250.0, point[2], 1.0]
        np.testing.assert_allclose(person, there, atol=1e-4)


@pytest.mark.parametrize("kind", ["office", "living-room"])
def test_the_cut_room_looks_like_the_whole_one(context: Context, kind: str) -> None:
    rig = SensorRig(V2)
    camera = camera_place((0.0, 0.0, 1500.0), 1250.0, 8.0)
    view = room_view(camera, 8.0)
    shapes = build_room(replace(NUMBERS, kind=kind))[0]
    cut = visible_mesh(shapes, view, rig)
    assert cut is not None
    vertices = np.concatenate([s.vertices_mm for s in shapes]).astype(np.float32)
    starts = np.cumsum([0, *(len(s.vertices_mm) for s in shapes)])
    faces = [s.faces + start for s, start in zip(shapes, starts, strict=False)]
    albedo = np.concatenate([np.full(len(s.vertices_mm), s.albedo, np.float32) for s in shapes])
    whole = Mesh(vertices, np.concatenate(faces).astype(np.int32), albedo)
    renderer, readback = Renderer(context, rig), Readback(context)
    seen = []
    for mesh, matrix in ((whole, view.astype(np.float32)), (cut, pose_matrix({}))):
        with renderer.render([(mesh, matrix)]) as rendered:
            layers = {name: rendered.layers[name] for name in ("clean", "albedo")}
            readback.request(rendered.pool, layers, rendered.window)
        seen.append({name: array.copy() for name, array in readback.arrays().items()})
    assert len(cut.faces) < 0.6 * len(whole.faces)
    assert (seen[0]["clean"] > 0).all(), "no gap between walls, floor and ceiling"
    for name, tolerance in (("clean", 1e-3), ("albedo", 1e-4)):
        apart = np.abs(seen[0][name] - seen[1][name]) > tolerance
        assert apart.mean() < 2e-4, name  # edges are rounded


def test_what_is_out_of_view_is_left_out() -> None:
    rig = SensorRig(V2)
    view = room_view(np.array([0.0, 1000.0, 1000.0]), 0.0)
    behind = box((200, 200, 200), (0, 900, 3000))
    assert visible_mesh([behind], view, rig) is None
    beside = box((200, 200, 200), (5000, 900, 0))
    assert visible_mesh([beside], view, rig) is None
    away = plate([(0, 900, 0), (0, 1100, 0), (100, 900, 0)])  # its back is seen
    assert visible_mesh([away], view, rig) is None
    front = visible_mesh([box((200, 200, 200), (0, 900, 0), 0.5)], view, rig, 3.0)
    assert len(front.faces) == 2, "one side faces the camera"
    assert set(front.albedo) == {1.0}


def test_a_part_of_a_mesh_keeps_its_place() -> None:
    rig = SensorRig(V2)
    ball = box((300, 300, 300), edge_mm=140, cells=7)
    mesh = Mesh(ball.vertices_mm.astype(np.float32), ball.faces)
    view = pose_matrix({"distance_mm": 1500.0})
    part = visible_part(mesh, view, rig)
    assert 0.2 * len(mesh.faces) < len(part.faces) < 0.6 * len(mesh.faces)
    assert part.vertices_mm[:, 2].max() == mesh.vertices_mm[:, 2].max()
    assert visible_part(mesh, pose_matrix({"distance_mm": 1500.0, "x_mm": 9000}), rig) is None
