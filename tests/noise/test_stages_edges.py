"""Stages at depth edges: the jitter of lateral, the rate and place of edge_dropout."""

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
    run_shader,
    z_mean,
    z_rate,
    z_sd,
)

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
def test_edges_jitter_by_sigma(context: moderngl.Context, sigma: float, axis: int) -> None:
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
    context: moderngl.Context, slope_mm: float, angle: float, angle_px: float
) -> None:
    ramp = 0.9 + 1e-3 * slope_mm * np.arange(WIDTH)[None, :]
    layers = flat(ramp, angle)
    depth = run_shader(context, "lateral", layers, sigma_px=0.65, angle_px=angle_px)["depth"]
    a = np.radians(angle)
    sigma = 0.65 + angle_px * a / (np.pi / 2 - a)
    error_mm = (depth.astype(np.float64) - layers["depth"])[INNER] * 1000
    assert abs(z_mean(error_mm)) < Z_MAX
    assert abs(z_sd(error_mm, slope_mm * sigma)) < Z_MAX


def test_lateral_reasons(context: moderngl.Context) -> None:
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
def test_dropout_at_edges_only(context: moderngl.Context, probability: float, radius: int) -> None:
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
