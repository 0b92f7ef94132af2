"""Depth edges, silhouettes and shadows of the time-of-flight sensor."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.geometry.mesh import Mesh
from glsim.geometry.pose import pose_matrix
from glsim.reason import Reason
from tests.support.tof_harness import QUIET, Camera, Image, Placed, merged, quad

OFF = {"tof_bilateral": {"enabled": 0.0}, "tof_edge": {"enabled": 0.0}}
ROWS = slice(120, 300)
FOCAL, CENTRE = 365.456, 254.878


def edge(
    cam: Camera, near: float, far: float, filters: bool, albedo: float = 1.0
) -> dict[str, Image]:
    """Rows across a straight edge: near on the left, far on the right, both lit; slanted a little.

    The edge runs from column 250 to 260, so that it meets pixels in all phases.
    """
    left = quad(near, (-9000, 0), albedo=albedo)
    left[1][:2, :2] = [[np.cos(0.03), -np.sin(0.03)], [-np.sin(0.03), -np.cos(0.03)]]
    return cam.shoot([left, quad(far)], {} if filters else OFF)


def counts(layers: dict[str, Image], near: float, far: float) -> tuple[float, float, float]:
    """Pixels per row: between the surfaces, outside both, and invalid."""
    depth = 1000 * layers["depth"][ROWS, 230:280]
    between = (depth > near + 20) & (depth < far - 20)
    outside = ((depth > far + 20) | (depth < near - 20)) & (depth > 0)
    return tuple(float(part.sum() / len(depth)) for part in (between, outside, depth == 0))


@pytest.mark.parametrize(
    ("far", "filters", "between", "outside", "invalid"),
    [
        (950.0, False, (0.05, 1.5), (0, 0), (0, 0.02)),
        (950.0, True, (0.1, 1.5), (0, 0), (0, 0.02)),
        (1500.0, False, (0.6, 2.1), (0, 0.1), (0, 0.5)),
        (1500.0, True, (0, 0.7), (0, 0.1), (1.2, 2.4)),
        (2000.0, False, (0, 0.1), (0.2, 1.1), (0, 1.7)),
    ],
)
def test_mixed_pixels_are_sums_of_phasors(
    context: moderngl.Context,
    far: float,
    filters: bool,
    between: tuple[float, float],
    outside: tuple[float, float],
    invalid: tuple[float, float],
) -> None:
    """A step of 0.6 m blends; one of 1.1 m, more than half a fast cycle, lands outside."""
    found = counts(edge(Camera.open(context), 900.0, far, filters), 900.0, far)
    for value, (low, high) in zip(found, (between, outside, invalid), strict=True):
        assert low <= value <= high, found


def test_what_the_filters_remove_says_why(context: moderngl.Context) -> None:
    layers = edge(Camera.open(context), 900.0, 1500.0, filters=True)
    lost = layers["depth"][ROWS, 230:280] == 0
    codes = layers["reason"][ROWS, 230:280][lost]
    assert set(np.unique(codes)) <= {Reason.EDGE, Reason.MIXED, Reason.UNWRAP}
    assert {Reason.MIXED} <= set(np.unique(codes))


def test_a_small_step_is_left_alone(context: moderngl.Context) -> None:
    """Within a face: the edge filter never fires below its 100 mm."""
    layers = edge(Camera.open(context), 900.0, 940.0, filters=True, albedo=0.6)
    assert (layers["depth"][ROWS, 230:280] > 0).all()


def test_silhouettes_before_nothing_grow_and_stay_in_place(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    scene = [quad(900.0, (-100, 100), (-100, 100), albedo=0.6)]
    layers = cam.shoot(scene, merged(QUIET, OFF))
    clean, depth = layers["clean"] > 0, layers["depth"]
    assert (depth[clean] > 0).all()
    grown = (depth > 0) & ~clean
    assert (layers["reason"][grown] == Reason.GROWN).all()
    rim = 2 * (clean.any(axis=0).sum() + clean.any(axis=1).sum())
    assert 0.3 < grown.sum() / rim < 2.3
    assert np.abs(1000 * depth[depth > 0] - 900).max() < 2  # the halo's light comes from aside
    noisy = cam.shoot(scene)
    assert (noisy["depth"] > 0)[clean].mean() > 0.995
    assert 0.3 < ((noisy["depth"] > 0) & ~clean).sum() / rim < 2.3


@pytest.mark.parametrize(("far", "width"), [(1100.0, 3.3), (1500.0, 7.3), (2000.0, 10.1)])
def test_shadows_are_as_wide_as_geometry_says(
    context: moderngl.Context, far: float, width: float
) -> None:
    """B f (1 / near - 1 / far) beside the occluder, on the side away from the emitter only."""
    cam = Camera.open(context)
    half = 40 * 900 / FOCAL
    layers = cam.shoot([quad(900.0, (-half, half), (-half, half)), quad(far)])
    lit, near = layers["lit"], layers["clean"] < 0.95
    row = lit[205]
    behind = ~near[205]
    left, right = (
        row[: int(CENTRE)][behind[: int(CENTRE)]],
        row[int(CENTRE) :][behind[int(CENTRE) :]],
    )
    assert (1 - left).sum() == pytest.approx(width, abs=1.0)
    assert (1 - right).sum() < 0.1
    column = lit[:, int(CENTRE)][~near[:, int(CENTRE)]]
    assert (1 - column).sum() < 1.0, "at most the pixel that the edge itself runs through"
    if far > 1500:  # the emitter's 10 mm are less than a pixel before nearer walls
        assert ((left > 0.2) & (left < 0.8)).any(), "a penumbra"
    middle = lit[205] == 0
    assert np.isin(layers["reason"][205][middle & (layers["depth"][205] == 0)],
                   [Reason.SHADOW, Reason.MIXED, Reason.EDGE, Reason.UNWRAP]).all()  # fmt: skip


def test_without_offset_there_is_no_shadow(context: moderngl.Context) -> None:
    cam = Camera.open(context, "kinect-v2-fast", emitter=[{"position_m": [0.0, 0.0, 0.001]}])
    scene = [quad(900.0, (-50, 50), (-50, 50)), quad(2000.0)]
    lit = cam.shoot(scene, {"tof_shadow": {"spread_mm": 0.0}})["lit"]
    assert (lit == 1).all()


def test_an_edge_is_where_it_is(context: moderngl.Context) -> None:
    """The standard deviation of the edge's position along its rows is about 1/3 px."""
    layers = edge(Camera.open(context), 900.0, 1500.0, filters=True)
    near = (layers["depth"] > 0) & (layers["depth"] < 1.0)
    place = near[ROWS].sum(axis=1).astype(float)
    rows = np.arange(len(place))
    place -= np.polyval(np.polyfit(rows, place, 1), rows)
    assert 0.2 < place.std() < 0.8


