"""Planted noise, patterns, light and shadows come back from the measures."""

import numpy as np
import pytest

from glsim.core.depth_frame import DepthFrame
from glsim.measures.correlation import LAGS
from glsim.measures.depth_noise import measure_spatial, measure_temporal
from glsim.measures.light import measure_light
from glsim.measures.measured_frame import radius_px
from glsim.measures.pattern import measure_pattern
from glsim.measures.silhouettes import measure_silhouettes
from glsim.measures.static import static_pairs, view_change
from glsim.measures.validity import measure_invalid
from tests.support.planted_frames import CAMERA, SHAPE, frames_of, noisy, plane, shadowed
from tests.support.real_cameras import needs_real_cameras, real_depths


def _frames(*depths: np.ndarray, infrared: list[np.ndarray] | None = None) -> list[DepthFrame]:
    return list(frames_of("planted", list(depths), infrared))


@pytest.mark.parametrize("sigma_mm", [0.6, 2.0])
def test_sigma_over_time_comes_back_without_the_rounding(sigma_mm: float) -> None:
    clean = plane(800.0, 0.3, 0.1)
    frames = _frames(noisy(clean, sigma_mm, 1), noisy(clean, sigma_mm, 2))
    measured = measure_temporal(frames, static_pairs(frames))
    assert measured.pairs == 1
    assert len(measured.cells) >= 5
    for cell in measured.cells:
        assert cell.value == pytest.approx(sigma_mm, rel=0.05)
    assert max(map(abs, measured.correlation)) < 0.03


def test_correlation_of_smoothed_noise_is_that_of_its_kernel() -> None:
    clean = plane(900.0)
    frames = _frames(noisy(clean, 2.0, 1, smooth=3), noisy(clean, 2.0, 2, smooth=3))
    measured = measure_temporal(frames, [(0, 1)])
    expected = [max(0, 3 - down) * max(0, 3 - right) / 9 for down, right in LAGS]
    # Rounding to mm adds white noise of 1/12 mm^2 to 4 mm^2: 2 %.
    np.testing.assert_allclose(measured.correlation, expected, atol=0.03)


def test_only_static_frames_are_paired() -> None:
    still, moved = plane(900.0), plane(905.0, 0.02)
    frames = _frames(noisy(still, 1.2, 1), noisy(moved, 1.2, 2), noisy(still, 1.2, 3))
    assert static_pairs(frames) == [(0, 2)]


def test_large_noise_is_static_and_a_small_shift_is_not() -> None:
    """Noise of 8 mm changes half of the pixels by 7 mm, a step of the camera by 4 mm."""
    far = _frames(noisy(plane(4000.0), 8.0, 1), noisy(plane(4000.0), 8.0, 2))
    assert static_pairs(far) == [(0, 1)]
    small = _frames(*(noisy(plane(1500.0), 6.0, s, smooth=13)[:128, :128] for s in (1, 2)))
    assert static_pairs(small) == [(0, 1)], "the noise of a stereo camera is wide"
    near = _frames(noisy(plane(900.0), 1.2, 1), noisy(plane(904.0), 1.2, 2))
    assert static_pairs(near) == []
    assert "more than 4 mm" in view_change(*near)


@needs_real_cameras
def test_a_real_camera_of_two_infrared_images_stands_still() -> None:
    """Two frames of a wall before a D435, and of another on a robot before it drives."""
    assert static_pairs(_frames(*real_depths("d435_wall_2frames"))) == [(0, 1)]
    assert static_pairs(_frames(*real_depths("d435_robot_room"))) == [(0, 1)]


def test_a_person_who_moves_before_a_still_wall_is_another_view() -> None:
    """The median of all pixels does not see it: the person covers a twentieth of them."""
    views = [noisy(plane(1500.0, 0.2), 6.0, seed, smooth=13) for seed in (1, 2)]
    for depth, nearer in zip(views, (600, 630), strict=True):
        depth[100:200, 300:400] -= nearer
    assert static_pairs(_frames(*views)) == []


