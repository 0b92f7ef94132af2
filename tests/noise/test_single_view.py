"""Stereo from one view: noise, the device's share, shadows, rims and the lattice, by z-score."""

import numpy as np
import pytest

from glsim.core.reason import Reason
from tests.support.stage_harness import (
    FOCAL_BASELINE,
    Z_MAX,
    Image,
    flat,
    frame,
    run_twin,
    z_mean,
    z_sd,
)

#: No roughness, growth or noise.
SMOOTH = {"rough_px": 0.0}
QUIET = SMOOTH | {"sigma_px": 0.0, "sigma_px_per_m": 0.0, "device_sigma_px": 0.0, "tail": 0.0}


def noisy(depth: float | Image, seed: int = 0, device: int = 4242, **p: float) -> dict[str, Image]:
    layers = flat(depth)
    at = frame(seed, device_seed=device)
    layers |= run_twin("single_view_match", layers, at, **SMOOTH, border_px=0.0, growth_px=0.0)
    return run_twin("single_view_noise", layers, at, **QUIET | {"growth_across_px": 0.0} | p)


def error_px(z_m: float, seed: int = 0, device: int = 4242, **p: float) -> Image:
    """The error of disparity on every 24th pixel, farther apart than noise is alike."""
    depth = noisy(z_m, seed, device, steps_per_px=256.0, **p)["depth"][::24, 80::24]
    return FOCAL_BASELINE / depth - FOCAL_BASELINE / np.float32(z_m)


@pytest.mark.parametrize("z_m", [0.6, 1.2, 3.0])
def test_noise_has_no_bias_and_grows_with_distance(z_m: float) -> None:
    p = {"sigma_px": 0.06, "sigma_px_per_m": 0.04, "most_sigma_px": 0.1}
    error = np.stack([error_px(z_m, seed, **p) for seed in range(40)])
    sigma = min(np.hypot(0.06, 0.04 * z_m), 0.1)
    assert abs(z_mean(error)) < Z_MAX
    assert abs(z_sd(error, float(np.hypot(sigma, 1 / 256 / np.sqrt(12))))) < Z_MAX


@pytest.mark.long
def test_the_devices_share_stays_in_all_frames_and_differs_between_devices() -> None:
    p = {"sigma_px": 0.05, "device_sigma_px": 0.05}
    one = np.stack([error_px(0.8, seed, device=seed, **p) for seed in range(40)])
    again = np.stack([error_px(0.8, 100 + seed, device=seed, **p) for seed in range(40)])
    other = np.stack([error_px(0.8, seed, device=99 + seed, **p) for seed in range(40)])
    alike, apart = one * again / 0.05**2, np.roll(one, 1, 0) * other / 0.05**2
    assert abs(z_mean(alike, 1.0)) < Z_MAX
    assert abs(z_mean(apart)) < Z_MAX


def test_depths_lie_on_the_lattice() -> None:
    steps = 32 * FOCAL_BASELINE / noisy(0.8, sigma_px=0.2)["depth"][:, 60:]
    assert np.abs(steps - np.rint(steps)).max() < 1e-3
    assert len(np.unique(np.rint(steps))) > 20


def test_the_second_views_shadow_has_its_width_and_the_other_sides_have_a_rim() -> None:
    """A square at 0.9 m before 1.5 m: 12.2 px are hidden and 2 more; beside other sides 3 px."""
    depth = np.full((212, 256), 1.5, np.float32)
    depth[60:150, 120:200] = 0.9
    reason = noisy(depth)["reason"]
    row = reason[100]
    hidden = FOCAL_BASELINE * (1 / 0.9 - 1 / 1.5)
    assert abs((row[60:120] != Reason.VALID).sum() - (hidden + 2)) <= 1
    assert (row[200:203] == Reason.EDGE).all()
    assert (row[204:] == Reason.VALID).all()
    column = reason[:, 160]
    assert np.flatnonzero(column).tolist() == [57, 58, 59, 150, 151, 152]
    band = int(FOCAL_BASELINE / 1.5)
    assert (row[: band - 1] == Reason.SHADOW).all()
    assert (row[band + 1 : 90] == Reason.VALID).all()


def test_dark_surfaces_are_lost() -> None:
    layers = flat(1.0)
    layers["albedo"][:] = 0.01
    layers |= run_twin("single_view_match", layers)
    lost = run_twin("single_view_noise", layers, **QUIET)["reason"] == Reason.LOW_SIGNAL
    assert 0.3 < lost[:, 80:].mean() < 0.7
