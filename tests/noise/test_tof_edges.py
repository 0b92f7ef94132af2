"""Depth edges, silhouettes and shadows of the time-of-flight sensor."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.reason import Reason
from tests.support.tof_harness import QUIET, Camera, Image, merged, quad

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
        (1500.0, False, (0.6, 2.1), (0, 0.1), (0, 0.2)),
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
    assert np.abs(1000 * depth[depth > 0] - 900).max() < 1
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
