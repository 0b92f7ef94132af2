"""Shapes and furniture: closed, wound outwards, without slivers, of plausible size and albedo."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from glsim.scene import decoration, seating, storage, tables
from glsim.scene.materials import ALBEDOS
from glsim.scene.shapes import Shape, bounds_mm, box, moved, plate, rod, sheet, turned_body

CLOSED = {
    "box": (box((100, 200, 300)), 100 * 200 * 300, 1e-9),
    "bevelled box": (box((100, 200, 300), edge_mm=10), 100 * 200 * 300, 0.05),
    "cushion": (box((400, 100, 400), edge_mm=45, cells=7, plump_mm=15), 400 * 100 * 400, 0.25),
    "rod": (rod((0, 0, 0), (100, 200, 50), 10, sides=40), np.pi * 100 * np.sqrt(52_500), 0.01),
    "square rod": (rod((0, 0, 0), (0, 100, 0), 10, sides=4), 2 * 100 * 100, 1e-6),
    "cone": (turned_body([(0, 0), (50, 0), (0, 90)], segments=90), np.pi * 2500 * 30, 0.01),
}
MAKERS: dict[str, Callable[[np.random.Generator], list[Shape]]] = {
    "chair": seating.chair,
    "office chair": seating.office_chair,
    "sofa": seating.sofa,
    "desk": lambda rng: tables.desk(rng, 1.0),
    "low table": lambda rng: tables.low_table(rng, 1.0),
    "shelf": lambda rng: storage.shelf(rng, 1.0),
    "cabinet": storage.cabinet,
    "sideboard": lambda rng: storage.sideboard(rng, 1.0, with_television=rng.random() < 0.5),
    "bin": storage.waste_bin,
    "box": storage.moving_box,
    "plant": decoration.plant,
    "lamp": decoration.floor_lamp,
    "curtain": lambda rng: decoration.curtain(rng, 400, 2200, 30),
}


@pytest.mark.parametrize("name", CLOSED)
def test_a_solid_is_closed_wound_outwards_and_has_its_volume(name: str) -> None:
    shape, volume, tolerance = CLOSED[name]
    mesh = trimesh.Trimesh(shape.vertices_mm, shape.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume, rel=tolerance)


def test_a_turn_takes_the_front_to_the_right_and_a_lean_takes_the_top_back() -> None:
    front = plate([(0, 0, 100), (1, 0, 100), (0, 1, 100)])
    np.testing.assert_allclose(front.moved(turn_deg=90).vertices_mm[0], (100, 0, 0), atol=1e-9)
    top = plate([(0, 100, 0), (1, 100, 0), (0, 101, 0)])
    assert top.leaned(10).vertices_mm[0, 2] < -10
    np.testing.assert_allclose(moved([top], 1, 2, 3)[0].vertices_mm[0], (1, 102, 3))


def test_a_sheet_is_seen_from_both_sides() -> None:
    x, y = np.meshgrid(np.arange(3.0), np.arange(4.0))
    grid = np.stack([x, y, 0 * x], axis=-1)
    both, one = sheet(grid), sheet(grid, both=False)
    assert len(both.faces) == 2 * len(one.faces) == 24
    normals = trimesh.Trimesh(both.vertices_mm, both.faces, process=False).face_normals[:, 2]
    assert sorted(set(normals.round(6))) == [-1, 1]


@pytest.mark.parametrize("name", MAKERS)
def test_furniture_stands_on_the_floor_and_has_no_sliver(name: str) -> None:
    for seed in range(6):
        shapes = MAKERS[name](np.random.default_rng(seed))
        low, high = bounds_mm(shapes)
        assert -0.5 < low[1] < 40, "on the floor, or a curtain above it"
        assert (high - low < (2700, 2300, 1300)).all()
        assert high[1] > 60
        assert sum(len(s.faces) for s in shapes) < 12_000
        for shape in shapes:
            assert np.isfinite(shape.vertices_mm).all()
            assert 0 <= shape.albedo <= 1
            a, b, c = (shape.vertices_mm[shape.faces[:, n]] for n in range(3))
            area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
            assert area.min() > 1e-3, "mm^2"


def test_the_same_seed_makes_the_same_thing_and_another_one_another() -> None:
    for make in MAKERS.values():
        first, again, other = (make(np.random.default_rng(s)) for s in (1, 1, 2))
        assert all(
            (a.vertices_mm == b.vertices_mm).all() for a, b in zip(first, again, strict=True)
        )
        one, two = (np.subtract(*bounds_mm(shapes)) for shapes in (first, other))
        assert not np.allclose(one, two)


def test_albedos_are_ranges_and_screens_and_panes_return_nothing() -> None:
    assert all(0 <= low < high <= 1 for low, high in ALBEDOS.values())
    assert ALBEDOS["leaves"][0] >= 0.4
    assert max(ALBEDOS["screen"][1], ALBEDOS["glass"][1]) <= 0.02
    shapes = tables.desk(np.random.default_rng(0), 1.0)
    assert any(shape.region == "screen" for shape in shapes)
