"""The Azure Kinect's filter and field stop."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from tests.support.stage_harness import Z_MAX
from tests.support.tof_harness import QUIET, Camera, merged, quad

CROP = Rect(260, 260, 120, 120)
#: Noise of the taps alone, so small that no phase turns.
NOISE = merged(QUIET, {"tof_taps": {"read_variance": 4.0}})
WIDTH_PX = 2.0


def kernel(width_px: float) -> np.ndarray:
    """Return the (7, 7) weights of neighbours of the same phase."""
    offset = np.arange(-3, 4)
    along = np.exp(-0.5 * (offset / width_px) ** 2)
    return np.outer(along, along)


def frames(context: moderngl.Context, count: int, on: bool) -> np.ndarray:
    """Return (count, h, w) depth of a bright wall, mm."""
    cam = Camera.open(context, "azure-kinect")
    own = {"enabled": float(on), "sharpness": 0.0, "width_px": WIDTH_PX}
    changes = merged(NOISE, {"tof_smooth": own})
    wall = [quad(800.0, albedo=0.8)]
    shots = [cam.shoot(wall, changes, seed=s, crop=CROP)["depth"] for s in range(count)]
    return 1000.0 * np.stack(shots)[:, 16:-16, 16:-16]


def test_noise_falls_and_is_correlated_as_the_weights_say(context: moderngl.Context) -> None:
    count = 24
    raw, smooth = (frames(context, count, on) for on in (False, True))
    weights = kernel(WIDTH_PX)
    expected = float(np.sqrt((weights**2).sum()) / weights.sum())
    # One number per frame: neighbours in a frame are not independent.
    ratios = smooth.std(axis=0, ddof=1).mean() / raw.std(axis=0, ddof=1).mean()
    noise = smooth - smooth.mean(axis=0)
    per_frame = (noise**2).mean(axis=(1, 2))
    spread = per_frame.std(ddof=1) / per_frame.mean() / np.sqrt(count) / 2
    assert abs(ratios / expected - 1) < Z_MAX * spread + 0.01
    for lag in (1, 2, 4):
        shifted = np.zeros_like(weights)
        shifted[:, lag:] = weights[:, : 7 - lag]
        law = float((weights * shifted).sum() / (weights**2).sum())
        pairs = (noise[:, :, lag:] * noise[:, :, :-lag]).mean(axis=(1, 2)) / per_frame.mean()
        error = pairs.std(ddof=1) / np.sqrt(count)
        assert abs(pairs.mean() - law) < Z_MAX * error


def test_a_pixel_among_others_of_another_phase_is_marked(context: moderngl.Context) -> None:
    """Beside a step, three of seven columns have the opposite phase at one frequency."""
    cam = Camera.open(context, "azure-kinect")
    near_mm, far_mm = 700.0, 1593.0  # half a wave of 84 MHz apart
    scene = [quad(far_mm, albedo=0.8), quad(near_mm, x_mm=(0.0, 900.0), albedo=0.2)]
    layers = cam.shoot(scene, QUIET)
    mixed = layers["reason"] == Reason.MIXED
    rows = slice(200, 300)
    columns = np.flatnonzero(mixed[rows].any(axis=0))
    assert 1 <= len(columns) <= 6  # at the step alone
    loose = cam.shoot(scene, merged(QUIET, {"tof_smooth": {"max_apart": 1.0}}))
    assert not (loose["reason"] == Reason.MIXED).any()


@pytest.mark.parametrize("deliver", ["raw", "undistorted"])
def test_the_field_stop_cuts_the_same_directions_in_both_geometries(
    context: moderngl.Context, deliver: str
) -> None:
    cam = Camera.open(context, "azure-kinect", deliver=deliver)
    seen = cam.shoot([quad(1000.0, albedo=0.8)], QUIET)["infrared"] > 0
    rig = cam.sensor.rig
    x, y = np.moveaxis(rig.distortion.distort(rig.rays()), -1, 0)
    across, down = np.abs(x + 0.003), np.abs(y + 0.096)
    inside = (down < 0.599) & (np.sqrt(0.75) * across + 0.5 * down < 0.599)
    assert (seen == inside).mean() > 0.999
    off = cam.shoot([quad(1000.0, albedo=0.8)], merged(QUIET, {"field_stop": {"enabled": 0.0}}))
    assert (off["infrared"] > 0).mean() > seen.mean() + 0.05
    again = cam.shoot([quad(1000.0, albedo=0.8)], QUIET)["depth"]
    assert np.array_equal(off["depth"][seen], again[seen])
