"""Statistics and rules of the noise stages, by z-score: values, signal, edges, dots."""

from typing import Any

import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray
from scipy import stats

from glsim.core.reason import Reason
from glsim.noise.twins.edges import dot_place, place_pixel
from tests.support.stage_harness import (
    FOCAL_BASELINE,
    HEIGHT,
    WIDTH,
    Z_MAX,
    Image,
    flat,
    frame,
    layers_of,
    plane,
    rays,
    run_shader,
    run_twin,
    scene,
    z_correlation,
    z_mean,
    z_rate,
    z_sd,
)


def error_mm(
    context: Context, use: str, z_m: float, angle_deg: float = 0.0, seed: int = 0,
    **p: float,
) -> NDArray[np.float64]:  # fmt: skip
    """The error, mm, that a stage adds to a surface of constant depth and angle."""
    depth = run_shader(context, use, flat(z_m, angle_deg), frame(seed), **p)["depth"]
    return (depth.astype(np.float64) - np.float32(z_m)) * 1000.0


def fankhauser_mm(z: float, degrees: float) -> float:
    """Sigma of Fankhauser et al. 2015, Kinect V2 indoors, mm."""
    a = np.radians(degrees)
    return float(1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * a**2 / (np.pi / 2 - a) ** 2)


#: Stage, depth (m), angle (degrees), parameters, sigma, and whether it is px of disparity, not mm.
SIGMAS: list[tuple[str, float, float, dict[str, float], float, bool]] = [
    *(
        ("axial", z, angle, {"max_sigma_mm": 1000.0}, fankhauser_mm(z, angle), False)
        for z in (0.5, 0.9, 1.5, 3.0, 4.5)
        for angle in (0.0, 30.0, 45.0, 60.0, 75.0, 80.0)
    ),
    *(("gaussian", 1.2, 0.0, {"sigma_mm": sigma}, sigma, False) for sigma in (0.3, 1.0, 10.0)),
    *(("gaussian", z, 0.0, {"sigma_mm": 0, "sigma_px": 0.15}, 0.15, True) for z in (0.6, 0.9, 2.0)),
]


@pytest.mark.parametrize(("use", "z", "angle", "p", "sigma", "disparity"), SIGMAS)
def test_noise_has_no_bias_and_its_sigma(
    context: Context, use: str, z: float, angle: float, p: dict[str, float],
    sigma: float, disparity: bool,
) -> None:  # fmt: skip
    error = error_mm(context, use, z, angle, **p)
    if disparity:
        error = FOCAL_BASELINE / (np.float32(z) + 1e-3 * error) - FOCAL_BASELINE / np.float32(z)
    assert abs(z_mean(error)) < Z_MAX
    assert abs(z_sd(error, sigma)) < Z_MAX


#: One part of the fixed pattern at a time.
NO_PATTERN: dict[str, Any] = dict.fromkeys(
    ("pixel_sigma_mm", "column_sigma_mm", "row_sigma_mm", "row_alternation_mm", "row_profile_mm",
     "row_step_mm"), 0.0
)  # fmt: skip


def pattern_mm(context: Context, **part: float) -> Image:
    layers = flat(0.9)
    drawn = run_shader(context, "fixed_pattern", layers, **(NO_PATTERN | part))["depth"]
    twin = run_twin("fixed_pattern", layers, **(NO_PATTERN | part))["depth"]
    assert np.abs(drawn - twin).max() < 2e-6
    return (1000 * (drawn.astype(np.float64) - np.float32(0.9))).astype(np.float64)


def test_fixed_pattern_of_pixels_is_smooth_and_has_its_sigma(context: Context) -> None:
    error = pattern_mm(context, pixel_sigma_mm=0.25)
    assert abs(z_sd(error[::3, ::3], 0.25)) < Z_MAX
    beside = [
        np.corrcoef(error[:, k:].ravel(), error[:, : WIDTH - k].ravel())[0, 1] for k in (1, 2, 3)
    ]
    np.testing.assert_allclose(beside, [0.667, 0.333, 0.0], atol=0.03)


def test_fixed_pattern_of_columns_and_rows(context: Context) -> None:
    column = pattern_mm(context, column_sigma_mm=0.2)
    assert np.ptp(column, axis=0).max() < 1e-3
    assert abs(z_sd(column[0], 0.2)) < Z_MAX
    row = pattern_mm(context, row_sigma_mm=0.25)
    assert np.ptp(row, axis=1).max() < 1e-3
    assert abs(z_sd(row[:, 0], 0.25)) < Z_MAX


