"""Depth rebuilt from sparse points: no holes, round lobes at silhouettes, a ramp, no bias."""

from __future__ import annotations

import numpy as np
import pytest

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext
from glsim.noise.registry import shipped_stages
from tests.support.stage_harness import HEIGHT, WIDTH, Image, crop, flat, frame, layers_of, values

STAGE = "fill_from_points"


def run(layers: dict[str, Image], at: FrameContext | None = None, **p: float) -> dict[str, Image]:
    at = at or frame()
    function = shipped_stages()[STAGE].function
    assert function is not None
    return dict(function(at.view(STAGE), layers, values(STAGE, p)))


def steps(near_m: float, far_m: float) -> Image:
    """The left half near, the right half far."""
    depth = np.full((HEIGHT, WIDTH), far_m, np.float32)
    depth[:, : WIDTH // 2] = near_m
    return depth


def test_a_plane_stays_where_it_is_and_becomes_smooth() -> None:
    rng = np.random.default_rng(0)
    inverse = 1 / 0.5 + rng.normal(0, 0.0065, (HEIGHT, WIDTH))
    layers = flat(0.5)
    layers["depth"] = (1 / inverse).astype(np.float32)
    layers["depth"][60:75, 90:110] = 0
    made = run(layers)
    assert (made["depth"] > 0).all()
    error_mm = 1000 * (made["depth"].astype(float) - 0.5)
    assert abs(error_mm.mean()) < 0.1
    assert error_mm.std() < 0.3 * 1000 * 0.0065 * 0.25
    assert (made["reason"] == Reason.VALID).all()
    units = made["depth"] / np.float32(1e-4)
    assert np.abs(units - np.rint(units)).max() < 2e-3, "steps of 0.1 mm"


@pytest.mark.parametrize("near_m", [0.4, 0.5, 0.7])
def test_a_silhouette_grows_in_lobes_and_its_step_is_a_ramp(near_m: float) -> None:
    """As seen on three heads: lobes of 10 to 20 px, a ramp."""
    layers = layers_of(steps(near_m, 1.6), np.array([0.0, 0.0, -1.0, 0.6]))
    depth = run(layers)["depth"].astype(float)
    share = (1 / depth - 1 / 1.6) / (1 / near_m - 1 / 1.6)
    inner = share[20:-20]
    grown = (inner > 0.5).sum(axis=1) - WIDTH // 2
    assert 8 <= grown.mean() <= 20
    assert 0.7 < grown.std() < 5, "round lobes, not a straight line"
    ramp = ((inner > 0.1) & (inner < 0.9)).sum(axis=1)
    assert 2 <= np.median(ramp) <= 8
    reason = run(layers)["reason"]
    assert (reason[:, WIDTH // 2 : WIDTH // 2 + 5] == Reason.MOVED).all()
    assert (reason[:, -40:] == Reason.VALID).all()


def test_holes_wider_than_it_reaches_stay() -> None:
    layers = flat(0.5)
    layers["depth"] = np.zeros_like(layers["depth"])
    assert not run(layers)["depth"].any()
    layers["depth"][:, :40] = 0.5
    filled = [int((run(layers, doublings=n)["depth"][100] > 0).sum()) for n in (0, 1, 2)]
    assert 55 < filled[0] < filled[1] < filled[2] < WIDTH
    nothing = flat(0.5)
    nothing["clean"] = np.zeros_like(nothing["clean"])
    assert (run(nothing)["reason"] == Reason.GROWN).all()


def test_a_window_has_the_pixels_of_the_whole_frame() -> None:
    rng = np.random.default_rng(3)
    depth = steps(0.5, 1.4)
    depth[rng.random(depth.shape) < 0.1] = 0
    depth[40:90, 100:160] = 0
    layers = layers_of(depth, np.array([0.0, 0.0, -1.0, 0.6]))
    reach = shipped_stages()[STAGE].reach_px(values(STAGE, {"doublings": 1}))
    whole = run(layers, doublings=1)["depth"]
    at = frame(window=Rect(13, 7, WIDTH - 13, HEIGHT - 7))
    part = run(crop(layers, at), at, doublings=1)["depth"]
    inner = np.s_[reach:, reach:]
    assert part[inner].size > 10_000
    assert np.array_equal(part[inner], whole[at.window.slices][inner])
