"""Rooms: pure functions of their numbers, and nothing on the way from the camera to the person."""

from dataclasses import replace

import numpy as np
import pytest

from glsim.looks.room.room import RoomNumbers, build_room
from glsim.looks.shapes import bounds_mm

NUMBERS = RoomNumbers(
    kind="office", seed=5, behind_mm=2000.0, width_mm=4000.0, height_mm=2500.0, turn_deg=25.0,
    clutter=1.0, people=2, seat_mm=None, camera_mm=(0.0, 1500.0), reach_mm=(-100.0, 150.0, 300.0),
)  # fmt: skip
KINDS = ("empty", "office", "living-room")


@pytest.mark.parametrize("kind", KINDS)
def test_a_room_has_a_shell_and_few_triangles(kind: str) -> None:
    for seed in range(4):
        shapes, _ = build_room(replace(NUMBERS, kind=kind, seed=seed))
        regions = {shape.region for shape in shapes}
        assert {"wall", "floor", "ceiling"} <= regions
        assert sum(len(shape.faces) for shape in shapes) < 30_000
        low, high = bounds_mm(shapes)
        assert low[1] > -1
        assert high[1] == pytest.approx(2500)
        assert ("furniture" in regions) or kind == "empty"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("distance_mm", [700.0, 3000.0])
def test_nothing_stands_between_the_camera_and_the_person(kind: str, distance_mm: float) -> None:
    """No triangle crosses the lines from the camera to the person's places, 150 mm around them."""
    eye = np.array([0.0, 1000.0, distance_mm])
    x, y, z = (a.ravel() for a in np.meshgrid((-250, 0, 300), (1100, 1400), (0, -300)))
    targets = np.stack([x, y, z], axis=1).astype(float)
    for seed in range(3):
        shapes, _ = build_room(replace(NUMBERS, kind=kind, seed=seed, camera_mm=(0.0, distance_mm)))
        triangles = np.concatenate([s.vertices_mm[s.faces] for s in shapes])
        for target in targets:
            assert not _hit(eye, target, triangles).any()
    through = np.array([[[-900, 0, 400], [900, 0, 400], [0, 3000, 400]]], float)
    assert _hit(eye, targets[0], through).any(), "the test would see a wall"


def _hit(start: np.ndarray, end: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Mark the (T, 3, 3) triangles that a line from start to end crosses (Moeller and Trumbore)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    way = end - start
    p = np.cross(way, c - a)
    scale = np.einsum("ij,ij->i", b - a, p)
    scale = np.where(np.abs(scale) < 1e-9, np.inf, scale)
    t = start - a
    u = np.einsum("ij,ij->i", t, p) / scale
    q = np.cross(t, b - a)
    v = q @ way / scale
    share = np.einsum("ij,ij->i", c - a, q) / scale
    return (u >= 0) & (v >= 0) & (u + v <= 1) & (share > 0) & (share < 1) & np.isfinite(scale)


def test_other_people_stand_behind_apart_and_inside() -> None:
    rooms = [build_room(replace(NUMBERS, kind="empty", seed=seed))[1] for seed in range(20)]
    places = [place for room in rooms for place in room]
    assert len(places) > 20
    for x, z, _ in places:
        assert z < -200
        assert 950 < np.hypot(x, z) < 3050
    for room in rooms:
        if len(room) == 2:
            (x, z, _), (u, v, _) = room
            assert np.hypot(x - u, z - v) > 690
