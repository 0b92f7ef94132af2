"""Dark and thin things: closed shapes on the floor, dark enough to be lost, cables that hang."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from glsim.scene.dark_things import bag, cable, cables_behind, loudspeaker, piano, telephone
from glsim.scene.decoration import plant
from glsim.scene.materials import ALBEDOS
from glsim.scene.room import RoomNumbers, build_room
from glsim.scene.shapes import Shape, bounds_mm

Maker = Callable[[np.random.Generator], list[Shape]]


@pytest.mark.parametrize(
    ("maker", "least_mm", "most_mm"),
    [
        (loudspeaker, (170, 740, 230), (270, 1110, 360)),
        (bag, (260, 390, 180), (400, 540, 420)),
        (piano, (1470, 1090, 500), (1490, 1320, 700)),
        (telephone, (70, 8, 150), (180, 12, 250)),
    ],
)
def test_a_dark_thing_stands_on_the_floor_and_is_dark(
    maker: Maker, least_mm: tuple[int, ...], most_mm: tuple[int, ...]
) -> None:
    for seed in range(8):
        shapes = maker(np.random.default_rng(seed))
        low, high = bounds_mm(shapes)
        assert low[1] == pytest.approx(0, abs=1)
        assert (high - low >= least_mm).all()
        assert (high - low <= most_mm).all()
        largest = max(shapes, key=lambda shape: np.ptp(shape.vertices_mm, axis=0).prod())
        assert largest.albedo <= ALBEDOS["leather"][1]


def test_a_cable_is_thin_and_hangs_between_its_ends() -> None:
    shapes = cable(np.random.default_rng(1), (0, 700, 0), (400, 700, 0), slack_mm=100)
    low, high = bounds_mm(shapes)
    assert low[1] == pytest.approx(600, abs=10)
    assert high[0] - low[0] == pytest.approx(400, abs=10)
    for piece in shapes:
        across = np.linalg.svd(piece.vertices_mm - piece.vertices_mm.mean(0), compute_uv=False)
        assert across[2] < 8
    on_floor = cable(np.random.default_rng(1), (0, 50, 0), (900, 50, 0), slack_mm=300)
    assert -2 < bounds_mm(on_floor)[0][1] < 5


def test_cables_of_a_table_reach_the_floor_behind_it() -> None:
    low, high = bounds_mm(cables_behind(np.random.default_rng(2), 3, 1600.0, -350.0, 740.0))
    assert low[1] == pytest.approx(0, abs=5)
    assert high[1] == pytest.approx(740, abs=6)
    assert low[2] > -370


def test_a_quarter_of_the_plants_have_leaves_thinner_than_a_pixel() -> None:
    """5 to 12 mm wide; a pixel of a Kinect V2 sees 5.5 mm at 2 m."""
    thin = 0
    for seed in range(60):
        leaves = [s for s in plant(np.random.default_rng(seed), 900.0) if len(s.vertices_mm) == 18]
        # The middle row of a leaf is nearly as wide as the leaf.
        widths = [np.linalg.norm(leaf.vertices_mm[6] - leaf.vertices_mm[8]) for leaf in leaves]
        thin += float(np.median(widths)) < 14
    assert 7 <= thin <= 24  # 15 expected, 3.4 standard deviations


def test_rooms_hold_dark_things_and_cables() -> None:
    """In 24 furnished rooms of each kind lacquer and cables occur; in empty ones never."""
    for kind, expected in (("office", True), ("living-room", True), ("empty", False)):
        found = 0
        for seed in range(24):
            room = build_room(
                RoomNumbers(
                    kind=kind,
                    seed=seed,
                    behind_mm=2500.0,
                    width_mm=4500.0,
                    height_mm=2500.0,
                    turn_deg=0.0,
                    clutter=1.0,
                    people=0,
                    seat_mm=None,
                    camera_mm=(0.0, 1500.0),
                    reach_mm=(0.0, 0.0, 0.0),
                )
            )
            found += any(
                s.region == "furniture" and s.albedo <= ALBEDOS["lacquer"][1] for s in room.shapes
            )
        assert (found > 0) == expected, kind