def round_head(z_mm: float, half_mm: float) -> Placed:
    """An upright elliptic cylinder of skin, 190 mm deep, with its axis at ``z_mm``."""
    angle = np.radians(np.linspace(-110, 110, 111))
    ends = [
        np.stack([half_mm * np.sin(angle), np.full(111, y), 95 * np.cos(angle)], axis=-1)
        for y in (-150.0, 150.0)
    ]
    low = np.arange(110)
    high = low + 111
    faces = np.concatenate([
        np.stack([low, low + 1, high + 1], axis=-1), np.stack([low, high + 1, high], axis=-1)
    ])  # fmt: skip
    mesh = Mesh(
        np.concatenate(ends).astype(np.float32),
        faces.astype(np.int32),
        np.full(222, 0.55, np.float32),
    )
    return mesh, pose_matrix({"distance_mm": z_mm})


@pytest.mark.parametrize(("near_m", "wall_m"), [(0.9, 1.5), (1.1, 2.0), (1.2, 1.8), (1.0, 2.2)])
def test_silhouettes_before_walls_are_those_of_real_frames(
    context: moderngl.Context, near_m: float, wall_m: float
) -> None:
    """Width without depth of wall or head: 1.1 px + 35 mm S in the shadow, 2.2 px on the lit side.

    S = f (1 / near - 1 / wall). In real frames 35 to 50 % of the 8 px on each side are invalid, and
    4 to 10 % lie behind the wall.
    """
    cam = Camera.open(context)
    shadow, bright, behind, invalid, band = [], [], 0, 0, 0
    for seed in range(3):
        head = round_head(1000 * near_m, 75 + seed)  # edges in all phases of a pixel
        depth = cam.shoot([head, quad(1000 * wall_m, albedo=0.8)], seed=seed)["depth"]
        seen, wall = np.abs(depth - near_m) < 0.12, np.abs(depth - wall_m) < 0.03
        for row in range(165, 245):
            columns = np.flatnonzero(seen[row])
            left, right = int(columns.min()), int(columns.max())
            shadow.append(left - np.flatnonzero(wall[row, :left]).max() - 1)
            bright.append(np.flatnonzero(wall[row, right:]).min() - 1)
            sides = np.r_[depth[row, left - 8 : left], depth[row, right + 1 : right + 9]]
            behind, band = behind + (sides > wall_m + 0.03).sum(), band + len(sides)
            invalid += (sides == 0).sum()
    expected = 1.1 + 0.035 * FOCAL * (1 / near_m - 1 / wall_m)
    assert np.mean(shadow) == pytest.approx(expected, abs=1.0)
    assert np.mean(bright) == pytest.approx(2.2, abs=1.0)
    assert 0.01 < behind / band < 0.15  # both depend on the wall's light
    assert 0.3 < invalid / band < 0.55
