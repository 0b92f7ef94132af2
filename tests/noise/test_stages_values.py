"""Bias and standard deviation of the stages that add noise to depth or round it, by z-score."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from tests.support.stage_harness import (
    FOCAL_BASELINE,
    HEIGHT,
    WIDTH,
    Z_MAX,
    Image,
    flat,
    frame,
    run_shader,
    run_twin,
    z_correlation,
    z_mean,
    z_sd,
)


def error_mm(
    context: moderngl.Context, use: str, z_m: float, angle_deg: float = 0.0, seed: int = 0,
    **p: float,
) -> NDArray[np.float64]:  # fmt: skip
    """The error, mm, that a stage adds to a surface of constant depth and angle."""
    depth = run_shader(context, use, flat(z_m, angle_deg), frame(seed), **p)["depth"]
    return (depth.astype(np.float64) - np.float32(z_m)) * 1000.0


def fankhauser_mm(z: float, degrees: float) -> float:
    """Sigma of Fankhauser et al. 2015, Kinect V2 indoors, mm."""
    a = np.radians(degrees)
    return float(1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * a**2 / (np.pi / 2 - a) ** 2)


@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 60.0, 75.0, 80.0])
@pytest.mark.parametrize("z", [0.5, 0.9, 1.5, 3.0, 4.5])
def test_axial_is_fankhausers(context: moderngl.Context, z: float, angle: float) -> None:
    error = error_mm(context, "axial", z, angle, max_sigma_mm=1000)
    assert abs(z_mean(error)) < Z_MAX
    assert abs(z_sd(error, fankhauser_mm(z, angle))) < Z_MAX


@pytest.mark.parametrize("use", ["axial", "gaussian"])
def test_white_and_normal(context: moderngl.Context, use: str) -> None:
    error = error_mm(context, use, 0.9)
    for lag in ((0, 1), (1, 0), (1, 1), (0, 2)):
        assert abs(z_correlation(error, np.roll(error, lag, axis=(0, 1)))) < Z_MAX
    assert abs(stats.skew(error, axis=None)) / np.sqrt(6 / error.size) < Z_MAX
    assert abs(stats.kurtosis(error, axis=None)) / np.sqrt(24 / error.size) < Z_MAX
    assert stats.kstest(error.ravel() / error.std(), "norm").pvalue > 1e-5


@pytest.mark.parametrize("sigma", [0.3, 1.0, 10.0])
def test_gaussian_in_millimetres(context: moderngl.Context, sigma: float) -> None:
    error = error_mm(context, "gaussian", 1.2, sigma_mm=sigma)
    assert abs(z_mean(error)) < Z_MAX
    assert abs(z_sd(error, sigma)) < Z_MAX


@pytest.mark.parametrize("z", [0.6, 0.9, 2.0])
def test_gaussian_in_disparity(context: moderngl.Context, z: float) -> None:
    depth = run_shader(context, "gaussian", flat(z), sigma_mm=0.0, sigma_px=0.15)["depth"]
    error = FOCAL_BASELINE / depth.astype(np.float64) - FOCAL_BASELINE / np.float32(z)
    assert abs(z_mean(error)) < Z_MAX
    assert abs(z_sd(error, 0.15)) < Z_MAX


def test_fixed_pattern_belongs_to_the_device(context: moderngl.Context) -> None:
    layers = flat(0.9)
    first, next_frame, other = (
        run_shader(context, "fixed_pattern", layers, at)["depth"]
        for at in (frame(1), frame(2, time_s=5.0), frame(1, device_seed=4243))
    )
    assert first.tobytes() == next_frame.tobytes()
    a, b = ((1000 * (part - np.float32(0.9))).astype(np.float64) for part in (first, other))
    columns = [part.mean(axis=0) for part in (a, b)]
    assert abs(z_correlation(*columns)) < Z_MAX
    # Every third pixel of every third row: neighbours are alike. A row's own part is taken away.
    rest = [
        (part - part.mean(axis=1, keepdims=True) - part.mean(axis=0))[::3, ::3] for part in (a, b)
    ]
    assert abs(z_correlation(*rest)) < Z_MAX


#: One part of the fixed pattern at a time.
NO_PATTERN: dict[str, Any] = dict.fromkeys(
    ("pixel_sigma_mm", "column_sigma_mm", "row_sigma_mm", "row_alternation_mm", "row_profile_mm",
     "row_step_mm"), 0.0
)  # fmt: skip


def pattern_mm(context: moderngl.Context, **part: float) -> Image:
    layers = flat(0.9)
    drawn = run_shader(context, "fixed_pattern", layers, **(NO_PATTERN | part))["depth"]
    twin = run_twin("fixed_pattern", layers, **(NO_PATTERN | part))["depth"]
    assert np.abs(drawn - twin).max() < 2e-6
    return (1000 * (drawn.astype(np.float64) - np.float32(0.9))).astype(np.float64)


def test_fixed_pattern_of_pixels_is_smooth_and_has_its_sigma(context: moderngl.Context) -> None:
    error = pattern_mm(context, pixel_sigma_mm=0.25)
    assert abs(z_sd(error[::3, ::3], 0.25)) < Z_MAX
    beside = [
        np.corrcoef(error[:, k:].ravel(), error[:, : WIDTH - k].ravel())[0, 1] for k in (1, 2, 3)
    ]
    np.testing.assert_allclose(beside, [0.667, 0.333, 0.0], atol=0.03)


def test_fixed_pattern_of_columns_and_rows(context: moderngl.Context) -> None:
    column = pattern_mm(context, column_sigma_mm=0.2)
    assert np.ptp(column, axis=0).max() < 1e-3
    assert abs(z_sd(column[0], 0.2)) < Z_MAX
    row = pattern_mm(context, row_sigma_mm=0.25)
    assert np.ptp(row, axis=1).max() < 1e-3
    assert abs(z_sd(row[:, 0], 0.25)) < Z_MAX


def test_rows_alternate_with_another_sign_in_the_lower_half(context: moderngl.Context) -> None:
    error = pattern_mm(context, row_alternation_mm=0.69)
    assert np.ptp(error, axis=1).max() < 1e-3
    size = error[:, 0] * np.where(np.arange(HEIGHT) % 2, 1, -1)
    np.testing.assert_allclose(np.abs(size), 0.69, atol=1e-3)
    assert (size[: HEIGHT // 2] < 0).all(), "odd rows of the upper half are nearer, on all devices"
    assert (size[HEIGHT // 2 :] > 0).all()
    step = pattern_mm(context, row_step_mm=0.37)[:, 0]
    np.testing.assert_allclose(step[1::2] - step[::2], 0.37, atol=1e-3)


def test_disparity_is_rounded_to_steps(context: moderngl.Context) -> None:
    ramp = np.linspace(0.85, 0.95, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)
    depth = run_shader(context, "disparity_quantise", flat(ramp))["depth"].astype(np.float64)
    steps = FOCAL_BASELINE / depth / 0.125
    np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-4)
    off_px = FOCAL_BASELINE / depth - FOCAL_BASELINE / ramp
    assert np.abs(off_px).max() < 0.0625 + 1e-5
    levels = np.unique(np.rint(steps)).astype(int)
    np.testing.assert_array_equal(np.diff(levels), 1)
    bands_mm = np.diff(np.unique(depth)) * 1000.0
    middle = bands_mm[np.argmin(np.abs(np.unique(depth)[:-1] - 0.9))]
    assert middle == pytest.approx(1000 * 0.9**2 / FOCAL_BASELINE / 8, rel=0.01)  # 3.7 mm


@pytest.mark.parametrize("step", [1.0, 0.5, 3.0])
def test_depth_is_rounded_to_millimetres(context: moderngl.Context, step: float) -> None:
    ramp = np.random.default_rng(0).uniform(0.5, 4.5, (HEIGHT, WIDTH))
    layers = flat(ramp)
    depth = run_shader(context, "millimetre_quantise", layers, step_mm=step)["depth"]
    steps = depth.astype(np.float64) * 1000 / step
    np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-3)
    off = steps - layers["depth"].astype(np.float64) * 1000 / step
    assert np.abs(off).max() < 0.5 + 1e-3
    assert abs(z_mean(off)) < Z_MAX
    assert abs(z_mean(off**2, 1 / 12)) < Z_MAX
