"""Surfaces for views from aside: whole where the sensor saw them, cut at jumps, without teeth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from glsim.core.camera import SensorRig
from glsim.core.depth_map import surface
from glsim.eval.report.figures.cut_surface import cut_surface
from tests.support.eval_scenes import CAMERA, Array

RIG = SensorRig(CAMERA)


def slope(angle_deg: float) -> Array:
    """A plane at 900 mm in its first column, seen at about this angle of incidence."""
    step = math.tan(math.radians(angle_deg)) * 900 / CAMERA.fx
    row = 900 + step * np.arange(12, dtype=np.float32)
    return np.tile(row, (CAMERA.height, 1)).astype(np.float32)


def placed(depth: Array) -> Array:
    """The map in the middle of an empty image."""
    whole = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    whole[:, 10 : 10 + depth.shape[1]] = depth
    return whole


@pytest.mark.parametrize("angle_deg", [0.0, 45.0, 65.0])
def test_slopes_that_the_sensor_sees_stay_whole(angle_deg: float) -> None:
    mesh = cut_surface(placed(slope(angle_deg)), RIG)
    assert mesh is not None
    assert len(mesh.faces) == 2 * 11 * (CAMERA.height - 1)


def test_a_cheek_and_an_ear_are_not_bridged() -> None:
    """A jump of 50 mm: shadows need the bridge, views from aside must not show it."""
    steps = np.full((CAMERA.height, 12), 900, np.float32)
    steps[:, 6:] = 950
    depth = placed(steps)
    whole = surface(depth / np.float32(1000), RIG)
    mesh = cut_surface(depth, RIG)
    assert whole is not None
    assert mesh is not None
    assert len(whole.faces) - len(mesh.faces) == 2 * (CAMERA.height - 1)
    z = -mesh.vertices_mm[:, 2][mesh.faces]
    assert np.ptp(z, axis=1).max() < 1


def test_rims_have_no_teeth_and_noise_tears_no_holes() -> None:
    """A single deep pixel at the rim goes; one of the same depth inside the surface stays."""
    flat = np.full((CAMERA.height, 12), 900, np.float32)
    flat[20, 5] += 15  # 79 degrees from one pixel to the next
    inside = cut_surface(placed(flat), RIG)
    assert inside is not None
    assert len(inside.faces) == 2 * 11 * (CAMERA.height - 1)
    flat[20, 5] = 900
    flat[10:30, 11] += 15
    rim = cut_surface(placed(flat), RIG)
    assert rim is not None
    assert len(inside.faces) - len(rim.faces) >= 2 * 19


def test_nothing_is_no_surface() -> None:
    assert cut_surface(placed(np.zeros((CAMERA.height, 12), np.float32)), RIG) is None
    alone = np.zeros((CAMERA.height, 12), np.float32)
    alone[20, 5] = 900
    assert cut_surface(placed(alone), RIG) is None
