"""Gaps beside foregrounds, pixels between surfaces, and bands at the border, planted and real."""

import numpy as np
import pytest

from glsim.measures.disparity_steps import between_share, border_band, find_steps, measure_gaps
from glsim.measures.validity import flip_share, hole_share_beside_band
from tests.support.real_cameras import D435_ROBOT_PX_MM, needs_real_cameras, real_disparities

FAR_PX, NEAR_PX = 12.0, 30.0


def _scene(left_px: int, right_px: int, band_px: int = 0) -> np.ndarray:
    """A foreground of disparity 30 px before a wall of 12 px, with gaps on its sides."""
    image = np.full((120, 200), FAR_PX)
    image[20:100, 80:120] = NEAR_PX
    image[20:100, 80 - left_px : 80] = np.nan
    image[20:100, 120 : 120 + right_px] = np.nan
    image[:, :band_px] = np.nan
    return image


def test_the_gaps_on_both_sides_are_found() -> None:
    found = [find_steps(_scene(19, 3))]
    assert found[0].step.tolist() == [NEAR_PX - FAR_PX] * 156  # 78 of 80 rows have two neighbours
    assert measure_gaps(found, False) == (19.0, pytest.approx(19 / 18))
    assert measure_gaps(found, True)[0] == 3.0


def test_slopes_and_single_rows_are_no_steps() -> None:
    ramp = np.tile(np.linspace(10.0, 60.0, 200), (50, 1))
    assert find_steps(ramp).step.size == 0
    lone = np.full((50, 200), FAR_PX)
    lone[20, 80:120] = NEAR_PX
    assert find_steps(lone).step.size == 0


def test_pixels_between_the_surfaces_are_counted() -> None:
    image = _scene(4, 4)
    assert between_share([find_steps(image)]) == 0.0
    image[20:100, 79] = 0.5 * (NEAR_PX + FAR_PX)  # one of 7 known pixels at the left step
    share = between_share([find_steps(image)])
    assert share == pytest.approx(78 / (78 * 7 + 78 * 6))


def test_the_band_at_the_border() -> None:
    width, rest = border_band([_scene(3, 3, band_px=20)])
    assert (width, rest) == (20.0, 20.0 - FAR_PX)
    mirrored = _scene(3, 3, band_px=20)[:, ::-1]
    assert border_band([mirrored]) == (0.0, -FAR_PX)
    assert np.isnan(border_band([np.full((50, 50), np.nan)])).all()


def test_holes_and_flips() -> None:
    first, second = np.zeros((10, 10)), np.zeros((10, 10))
    first[0], second[1] = np.nan, np.nan
    assert flip_share([first, second], [(0, 1)]) == pytest.approx(0.2)
    assert np.isnan(flip_share([first], []))
    band = np.zeros((10, 10))
    band[:, :4] = np.nan  # the band itself is left out
    band[2, 7] = np.nan
    assert hole_share_beside_band([band]) == pytest.approx(1 / 60)
    band[3] = np.nan  # a row without any depth counts
    assert hole_share_beside_band([band]) == pytest.approx(11 / 64)


@needs_real_cameras
def test_the_shadows_of_a_d435() -> None:
    """Known: gap left 1.12 of the prediction, right 3 px, between 0.6 %, band + 6.8 px."""
    frames = real_disparities("d435_robot_room", D435_ROBOT_PX_MM)
    found = [find_steps(frame) for frame in frames]
    left, right = measure_gaps(found, False), measure_gaps(found, True)
    assert left[1] == pytest.approx(1.12, abs=0.03)
    assert right[0] == pytest.approx(3.0, abs=0.5)
    assert between_share(found) == pytest.approx(0.006, abs=0.002)
    assert border_band(frames)[1] == pytest.approx(6.8, abs=0.4)