def test_rows_alternate_with_another_sign_in_the_lower_half(context: Context) -> None:
    error = pattern_mm(context, row_alternation_mm=0.69)
    assert np.ptp(error, axis=1).max() < 1e-3
    size = error[:, 0] * np.where(np.arange(HEIGHT) % 2, 1, -1)
    np.testing.assert_allclose(np.abs(size), 0.69, atol=1e-3)
    assert (size[: HEIGHT // 2] < 0).all(), "odd rows of the upper half are nearer, on all devices"
    assert (size[HEIGHT // 2 :] > 0).all()
    step = pattern_mm(context, row_step_mm=0.37)[:, 0]
    np.testing.assert_allclose(step[1::2] - step[::2], 0.37, atol=1e-3)


@pytest.mark.parametrize("step", [1.0, 0.5, 3.0])
def test_depth_is_rounded_to_millimetres(context: Context, step: float) -> None:
    ramp = np.random.default_rng(0).uniform(0.5, 4.5, (HEIGHT, WIDTH))
    layers = flat(ramp)
    depth = run_shader(context, "millimetre_quantise", layers, step_mm=step)["depth"]
    steps = depth.astype(np.float64) * 1000 / step
    np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-3)
    off = steps - layers["depth"].astype(np.float64) * 1000 / step
    assert np.abs(off).max() < 0.5 + 1e-3
    assert abs(z_mean(off)) < Z_MAX
    assert abs(z_mean(off**2, 1 / 12)) < Z_MAX


def strip(numbers: list[float]) -> Image:
    """An image that starts with these numbers and is filled with the last one."""
    image = np.full(HEIGHT * WIDTH, numbers[-1], np.float32)
    image[: len(numbers)] = numbers
    return image.reshape(HEIGHT, WIDTH)


def test_range_gate_is_exact(context: Context) -> None:
    near, far = np.float32(0.5), np.float32(4.5)
    depths = [0.0, 1e-4, 0.3, np.nextafter(near, np.float32(0)), near, 0.7, far,
              np.nextafter(far, np.float32(9)), 8.0]  # fmt: skip
    layers = flat(strip(depths))
    written = run_shader(context, "range_gate", layers)
    kept = [False, False, False, False, True, True, True, False, False]
    first = slice(0, len(depths))
    np.testing.assert_array_equal(
        written["depth"][0, first], np.where(kept, layers["depth"][0, first], 0)
    )
    codes = [Reason.VALID if k else Reason.OUT_OF_RANGE for k in kept]
    np.testing.assert_array_equal(written["reason"][0, first], [Reason.NO_SURFACE, *codes[1:]])


def test_shadow_needs_half_of_the_light(context: Context) -> None:
    layers = flat(0.9)
    layers["lit"] = strip([0.0, 1 / 3, 0.499, 0.5, 2 / 3, 1.0])
    written = run_shader(context, "shadow", layers)
    np.testing.assert_array_equal(written["depth"][0, :6] > 0, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(written["reason"][0, :6], [2, 2, 2, 0, 0, 0])
    layers["depth"] = np.zeros_like(layers["depth"])
    layers["reason"] = np.full_like(layers["reason"], Reason.DROPPED)
    written = run_shader(context, "shadow", layers, min_lit=1.0)
    assert (written["reason"] == Reason.DROPPED).all()  # it keeps the first reason


@pytest.mark.parametrize("tilt", [0.0, 40.0, 75.0])
def test_infrared_follows_lambert_and_the_inverse_square(context: Context, tilt: float) -> None:
    depth, normal = plane(1.2, tilt, 30.0)
    valid = depth > 0
    layers = layers_of(np.where(valid, depth, 0.0), normal)
    layers["lit"] *= np.random.default_rng(0).random(depth.shape, np.float32)
    ray = np.concatenate([rays(), np.ones((HEIGHT, WIDTH, 1))], axis=-1)
    distance = np.linalg.norm(ray * depth[..., None], axis=-1)
    cosine = -(ray @ normal[:3]) / np.linalg.norm(ray, axis=-1)
    light = 30_300 * 0.6 * np.maximum(cosine, 0) / distance**2 * layers["lit"]
    counts = run_shader(context, "infrared", layers, ambient_counts=12)["infrared"]
    np.testing.assert_allclose(counts, 12 + np.where(valid, light, 0), rtol=3e-5, atol=1e-4)


@pytest.mark.parametrize("spreads", [-2.0, -1.0, 0.0, 1.0, 2.0])
def test_low_signal_is_lost_as_the_normal_law_says(context: Context, spreads: float) -> None:
    layers = {
        **flat(0.9),
        "infrared": np.full((HEIGHT, WIDTH), 387.468 + 77.494 * spreads, np.float32),
    }
    written = run_shader(context, "low_signal", layers)
    lost = written["depth"] == 0
    assert abs(z_rate(lost, stats.norm.sf(spreads))) < Z_MAX
    np.testing.assert_array_equal(written["reason"] == Reason.LOW_SIGNAL, lost)
    other = run_shader(context, "low_signal", layers, frame(1))["depth"] == 0
    assert abs(z_correlation(lost, other)) < Z_MAX
    assert abs(z_correlation(lost, np.roll(lost, 1, axis=1))) < Z_MAX


NEAR, FAR, EDGE = 0.9, 1.5, 100
#: Pixels whose jitter stays within the frame.
INNER = (slice(9, -9), slice(9, -9))


def step(other: float, axis: int = 1) -> dict[str, Image]:
    """Layers with a step: NEAR up to EDGE along an axis, ``other`` (m) beyond it."""
    place = np.arange((HEIGHT, WIDTH)[axis])
    profile = np.where(place < EDGE, NEAR, other)
    return flat(profile[None, :] if axis == 1 else profile[:, None] * np.ones((1, WIDTH)))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sigma", [0.3, 0.65, 1.5])
def test_edges_jitter_by_sigma(context: Context, sigma: float, axis: int) -> None:
    """A pixel has the far depth if its jittered position is beyond the edge."""
    frames = [
        run_shader(context, "lateral", step(FAR, axis), frame(n), sigma_px=sigma)["depth"]
        for n in range(8)
    ]
    far = np.stack(frames)[:, INNER[0], INNER[1]] > 1.2
    shares = np.moveaxis(far, 1 + axis, 0)
    first = INNER[axis].start
    for place in range(EDGE - 8, EDGE + 8):
        expected = stats.norm.sf((EDGE - 0.5 - place) / sigma)
        hits = shares[place - first]
        if 1e-3 < expected < 1 - 1e-3:
            assert abs(z_rate(hits, expected)) < Z_MAX
    # On average the edge stays where it is.
    assert far.mean() * shares.shape[0] == pytest.approx(len(shares) - (EDGE - first), abs=0.1)


@pytest.mark.parametrize(("angle", "angle_px"), [(0.0, 0.0), (60.0, 0.0), (60.0, 0.035)])
@pytest.mark.parametrize("slope_mm", [0.5, 2.0])
def test_on_a_slope_jitter_becomes_noise(
    context: Context, slope_mm: float, angle: float, angle_px: float
) -> None:
    ramp = 0.9 + 1e-3 * slope_mm * np.arange(WIDTH)[None, :]
    layers = flat(ramp, angle)
    depth = run_shader(context, "lateral", layers, sigma_px=0.65, angle_px=angle_px)["depth"]
    a = np.radians(angle)
    sigma = 0.65 + angle_px * a / (np.pi / 2 - a)
    error_mm = (depth.astype(np.float64) - layers["depth"])[INNER] * 1000
    assert abs(z_mean(error_mm)) < Z_MAX
    assert abs(z_sd(error_mm, slope_mm * sigma)) < Z_MAX


def test_lateral_reasons(context: Context) -> None:
    layers = step(0.0)
    written = run_shader(context, "lateral", layers)
    depth, reason, before = written["depth"], written["reason"], layers["depth"] > 0
    for now, was, code in (
        (False, True, Reason.EDGE),
        (True, False, Reason.GROWN),
        (False, False, Reason.NO_SURFACE),
        (True, True, Reason.VALID),
    ):
        pixels = ((depth > 0) == now) & (before == was)
        assert pixels.sum() > 50
        assert (reason[pixels] == code).all()
    layers = step(FAR)
    written = run_shader(context, "lateral", layers)
    moved = (written["depth"] != layers["depth"])[INNER]
    assert moved.sum() > 50
    np.testing.assert_array_equal(written["reason"][INNER] == Reason.MOVED, moved)
    layers["depth"][:, EDGE:], layers["reason"][:, EDGE:] = 0.0, Reason.SHADOW
    written = run_shader(context, "lateral", layers)
    came = (written["depth"] > 0) & (layers["depth"] == 0)
    assert (written["reason"][came] == Reason.MOVED).all()  # clean has a surface there


@pytest.mark.parametrize("radius", [1, 2, 4])
@pytest.mark.parametrize("probability", [0.1, 0.5, 0.9])
def test_dropout_at_edges_only(context: Context, probability: float, radius: int) -> None:
    lost = []
    for n in range(4):
        p = {"probability": probability, "radius_px": radius}
        written = run_shader(context, "edge_dropout", step(FAR), frame(n), **p)
        lost.append((written["depth"] == 0)[INNER])
        np.testing.assert_array_equal(written["reason"] == Reason.EDGE, written["depth"] == 0)
    columns = np.moveaxis(np.stack(lost), 2, 0)
    band = slice(EDGE - radius - 9, EDGE + radius - 9)
    assert abs(z_rate(columns[band], probability)) < Z_MAX
    assert not np.delete(columns, band, axis=0).any()


CELLS = (-(-HEIGHT // 3), -(-WIDTH // 3))


def dots(rows: int = CELLS[0], columns: int = CELLS[1]) -> tuple[NDArray[np.integer[Any]], ...]:
    """Column and row of each cell's dot."""
    x, y = np.arange(columns)[None, :], np.arange(rows)[:, None]
    return place_pixel(x, y, dot_place(x, y))


def rule(depth: Image, cell: tuple[int, int], inlier_px: float = 0.1) -> bool:
    """The window's rule of BlenSor and render_kinect, dot by dot."""
    columns, rows = dots()
    x, y = int(columns[cell]), int(rows[cell])
    if depth[y, x] <= 0:
        return False
    near = (np.abs(columns - x) <= 4) & (np.abs(rows - y) <= 4)  # in the 9x9 pixels
    around = list(zip(rows[near].tolist(), columns[near].tolist(), strict=True))
    seen = [(r, c, FOCAL_BASELINE / float(depth[r, c])) for r, c in around if depth[r, c] > 0]
    if 3 * len(seen) <= 2 * len(around):
        return False
    mean = sum(d for _, _, d in seen) / len(seen)
    agree = 0
    for r, c, d in seen:
        squared = (1.2 * (r - y)) ** 2 + (1.2 * (c - x)) ** 2
        agree += abs(d - mean) / (squared or 1.0) < inlier_px
    return 3 * agree > 2 * len(around)


@pytest.mark.parametrize("seed", [0, 1])
def test_window_follows_the_rule(context: Context, seed: int) -> None:
    layers = scene(seed)
    match = run_shader(context, "correlation_window", layers)["dot_match"]
    depth = np.pad(layers["depth"], ((0, 3), (0, 3)))  # cells beyond the last pixels
    some = [(r, c) for r in range(3, CELLS[0] - 3, 3) for c in range(3, CELLS[1] - 3, 2)]
    wrong = sum(bool(match[cell]) != rule(depth, cell) for cell in some)
    assert 0.2 < np.mean([bool(match[cell]) for cell in some]) < 0.95
    assert wrong <= 1  # float32 against float64 at the limit of a comparison


@pytest.mark.parametrize("radius", [0.5, 1.5, 3.1, 3.9])
def test_each_pixel_takes_the_nearest_dot(context: Context, radius: float) -> None:
    layers = scene(2)
    rng = np.random.default_rng(0)
    layers["depth"] = rng.uniform(0.5, 1.5, (HEIGHT, WIDTH)).astype(np.float32)
    layers["dot_match"] = layers["dot_match"] * (rng.random(CELLS) < 0.5)
    depth = run_shader(context, "dot_spread", layers, radius_px=radius)["depth"]
    x, y = dots()
    match = (layers["dot_match"] > 0) & (x < WIDTH) & (y < HEIGHT)
    x, y = x[match], y[match]
    value = layers["depth"][y, x]
    rows = rng.choice(HEIGHT, 20, replace=False)
    for row in rows:
        squared = (np.arange(WIDTH)[:, None] - x) ** 2 + (row - y) ** 2
        least = squared.min(axis=1)
        reached = least < np.float32(radius) ** 2
        np.testing.assert_array_equal(depth[row] > 0, reached)
        # Any of several equally near dots is right.
        fits = (squared == least[:, None]) & (value == depth[row][:, None])
        assert fits.any(axis=1)[reached].all()
