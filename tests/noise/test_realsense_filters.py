"""librealsense's filters: the rules on small arrays, against loops, and in a chain."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moderngl import Context

import glsim
from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.noise.layer_names import EARLIER_LAYER
from glsim.noise.realsense_filters import (
    decimate,
    fill_holes,
    filter_sequence,
    hole_filling,
    smooth_disparity,
    smooth_in_time,
    spatial_filter,
    temporal_filter,
)
from glsim.noise.registry import find_stage
from glsim.sensors import sensor
from glsim.simulation.depth_noise import DepthNoise
from tests.support.scenes import assert_cut, face_mesh, frames_of, moving_settings, settings_for
from tests.support.stage_harness import FOCAL_BASELINE, Image, frame

#: A view of a rig of 365 px and 75 mm.
VIEW = frame().view("filter")


def image(*rows: list[float]) -> Image:
    return np.array(rows, np.float32)


def layers_of(depth: Image, clean: Image | None = None) -> dict[str, Image]:
    reason = np.where(depth > 0, float(Reason.VALID), float(Reason.DROPPED)).astype(np.float32)
    return {"depth": depth, "clean": depth if clean is None else clean, "reason": reason}


def defaults(use: str, **changes: float) -> dict[str, float]:
    return {n: p.default for n, p in find_stage(use).parameters.items()} | changes


def test_decimation_takes_the_lower_median_of_what_has_depth() -> None:
    depth = image([4, 3, 0, 0, 9], [2, 1, 7, 5, 9], [0, 0, 8, 6, 9], [0, 0, 0, 7, 9])
    assert decimate(depth, 2).tolist() == [[2, 5], [0, 7]]
    assert decimate(depth[None], 2).shape == (1, 2, 2)


def test_an_average_over_time_starts_anew_after_a_step() -> None:
    stack = image([10.0], [20.0], [20.0], [60.0], [70.0])[:, :, None]
    smooth = smooth_in_time(stack, 0.4, 20.0, 0)
    expected = [10, 0.4 * 20 + 0.6 * 10, 0.4 * 20 + 0.6 * 14, 60, 0.4 * 70 + 0.6 * 60]
    np.testing.assert_allclose(smooth[:, 0, 0], expected, rtol=1e-6)
    # From 14 to 34 the difference is delta: not less, so the pixel starts anew.
    edge = image([14.0], [34.0], [34.0])[:, :, None]
    np.testing.assert_array_equal(smooth_in_time(edge, 0.4, 20.0, 0), edge)


#: Valid frames before a hole, oldest first -> the modes that fill it.
HISTORIES = [
    ("1" * 8, {1, 2, 3, 4, 5, 6, 7, 8}),
    ("01111111", {2, 3, 4, 5, 6, 7, 8}),
    ("00000011", {2, 3, 4, 5, 6, 7, 8}),
    ("00000101", {2, 3, 4, 5, 6, 7, 8}),
    ("00001001", {3, 4, 5, 6, 7, 8}),
    ("10000001", {4, 5, 6, 7, 8}),
    ("00000010", {5, 6, 7, 8}),
    ("00000100", {6, 7, 8}),
    ("00001000", {6, 7, 8}),
    ("00010000", {6, 7, 8}),
    ("00100000", {7, 8}),
    ("10000000", {7, 8}),
    ("100000000", {8}),
    ("00000000", set()),
]


@pytest.mark.parametrize(("before", "filled_by"), HISTORIES)
def test_a_hole_takes_the_last_depth_by_the_history(before: str, filled_by: set[int]) -> None:
    stack = np.array([30.0 * int(bit) for bit in before] + [0.0], np.float32)[:, None, None]
    filled = {mode for mode in range(9) if smooth_in_time(stack, 0.4, 20.0, mode)[-1, 0, 0] == 30}
    assert filled == filled_by


HOLES = image(
    [1.0, 2.0, 3.0, 4.0, 0.0],
    [5.0, 0.0, 0.0, 6.0, 0.0],
    [7.0, 9.0, 0.0, 0.0, 1.0],
    [0.0, 0.0, 2.0, 3.0, 0.0],
)


def test_holes_take_the_left_neighbour() -> None:
    expected = image([1.0, 2, 3, 4, 4], [5.0, 5, 5, 6, 6], [7.0, 9, 9, 9, 1], [0.0, 0, 2, 3, 3])
    np.testing.assert_array_equal(fill_holes(HOLES, 0), expected)


def slow_fill(depth: Image, mode: int) -> Image:
    """The rule of modes 1 and 2 pixel by pixel."""
    filled = depth.copy()
    for y in range(1, len(depth) - 1):
        for x in range(1, depth.shape[1]):
            if filled[y, x] == 0:
                places = ((-1, -1), (0, -1), (1, -1), (1, 0))
                others = [filled[y + dy, x + dx] for dy, dx in places]
                value = filled[y - 1, x]
                for other in others:
                    if mode == 1:
                        value = max(value, other)
                    elif other > 0 and other < value:
                        value = other
                filled[y, x] = value
    return filled


@pytest.mark.parametrize("mode", [1, 2])
@pytest.mark.parametrize("share", [0.1, 0.6, 0.95])
def test_filling_by_rows_is_filling_pixel_by_pixel(mode: int, share: float) -> None:
    rng = np.random.default_rng(int(100 * share))
    depth = rng.uniform(0.3, 4.0, (40, 57)).astype(np.float32)
    depth[rng.random(depth.shape) < share] = 0.0
    before = depth.copy()
    np.testing.assert_array_equal(fill_holes(depth, mode), slow_fill(depth, mode))
    np.testing.assert_array_equal(depth, before)


def slow_smooth(disparity: Image, alpha: float, delta: float) -> Image:
    """One iteration pixel by pixel, with a state that holes and edges reset."""
    result = disparity.copy()
    rows, columns = disparity.shape
    right = [[(y, x) for x in range(columns)] for y in range(rows)]
    down = [[(y, x) for y in range(rows)] for x in range(columns)]
    for lines in (right, [r[::-1] for r in right], down, [d[::-1] for d in down]):
        for line in lines:
            state, previous = np.float32(0), np.float32(0)
            for place in line:
                value = result[place]
                if value > 0 and previous > 0 and abs(value - previous) < delta:
                    state = np.float32(alpha) * value + np.float32(1 - alpha) * state
                    result[place] = state
                else:
                    state = value
                previous = value
    return result


def test_smoothing_by_lines_is_smoothing_pixel_by_pixel() -> None:
    rng = np.random.default_rng(4)
    disparity = (300 + 9 * rng.standard_normal((31, 44))).astype(np.float32)
    disparity[:, 20:] += 40
    disparity[rng.random(disparity.shape) < 0.1] = 0.0
    twice = slow_smooth(slow_smooth(disparity, 0.6, 20), 0.6, 20)
    np.testing.assert_allclose(smooth_disparity(disparity, 0.6, 20.0, 2), twice, rtol=1e-6)


def test_the_spatial_stage_smooths_disparity_and_delivers_millimetres() -> None:
    rng = np.random.default_rng(2)
    constant = 32 * FOCAL_BASELINE
    depth = (constant / (700 + 4 * rng.standard_normal((50, 60)))).astype(np.float32)
    written = spatial_filter(VIEW, layers_of(depth), defaults("spatial_filter"))["depth"]
    np.testing.assert_allclose(1000 * written, np.rint(1000 * written), atol=1e-3)
    exact = spatial_filter(VIEW, layers_of(depth), defaults("spatial_filter", unit_mm=0))["depth"]
    smooth = smooth_disparity(constant / depth, 0.5, 20.0, 2)
    np.testing.assert_allclose(exact, constant / smooth, rtol=1e-6)
    assert np.abs(written - exact).max() <= 0.0005001


def test_filled_pixels_have_the_reason_of_what_they_carry() -> None:
    clean = image([0.9, 0.9, 0.9, 1.5, 1.5, 0.0, 0.9])
    depth = image([0.9, 0.0, 0.9, 0.0, 0.0, 0.0, 0.9])
    layers = layers_of(depth, clean)
    written = spatial_filter(VIEW, layers, defaults("spatial_filter", filling_mode=3))
    np.testing.assert_allclose(written["depth"], np.full((1, 7), 0.9), rtol=1e-6)
    valid, moved, grown = (float(r) for r in (Reason.VALID, Reason.MOVED, Reason.GROWN))
    expected = image([valid, valid, valid, moved, moved, grown, valid])
    np.testing.assert_array_equal(written["reason"], expected)
    left = hole_filling(VIEW, layers, defaults("hole_filling", mode=0))
    np.testing.assert_allclose(left["depth"], written["depth"], rtol=1e-6)
    np.testing.assert_array_equal(left["reason"], written["reason"])
    off = spatial_filter(VIEW, layers, defaults("spatial_filter"))
    np.testing.assert_array_equal(off["reason"], layers["reason"])


def test_the_temporal_stage_filters_the_draws_before() -> None:
    rng = np.random.default_rng(6)
    steps = 800 + 3 * rng.standard_normal((30, 40, 9))
    steps[rng.random(steps.shape) < 0.1] = 0
    stack = np.divide(32 * FOCAL_BASELINE, steps, out=np.zeros_like(steps), where=steps > 0)
    stack = stack.astype(np.float32)
    clean = np.full((30, 40), 32 * FOCAL_BASELINE / 800, np.float32)
    layers = layers_of(stack[..., -1], clean) | {EARLIER_LAYER: stack[..., :-1]}
    written = temporal_filter(VIEW, layers, defaults("temporal_filter"))
    whole = filter_sequence(np.moveaxis(stack, -1, 0), FOCAL_BASELINE)
    np.testing.assert_array_equal(written["depth"], whole[-1])
    filled = (stack[..., -1] == 0) & (written["depth"] > 0)
    assert 0.08 < filled.mean() < 0.12
    assert (written["reason"][filled] == float(Reason.VALID)).all()
    smoothed = spatial_filter(VIEW, layers, defaults("spatial_filter", unit_mm=0))
    alone = spatial_filter(VIEW, layers_of(stack[..., 3]), defaults("spatial_filter", unit_mm=0))
    np.testing.assert_array_equal(smoothed[EARLIER_LAYER][..., 3], alone["depth"])
    with pytest.raises(ConfigError, match="reads the layer 'earlier_depth', which no stage"):
        temporal_filter(VIEW, layers_of(stack[..., -1]), defaults("temporal_filter"))


@pytest.mark.parametrize("stage", [spatial_filter, temporal_filter])
def test_a_rig_without_a_baseline_is_named(stage: Any) -> None:
    view = frame(focal_baseline_px_m=0.0).view("filter")
    layers = layers_of(image([1.0, 1.0])) | {EARLIER_LAYER: np.ones((1, 2, 1), np.float32)}
    with pytest.raises(ConfigError, match="the rig has no baseline"):
        stage(view, layers, defaults(stage.__name__))


COARSE = face_mesh(60)


def kinect_with(folder: Path, *stages: str) -> str:
    """The file of a Kinect V1 with more stages at its end."""
    shipped = Path(sensor.__file__).parent / "kinect-v1.toml"
    file = folder / "mine.toml"
    file.write_text(shipped.read_text() + "".join(f"\n[[stage]]\n{stage}\n" for stage in stages))
    return str(file)


@pytest.mark.parametrize(
    "stages",
    [
        ('use = "spatial_filter"\nfilling_mode = 4\nalpha = 0.3',),
        ('use = "spatial_filter"', 'use = "hole_filling"\nmode = 0'),
        ('use = "hole_filling"', 'use = "threshold_filter"\nfar_mm = 1200'),
    ],
)
def test_a_crop_is_filtered_as_the_whole_frame(
    context: Context, tmp_path: Path, stages: tuple[str, ...]
) -> None:
    named = kinect_with(tmp_path, *stages)
    scene = {"wall_mm": 1300}
    whole, cut = (
        frames_of(context, moving_settings(named, scene=scene, **crop), COARSE, 2)
        for crop in ({}, {"output": {"crop": 64}})
    )
    assert all((part.noisy > 0).mean() > 0.2 for part in cut)
    assert_cut(whole, cut, "noisy", "reason")


def test_a_still_sequence_of_depth_maps_is_filtered_after_it_was_made() -> None:
    """A recording, or frames of DepthNoise: noise falls and rims keep their depth."""
    depth = np.full((60, 80), 1.6, np.float32)
    depth[20:40, 20:50] = 0.9
    with DepthNoise(settings_for("kinect-v1"), backend="numpy") as camera:
        noisy = camera(np.stack([depth] * 12), frame=0)
        rig = camera.rig(depth.shape)
    filtered = glsim.filter_sequence(noisy, rig.intrinsics.fx * rig.baseline_m)
    assert filtered.shape == noisy.shape
    assert filtered.dtype == np.float32
    known = (noisy[-1] > 0)[24:36, 24:46]
    error, before = ((m[-1] - depth)[24:36, 24:46][known] for m in (filtered, noisy))
    assert np.abs(error).mean() < 0.8 * np.abs(before).mean()
    assert ((filtered[-1] > 1.0) & (filtered[-1] < 1.5)).mean() <= (
        (noisy[-1] > 1.0) & (noisy[-1] < 1.5)
    ).mean()
    assert (filtered[-1] > 0).sum() > (noisy[-1] > 0).sum()