def test_noise_that_grows_over_the_radius_grows_in_the_table() -> None:
    clean = plane(1000.0)
    radius = radius_px(_frames(clean)[0])
    sigma = np.asarray(1.0 + (radius / 200.0) ** 2, np.float64)
    frames = _frames(noisy(clean, sigma, 1), noisy(clean, sigma, 2))
    cells = {c.radius_px: c.value for c in measure_temporal(frames, [(0, 1)]).cells}
    for (inner, outer), value in cells.items():
        ring = (radius >= inner) & (radius < outer)
        assert value == pytest.approx(float(np.sqrt((sigma[ring] ** 2).mean())), rel=0.05)


def test_residuals_of_single_frames_have_the_planted_sigma() -> None:
    frames = _frames(noisy(plane(800.0, 0.4), 1.5, 1), noisy(plane(1400.0, 0.0, 0.3), 1.5, 2))
    measured = measure_spatial(frames)
    assert {c.distance_m for c in measured.cells} >= {(0.65, 0.9), (1.2, 1.5)}
    for cell in measured.cells:
        assert cell.value == pytest.approx(1.5, rel=0.06)
    assert measured.rough_mm[1] == pytest.approx(1.5, rel=0.05)


def test_a_head_sized_ball_leaves_no_sag() -> None:
    """Radius 90 mm at 0.8 m: a plane in 7 x 7 would leave more than its noise near the rim."""
    rays = CAMERA.rays().astype(np.float64)
    off = np.hypot(rays[..., 0], rays[..., 1]) * 800.0
    ball = np.where(off < 80.0, 800.0 - np.sqrt(np.maximum(90.0**2 - off**2, 0.0)), 0.0)
    measured = measure_spatial(_frames(noisy(ball, 1.0, 1)))
    assert measured.rough_mm[1] == pytest.approx(1.0, rel=0.05)


