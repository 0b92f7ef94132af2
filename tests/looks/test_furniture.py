"""Shapes and furniture: closed, wound outwards, without slivers, of plausible size and albedo."""

import numpy as np
import pytest
import trimesh

from glsim.looks.room.furniture import catalogue, coat, curtain, make_seat, make_thing
from glsim.looks.shapes import Shape, bounds_mm, box, mirrored, rod, turned_body

CLOSED = {
    "box": (box((100, 200, 300)), 100 * 200 * 300, 1e-9),
    "bevelled box": (box((100, 200, 300), edge_mm=10), 100 * 200 * 300, 0.05),
    "cushion": (box((400, 100, 400), edge_mm=45, cells=7, plump_mm=15), 400 * 100 * 400, 0.25),
    "rod": (rod((0, 0, 0), (100, 200, 50), 10, sides=40), np.pi * 100 * np.sqrt(52_500), 0.01),
    "mirrored": (mirrored(rod((9, 0, 0), (9, 100, 0), 10, sides=4), 0), 2 * 100 * 100, 1e-6),
    "cone": (turned_body([(0, 0), (50, 0), (0, 90)], segments=90), np.pi * 2500 * 30, 0.01),
}
THINGS = catalogue()["things"]
ALBEDOS = catalogue()["albedos"]


def made(name: str, seed: int) -> list[Shape]:
    rng = np.random.default_rng(seed)
    if name == "curtain":
        return curtain(rng, 400, 2200, 30)
    return coat(rng) if name == "coat" else make_thing(rng, name, 1.0)


@pytest.mark.parametrize("name", CLOSED)
def test_a_solid_is_closed_wound_outwards_and_has_its_volume(name: str) -> None:
    shape, volume, tolerance = CLOSED[name]
    mesh = trimesh.Trimesh(shape.vertices_mm, shape.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume, rel=tolerance)


def test_a_turn_takes_the_front_to_the_right_and_a_lean_takes_the_top_back() -> None:
    front = Shape(np.array([[0.0, 0, 100]]), np.zeros((0, 3), np.int32))
    np.testing.assert_allclose(front.moved(1, 2, 3, turn_deg=90).vertices_mm, [(101, 2, 3)])
    top = Shape(np.array([[0.0, 100, 0]]), np.zeros((0, 3), np.int32))
    assert top.leaned(10).vertices_mm[0, 2] < -10


@pytest.mark.parametrize("name", [*THINGS, "curtain", "coat"])
def test_a_thing_is_drawn_stands_on_the_floor_and_has_no_sliver(name: str) -> None:
    sizes = set()
    for seed in range(4):
        shapes = made(name, seed)
        low, high = bounds_mm(shapes)
        sizes.add(tuple(high - low))
        assert -30 < low[1] < 70 or name == "coat"  # window sills, seats without feet
        assert (high - low < (2700, 2300, 1300)).all()
        assert sum(len(s.faces) for s in shapes) < 12_000
        for shape in shapes:
            assert 0 <= shape.albedo <= 1
            a, b, c = (shape.vertices_mm[shape.faces[:, n]] for n in range(3))
            area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
            assert area.min() > 1e-3, "mm^2"
        for one, again in zip(shapes, made(name, seed), strict=True):
            np.testing.assert_array_equal(one.vertices_mm, again.vertices_mm)
    assert len(sizes) == 4 or "stretch" not in THINGS.get(name, {})


def test_the_table_names_things_and_materials_that_it_has() -> None:
    for kind in catalogue()["rooms"].values():
        assert {name for shares in kind.values() for name in shares} <= set(THINGS)
    for thing in THINGS.values():
        for part in thing["parts"]:
            assert part.get("thing", "desk") in THINGS
            for material in part.get("of", "wood").split(":")[0].split("/"):
                assert material in ALBEDOS
    assert all(0 <= low < high <= 1 for low, high in ALBEDOS.values())
    assert max(ALBEDOS["screen"][1], ALBEDOS["glass"][1]) <= 0.02


def test_a_desk_has_a_screen_and_cables_that_hang_to_the_floor() -> None:
    shapes = made("desk", 5)
    assert any(s.region == "screen" for s in shapes)
    cables = [s for s in shapes if len(s.vertices_mm) == 96]  # 6 rods of 16 vertices
    assert cables
    for cable in cables:
        low, high = cable.vertices_mm.min(axis=0), cable.vertices_mm.max(axis=0)
        assert -6 < low[1] < 230
        assert high[1] > 700


@pytest.mark.parametrize("kind", ["office", "living-room", "empty"])
def test_a_seat_is_below_the_person(kind: str) -> None:
    for seed in range(4):
        shapes = make_seat(np.random.default_rng(seed), kind, (380.0, -150.0))
        low, high = bounds_mm(shapes)
        assert -0.5 < low[1] < 1
        assert low[0] < 0 < high[0]
        assert high[1] > 650
        points = np.concatenate([s.vertices_mm for s in shapes])
        middle = (np.abs(points[:, 0]) < 260) & (points[:, 2] > 0)
        assert points[middle, 1].max() == pytest.approx(385, abs=12)
