"""The measures of the validation on data with known answers."""

import numpy as np
import pytest

from glsim.core.array_types import Array
from glsim.measures import stacks as measure
from glsim.sensors import kinect_v2
from tests.support.stage_harness import Z_MAX, z_mean, z_sd

RNG = np.random.default_rng(5)


def box_noise(frames: int, side: int, sigma: float) -> Array:
    """White noise after a 3 x 3 box filter, of standard deviation sigma."""
    white = RNG.normal(0, 3 * sigma, (frames, side + 2, side + 2))
    parts = [white[:, r : r + side, c : c + side] for r in range(3) for c in range(3)]
    return np.asarray(np.mean(parts, axis=0))


def tilted_plane(side: int) -> Array:
    rows, columns = np.mgrid[:side, :side]
    return np.asarray(900 + 0.7 * rows - 0.3 * columns)


def test_sigma_of_known_noise_on_a_tilted_plane() -> None:
    noise = RNG.normal(0, 1.3, (40, 64, 64))
    frames = tilted_plane(64) + noise
    assert abs(z_sd(measure.without_plane(frames), 1.3)) < Z_MAX
    assert measure.sigma_spatial(frames) == pytest.approx(1.3, rel=0.01)
    assert measure.sigma_temporal(frames) == pytest.approx(1.3, rel=0.02)


def test_temporal_part_is_unbiased_and_leaves_the_fixed_pattern_out() -> None:
    pattern = RNG.normal(0, 5.0, (48, 48))
    part = measure.temporal_part(pattern + RNG.normal(0, 0.8, (12, 48, 48)))
    assert abs(float((part**2).mean()) / 0.64 - 1) < 0.03
    assert abs(z_mean(part)) < Z_MAX


@pytest.mark.parametrize("frames", [4, 64])
def test_temporal_sigma_is_unbiased_for_any_number_of_frames(frames: int) -> None:
    found = measure.sigma_temporal(RNG.normal(0, 2.0, (frames, 100, 100)))
    assert found == pytest.approx(2.0, rel=0.02)


def test_holes_do_not_count() -> None:
    frames = tilted_plane(32) + RNG.normal(0, 1.0, (60, 32, 32))
    whole = measure.sigma_temporal(frames)
    frames[RNG.random(frames.shape) < 0.2] = np.nan
    frames[:, 3, 3] = np.nan
    assert measure.sigma_temporal(frames) == pytest.approx(whole, rel=0.05)
    assert np.isfinite(measure.sigma_spatial(frames))
    assert np.isnan(measure.sigma_temporal_map(frames)[3, 3])
    assert np.isnan(measure.sigma_spatial(np.full((2, 4, 4), np.nan)))


def test_autocorrelation_of_box_filtered_noise() -> None:
    found = measure.autocorrelation(
        box_noise(60, 96, 1.0), [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (2, 2)]
    )
    assert found == pytest.approx([1, 2 / 3, 1 / 3, 0, 4 / 9, 1 / 9], abs=0.015)


def test_temporal_autocorrelation_of_white_and_of_repeated_noise() -> None:
    white = RNG.normal(0, 1, (24, 48, 48))
    assert abs(measure.temporal_autocorrelation(white)) * np.sqrt(white.size) < Z_MAX
    assert measure.temporal_autocorrelation(np.repeat(white, 2, axis=0)) > 0.4


def test_fixed_pattern_without_what_noise_leaves_in_the_mean() -> None:
    pattern = RNG.normal(0, 0.5, (64, 64))
    frames = tilted_plane(64) + pattern + RNG.normal(0, 2.0, (50, 64, 64))
    assert measure.fixed_pattern(frames)[1] == pytest.approx(0.5, rel=0.05)
    assert measure.fixed_pattern(frames - pattern)[1] < 0.08


def test_edge_jitter_of_a_slanted_edge_is_that_of_its_pixels() -> None:
    rows, columns = np.mgrid[:64, :64]
    sharp = np.where(columns + 0.5 < 30 + 0.09 * rows, 900.0, 1500.0)[None].repeat(8, axis=0)
    assert measure.edge_jitter(measure.edge_positions(sharp, 900, 1500)) == pytest.approx(
        12**-0.5, abs=0.02
    )
    moved = 30 + 0.09 * rows + RNG.normal(0, 0.7, (200, 64, 1))
    jittered = np.where(columns + 0.5 < moved, 900.0, 1500.0)
    assert measure.edge_jitter(measure.edge_positions(jittered, 900, 1500)) == pytest.approx(
        np.hypot(0.7, 12**-0.5), rel=0.05
    )


def test_mixed_pixels_are_counted_by_row() -> None:
    frames = np.full((2, 4, 8), 900.0)
    frames[:, :, 4:] = 1500.0
    frames[:, 0, 4], frames[:, 1, 4], frames[:, 2, 4] = 1200.0, 1700.0, np.nan
    assert measure.mixed_per_row(frames, 900, 1500) == (0.25, 0.25, 0.25)


def test_sinusoids_are_told_apart_from_a_trend() -> None:
    z = np.arange(600.0, 3001.0, 20.0)
    error = 4 + 0.003 * z + 2 * np.sin(2 * np.pi * z / 625 + 1) + RNG.normal(0, 0.05, z.size)
    amplitudes, deviations, left = measure.sinusoids(z, error, (3125, 1562, 625, 417, 468))
    assert amplitudes[2] == pytest.approx(2, abs=0.05)
    assert amplitudes[4] < Z_MAX * deviations[4]
    assert left < 0.08
    assert np.abs(measure.without_trend(z, error)).max() == pytest.approx(2, rel=0.2)


def test_half_point_and_its_absence() -> None:
    x = np.array([1.0, 2.0, 3.0, 4.0])
    assert measure.crossing(x, np.array([0.0, 0.25, 0.75, 1.0]), 0.5) == pytest.approx(2.5)
    assert np.isnan(measure.crossing(x, np.ones(4), 0.5))
    assert np.isnan(measure.crossing(x, np.zeros(4), 0.5))


def test_normals_of_a_plane_and_their_error() -> None:
    side, focal = 32, 300.0
    rays = np.stack(np.meshgrid(*[(np.arange(side) - 15.5) / focal] * 2), axis=-1)
    tilt = np.radians(30)
    plane = 900 / (1 - np.tan(tilt) * rays[..., 0])
    flat = measure.normals(np.full((side, side), 900.0), rays)
    found = measure.normals(plane, rays)
    assert np.nanmax(np.abs(flat - [0, 0, -1])) < 1e-9
    assert measure.angular_error_deg(found, flat) == pytest.approx(30, abs=1e-6)


def test_masks() -> None:
    mask = np.zeros((9, 12), bool)
    mask[2:7, 2:9] = True
    assert measure.eroded(mask, 2).sum() == 1 * 3
    assert measure.longest_run(mask) == 7
    step = np.full((5, 6), 900.0)
    step[:, 3:] = 1000.0
    step[0, 0] = np.nan
    assert measure.steps_mm(step)[2].tolist() == [0, 0, 100, 100, 0, 0]


def test_constants_of_the_kinect_v2() -> None:
    """The tap noise that is fitted to the published phase noise, and the depth noise it gives."""
    at_50 = kinect_v2.tap_phase_sigma_rad(50.0)
    assert at_50 == pytest.approx([0.033, 0.024, 0.040], rel=0.11)
    assert kinect_v2.white_sigma_mm(391 / 0.81) == pytest.approx(0.40, abs=0.02)