def _patterned(alternation: float, columns: float, rest: float, flip: bool) -> list[DepthFrame]:
    random = np.random.default_rng(5)
    sign = np.where(np.arange(SHAPE[0]) % 2 == 1, 1.0, -1.0)
    if flip:
        sign[: SHAPE[0] // 2] *= -1
    pattern = alternation * sign[:, None] + rest * random.standard_normal(SHAPE)
    pattern = pattern + columns * random.standard_normal(SHAPE[1])[None, :]
    depths = [
        noisy(plane(700.0 + 40.0 * k, 0.1 * (k - 4), 0.03 * k) + pattern, 1.2, 10 + k)
        for k in range(10)
    ]
    return _frames(*depths)


def test_the_fixed_pattern_comes_back_in_its_parts() -> None:
    measured = measure_pattern(_patterned(0.6, 0.3, 0.25, flip=True))
    assert measured.rows_mm == pytest.approx(0.6, rel=0.1)
    assert measured.alternation_rms_mm == pytest.approx(0.6, rel=0.1)
    assert measured.columns_mm == pytest.approx(0.3, rel=0.15)
    assert measured.rest_mm == pytest.approx(0.25, rel=0.15)
    halves = np.array(measured.alternation_mm)
    assert (halves[:4] < -0.5).all()
    assert (halves[4:] > 0.5).all()
    assert abs(measured.rest_correlation) < 0.15


def test_noise_alone_has_no_fixed_pattern() -> None:
    measured = measure_pattern(_patterned(0.0, 0.0, 0.0, flip=False))
    for value in (measured.rows_mm, measured.columns_mm, measured.alternation_rms_mm):
        assert value < 0.08
    assert measured.rest_mm < 0.12


def test_the_noise_law_and_the_light_come_back() -> None:
    """IR = K cos / r^2 within 130 px, times 0.5 beyond 150 px, with an albedo ramp for the law."""
    gain, floor, slope = 20_000.0, 1.0, 4000.0
    depths, lights = [], []
    for k, z in enumerate((700.0, 1000.0, 1400.0, 1900.0)):
        clean = plane(z, 0.2)
        frame = _frames(clean)[0]
        rays = frame.rays.astype(np.float64)
        r_m = clean / 1000.0 * np.sqrt(1 + (rays**2).sum(axis=-1))
        normal = np.array([-0.2, 0.0, 1.0]) / np.hypot(1.0, 0.2)
        ray = np.concatenate([rays, np.ones((*SHAPE, 1))], axis=-1)
        cosine = (ray @ normal) / np.linalg.norm(ray, axis=-1)
        albedo = np.where(np.arange(SHAPE[0])[:, None] % 80 < 40, 1.0, 0.3)
        light = gain * albedo * cosine / r_m**2 * np.where(radius_px(frame) > 150, 0.5, 1.0)
        for copy in (0, 1):
            sigma = np.sqrt(floor**2 + (slope / light) ** 2)
            depths.append(noisy(clean, sigma, 10 * k + copy))
            lights.append(light)
    frames = _frames(*depths, infrared=lights)
    measured = measure_light(frames, static_pairs(frames))
    assert measured.temporal.floor_mm == pytest.approx(floor, rel=0.08)
    assert measured.temporal.slope_mm == pytest.approx(slope, rel=0.08)
    assert measured.spatial.slope_mm == pytest.approx(slope, rel=0.12)
    assert measured.overall == pytest.approx(gain, rel=0.03)
    rings = {inner: value for inner, _, value in measured.rings}
    assert rings[80.0] == pytest.approx(1.0, rel=0.03)
    assert rings[200.0] == pytest.approx(0.5, rel=0.03)


def test_planted_shadow_widths_come_back() -> None:
    depth = shadowed(900.0, 1800.0, left_px=2, right_px=7, flying_px=2)
    frames = _frames(*(noisy(depth, 1.2, seed) for seed in range(3)))
    measured = measure_silhouettes(frames)
    assert measured.shadow_side == "right"
    right, left = measured.right, measured.left
    assert right.edges == 900
    assert right.width_mean_px == pytest.approx(7.0)
    assert right.width_px == pytest.approx(7.0, abs=0.51)
    assert right.invalid_px == pytest.approx(5.0, abs=0.51)
    assert right.band_invalid == pytest.approx(5 / 8)
    assert left.width_mean_px == pytest.approx(2.0)
    assert left.band_invalid == pytest.approx(2 / 8)
    assert left.band_behind == 0.0


def test_the_slope_of_shadow_widths_is_the_baseline() -> None:
    depths = []
    for back in np.linspace(1000.0, 3000.0, 12):
        shift = CAMERA.fx * (1 / 0.8 - 1000.0 / back)
        depths.append(noisy(shadowed(800.0, back, 1, round(1 + 0.040 * shift)), 1.0, int(back)))
    measured = measure_silhouettes(_frames(*depths))
    assert measured.right.slope_mm == pytest.approx(40.0, rel=0.1)
    assert measured.right.offset_px == pytest.approx(1.0, abs=0.7)


def test_depth_behind_the_background_is_counted() -> None:
    depth = shadowed(900.0, 1800.0, 1, 8)
    depth[60:360, 344:348] = 2600.0  # half of the band, too short to be a surface
    measured = measure_silhouettes(_frames(noisy(depth, 1.0, 1)))
    assert measured.right.band_behind == pytest.approx(0.5)
    assert measured.right.band_invalid == pytest.approx(0.5)


def test_the_invalid_rate_is_that_of_each_ring() -> None:
    depth = plane(1000.0)
    depth[radius_px(_frames(depth)[0]) > 250] = 0.0
    rings = measure_invalid(_frames(depth))
    assert [share for inner, outer, share in rings if outer <= 250] == [0.0] * 6
    assert [share for inner, outer, share in rings if inner >= 250] == [1.0] * 3
