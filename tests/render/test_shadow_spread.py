"""Soft shadows of an emitter that extends along the baseline."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.core import depth_map
from glsim.core.camera import Emitter, SensorRig
from tests.support.scenes import V2, layers_of, rectangle

BASELINE_M, SPREAD_M, FRONT_M = 0.045, 0.015, 0.9


def lit_row(
    context: moderngl.Context, spread_m: float, wall_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``lit`` along the middle row behind a board, by the shader and by marching."""
    rig = SensorRig(V2, (Emitter((BASELINE_M, 0.0, 0.0), spread_m),))
    board = rectangle((0, 0.2), (-0.2, 0.2), FRONT_M)
    layers = layers_of(context, rig, [board, rectangle((-4, 4), (-4, 4), wall_m)])
    return layers["lit"][205], depth_map.lit_by_marching(layers["clean"], rig)[205]


def width_px(baseline_m: float, wall_m: float) -> float:
    """Width of a point's shadow: b f (1 / z_front - 1 / z_wall)."""
    return baseline_m * V2.fx * (1 / FRONT_M - 1 / wall_m)


@pytest.mark.parametrize("wall_m", [1.1, 1.5, 2.0])
def test_the_shadow_has_steps_where_each_point_of_the_emitter_goes(
    context: moderngl.Context, wall_m: float
) -> None:
    for row in lit_row(context, SPREAD_M, wall_m):
        # The shares count the pixels that two, one and none of the three points reach.
        assert (1 - row).sum() == pytest.approx(width_px(BASELINE_M, wall_m), abs=0.6)
        nearest = width_px(BASELINE_M - SPREAD_M, wall_m)
        assert (row < 0.2).sum() == pytest.approx(nearest, abs=1.1)
        farthest = width_px(BASELINE_M + SPREAD_M, wall_m)
        assert (row < 0.9).sum() == pytest.approx(farthest, abs=1.1)
        levels = row[(row > 0.05) & (row < 0.95)]
        assert len(levels) >= 1, "there is a penumbra"


def test_a_point_makes_a_hard_shadow(context: moderngl.Context) -> None:
    row, marched = lit_row(context, 0.0, 1.5)
    assert ((row > 0.05) & (row < 0.95)).sum() <= 1, "only the pixel that the edge crosses"
    assert set(np.unique(marched)) == {0.0, 1.0}


def test_ends_lie_along_the_baseline() -> None:
    along_y = Emitter((0.0, 0.05, 0.0), 0.01)
    assert along_y.end_m == pytest.approx((0.0, 0.01))
    points, shares = zip(*along_y.shared_points_m(), strict=True)
    np.testing.assert_allclose(points, [[0, 0.04, 0], [0, 0.05, 0], [0, 0.06, 0]])
    assert sum(shares) == pytest.approx(1.0)
    assert len(Emitter((0.0, 0.05, 0.0)).shared_points_m()) == 1
