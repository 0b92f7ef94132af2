"""Stages of returned light and range: range_gate, shadow, infrared, low_signal."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest
from scipy import stats

from glsim.core.reason import Reason
from tests.support.stage_harness import (
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
    z_correlation,
    z_rate,
)


def strip(numbers: list[float]) -> Image:
    """An image that starts with these numbers and is filled with the last one."""
    image = np.full(HEIGHT * WIDTH, numbers[-1], np.float32)
    image[: len(numbers)] = numbers
    return image.reshape(HEIGHT, WIDTH)


def test_range_gate_is_exact(context: moderngl.Context) -> None:
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


def test_shadow_needs_half_of_the_light(context: moderngl.Context) -> None:
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
def test_infrared_follows_lambert_and_the_inverse_square(
    context: moderngl.Context, tilt: float
) -> None:
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
def test_low_signal_is_lost_as_the_normal_law_says(
    context: moderngl.Context, spreads: float
) -> None:
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
