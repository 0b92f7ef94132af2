"""Light over a second surface bends concave corners outwards, and nothing else."""

from __future__ import annotations

import moderngl
import numpy as np

from tests.support.tof_harness import QUIET, Camera, Placed, merged, quad

ON = {"tof_multipath": {"enabled": 1.0}}


def corner() -> list[Placed]:
    """Two walls at a right angle, the corner 1.5 m away on the axis."""
    return [
        quad(1500.0, (0, 400), (-300, 300), yaw_deg=-45),
        quad(1500.0, (-400, 0), (-300, 300), yaw_deg=45),
    ]


def test_a_corner_is_bent(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    scene = corner()
    without, bent = cam.shoot(scene, QUIET), cam.shoot(scene, merged(QUIET, ON))
    inner = (without["depth"] > 0) & (bent["depth"] > 0)
    by_mm = 1000 * (bent["depth"] - without["depth"])[inner]
    assert 1.45 < without["depth"].max() < 1.55
    assert by_mm.min() > -0.2
    assert 3 < np.quantile(by_mm, 0.9) < 60
    assert (bent["infrared"] - without["infrared"])[inner].mean() > 0


def test_a_wall_and_a_ridge_stay(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    ridge = [
        quad(1200.0, (-400, 0), (-300, 300), yaw_deg=-45),
        quad(1200.0, (0, 400), (-300, 300), yaw_deg=45),
    ]
    for scene in ([quad(1200.0)], ridge):
        without, lit = cam.shoot(scene, QUIET), cam.shoot(scene, merged(QUIET, ON))
        both = (without["depth"] > 0) & (lit["depth"] > 0)
        apart = 1000 * np.abs(without["depth"] - lit["depth"])[both]
        assert np.quantile(apart, 0.99) < 0.05


def test_twin_agrees(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    drawn, computed = cam.shoot(corner(), ON), cam.twin(corner(), ON)
    one, other = drawn["depth"] > 0, computed["depth"] > 0
    assert (one == other).mean() >= 0.999
    apart = np.abs(drawn["depth"] - computed["depth"])[one & other]
    assert (apart <= 0.00101).mean() >= 0.999
