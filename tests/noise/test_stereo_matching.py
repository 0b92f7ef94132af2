"""The matcher: disparities, their steps, holes and reasons on images of known disparity."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext
from glsim.noise.registry import find_stage
from glsim.noise.semi_global import match
from glsim.noise.stereo_matching import _device_error, match_stereo, warp_to_camera

FOCAL_PX, BASELINE_M = 400.0, 0.05
HEIGHT, WIDTH = 120, 320
DEFAULTS = {name: q.default for name, q in find_stage("match_stereo").parameters.items()}

Image = NDArray[np.float32]


def parameters(**changes: float) -> dict[str, float]:
    assert set(changes) <= set(DEFAULTS)
    return {**DEFAULTS, **changes}


def texture(seed: int = 0, height: int = HEIGHT) -> Image:
    """A smooth random image, 1,000 columns, of the size of dots."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((height, 1000)).astype(np.float32)
    smooth = cv2.GaussianBlur(white, (0, 0), 1.2)
    return np.clip(np.rint(120 + 50 * smooth / smooth.std()), 0, 255).astype(np.float32)


def seen(disparity: NDArray[np.floating], seed: int = 0) -> tuple[Image, Image]:
    """Images of a surface with a disparity per pixel of the left image."""
    height, width = disparity.shape
    right = texture(seed, height)[:, 300 : 300 + width]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    whole = texture(seed, height)
    left = cv2.remap(whole, (x + 300 - disparity).astype(np.float32), y, cv2.INTER_CUBIC)
    return np.clip(np.rint(left), 0, 255).astype(np.float32), right.copy()


def frame(window: Rect, second_view_m: tuple[float, float, float]) -> FrameContext:
    return FrameContext(
        window=window,
        width=window.left + window.width,
        height=window.top + window.height,
        seed=1,
        sequence_seed=2,
        device_seed=3,
        time_s=0.0,
        focal_baseline_px_m=FOCAL_PX * BASELINE_M,
        focal_px=FOCAL_PX,
        second_view_m=second_view_m,
    )


def run(
    left: Image, right: Image, window: Rect | None = None, clean_m: Image | None = None,
    second_view_m: tuple[float, float, float] = (BASELINE_M, 0.0, 0.0), **changes: float,
) -> dict[str, Image]:  # fmt: skip
    height, width = left.shape
    at = frame(window or Rect(0, 0, width, height), second_view_m)
    clean = np.ones_like(left) if clean_m is None else clean_m
    layers = {
        "infrared": left, "infrared_right": right, "clean": clean, "right_clean": clean,
        "reason": np.zeros_like(left),
    }  # fmt: skip
    return dict(match_stereo(at.view("match_stereo"), layers, parameters(**changes)))


@pytest.mark.parametrize("disparity", [5.0, 20.5, 40.25, 77.125])
def test_disparities_are_found_between_pixels(disparity: float) -> None:
    """The matcher prefers whole pixels, by up to a fifth; the mean over a slope is right."""
    left, right = seen(np.full((HEIGHT, WIDTH), disparity))
    found = match(left, right, parameters()) / 256
    inner = found[10:-10, 110:-10]
    assert (inner > 0).mean() > 0.99
    assert abs(np.median(inner) - disparity) < 0.15
    assert inner[inner > 0].std() < 0.13


def test_depths_are_those_of_whole_steps() -> None:
    """Every depth is round(f B 32 / (unit n)) units, as a real D4xx's."""
    ramp = np.broadcast_to(np.linspace(20, 30, WIDTH), (HEIGHT, WIDTH))
    depth = run(*seen(ramp))["depth"]
    units = np.unique(np.rint(1000 * depth[depth > 0].astype(np.float64)))
    constant = 1000 * FOCAL_PX * BASELINE_M * 32
    steps = np.rint(constant / units)
    assert len(units) > 100
    np.testing.assert_array_equal(np.rint(constant / steps), units)


@pytest.mark.parametrize(
    ("second", "turn"),
    [
        ((-BASELINE_M, 0.0, 0.0), lambda i: i[:, ::-1]),
        ((0.0, BASELINE_M, 0.0), lambda i: i.T),
        ((0.0, -BASELINE_M, 0.0), lambda i: i[:, ::-1].T),
    ],
)
def test_the_second_view_may_be_on_any_side(second, turn) -> None:
    left, right = seen(np.full((HEIGHT, WIDTH), 25.0))
    upright = run(left, right, border_px=0)["depth"]
    turned = run(
        np.ascontiguousarray(turn(left)), np.ascontiguousarray(turn(right)),
        second_view_m=second, border_px=0,
    )["depth"]  # fmt: skip
    np.testing.assert_array_equal(turned, turn(upright))


def test_a_step_leaves_the_shadow_and_a_rim() -> None:
    """Left of a foreground the shadow of the second view, right of it rim_px."""
    near, far = 40.0, 20.0
    disparity = np.full((HEIGHT, WIDTH), far)
    disparity[:, 150:220] = near
    whole = texture()
    x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
    left = cv2.remap(whole, (x + 300 - disparity).astype(np.float32), y, cv2.INTER_CUBIC)
    # What the right imager does not see: other texture.
    left[:, 130:150] = texture(9)[:, :20]
    right = whole[:, 300 : 300 + WIDTH].copy()
    clean = (FOCAL_PX * BASELINE_M / disparity).astype(np.float32)
    right_clean = np.full_like(clean, clean[0, 0])
    right_clean[:, 110:180] = clean[0, 180]
    made = run(np.clip(np.rint(left), 0, 255).astype(np.float32), right, clean_m=clean)
    rows = slice(20, -20)
    missing = made["depth"][rows] <= 0
    right_gap = [int((~row[225:]).argmax()) + int(row[220:225].sum()) for row in missing]
    assert 2 <= np.median(right_gap) <= 5
    left_gap = missing[:, 120:150].sum(axis=1)
    assert 18 <= np.median(left_gap) <= 28


def test_reasons_tell_hidden_from_unmatched_pixels() -> None:
    clean = np.full((HEIGHT, WIDTH), 0.8, np.float32)  # 25 px
    left, right = seen(np.full((HEIGHT, WIDTH), 25.0))
    left[40:80, 200:260] = 100  # no texture
    reason = run(left, right, clean_m=clean, texture_counts=3.0)["reason"]
    assert set(np.unique(reason[45:75, 210:250])) == {Reason.WINDOW}
    assert (reason[:, :20] == Reason.SHADOW).all()  # the second image begins to the right of it
    assert (reason[20:30, 100:300] == Reason.VALID).all()
    wrong = run(left, right, clean_m=np.full_like(clean, 0.5))["reason"]
    assert (wrong[20:30, 100:300] == Reason.MOVED).all()


@pytest.mark.parametrize("upright", [False, True])
def test_bricks_and_patches_keep_the_size_of_the_device_s_error(upright: bool) -> None:
    """Bricks are longer across the baseline, and patches make the strength differ from place."""
    window = Rect(0, 0, 600, 600)
    fine = _device_error(7, window, upright, 4.0, 0.9, 0.6, 0.0, 1.8)
    assert abs(fine.mean()) < 5 * 4 * 2 * np.sqrt(np.pi) / 600  # five standard errors of its mean
    assert fine.std() == pytest.approx(1.0, abs=0.05)
    alike = [float((fine[2:] * fine[:-2]).mean()), float((fine[:, 2:] * fine[:, :-2]).mean())]
    assert alike[upright] > alike[not upright] + 0.3
    patchy = _device_error(7, window, upright, 4.0, 0.9, 0.6, 1.0, 1.8)
    assert float((patchy**2).mean()) == pytest.approx(1.0, rel=0.25)  # some 200 patches
    spread = [np.sqrt((f**2).reshape(25, 24, 25, 24).mean((1, 3))) for f in (fine, patchy)]
    plain, more = (np.quantile(s, 0.9) / np.quantile(s, 0.1) for s in spread)
    assert more > 1.8 > 1.4 > plain


def test_the_device_s_own_error_stays_and_has_its_size() -> None:
    left, right = seen(np.full((HEIGHT, WIDTH), 25.0))
    plain, own = (run(left, right, device_sigma_px=s, subpixel_steps=256) for s in (0.0, 0.2))
    again = run(left, right, device_sigma_px=0.2, subpixel_steps=256)
    np.testing.assert_array_equal(own["depth"], again["depth"])
    both = (plain["depth"] > 0) & (own["depth"] > 0)
    error = (own["disparity"] - plain["disparity"])[both]
    assert error.std() == pytest.approx(0.2, rel=0.2)  # some 400 independent patches
    # A window has the same error in the same pixels.
    window = Rect(100, 20, 200, 80)
    cut = run(
        left[20:100, 100:300],
        right[20:100, 100:300],
        window,
        device_sigma_px=0.2,
        subpixel_steps=256,
    )
    bare = run(left[20:100, 100:300], right[20:100, 100:300], window, subpixel_steps=256)
    seen_both = (cut["depth"] > 0) & (bare["depth"] > 0) & both[20:100, 100:300]
    difference = (cut["disparity"] - bare["disparity"]) - (own["disparity"] - plain["disparity"])[
        20:100, 100:300
    ]
    assert np.abs(difference[seen_both]).max() < 1 / 128


def test_threads_do_not_change_a_byte() -> None:
    left, right = seen(np.full((HEIGHT, WIDTH), 25.3))
    threads = cv2.getNumThreads()
    try:
        results = []
        for number in (1, 2, 4):
            cv2.setNumThreads(number)
            results.append(run(left, right)["depth"].tobytes())
    finally:
        cv2.setNumThreads(threads)
    assert len(set(results)) == 1


def test_warp_shows_what_a_camera_beside_the_imager_sees() -> None:
    depth = np.full((200, 100), 1.0, np.float32)
    depth[80:120] = 0.5
    warped = warp_to_camera(depth, (0.0, -0.022, 0.0), 435.0)
    far, near = 435 * 0.022 / 1.0, 435 * 0.022 / 0.5  # px, upwards
    column = warped[:, 50]
    inside = np.flatnonzero(column == 0.5)
    assert inside[0] == pytest.approx(80 - near, abs=1)
    assert inside[-1] == pytest.approx(119 - near, abs=1.1)
    gap = np.flatnonzero(column[: 200 - int(far) - 2] == 0)
    assert len(gap) == pytest.approx(near - far, abs=2)  # below the foreground alone
    assert gap[0] > inside[-1]
    assert (np.diff(gap) == 1).all()


def _bias_by_fraction(found: NDArray[np.int32], truth: NDArray[np.floating]) -> NDArray[np.float64]:
    """Mean error in eight parts of a pixel, px, without the border that windows see past."""
    inner = np.s_[20:-20, 60:-40]
    error = np.where(found >= 0, found / 256.0, np.nan)[inner] - truth[inner]
    part = np.floor(truth[inner] % 1.0 * 8).astype(int)
    return np.array([np.nanmean(error[part == k]) for k in range(8)])


def test_refinement_removes_the_preference_of_whole_pixels() -> None:
    """A slanted surface crosses ten whole disparities."""
    truth = np.broadcast_to(np.linspace(20.0, 30.0, WIDTH), (HEIGHT, WIDTH))
    left, right = seen(truth)
    plain, refined = (
        _bias_by_fraction(match(left, right, parameters(refine_px=w)), truth) for w in (0, 9)
    )
    assert np.ptp(plain) > 0.15
    assert np.ptp(refined) < 0.5 * np.ptp(plain) - 0.01


def test_pixels_whose_images_are_unlike_are_single_holes() -> None:
    left, right = seen(np.full((HEIGHT, WIDTH), 20.0))
    spots = np.zeros(left.shape, bool)
    spots[20:-20:20, 120:-20:25] = True
    changed = np.where(spots, 255 - left, left) + np.random.default_rng(4).normal(0, 2, left.shape)
    inner = np.s_[10:-10, 110:-10]
    whole, cut = (
        match(changed.astype(np.float32), right, parameters(refine_px=9, unlike_medians=limit))
        for limit in (0.0, 12.0)
    )
    lost = (whole >= 0) & (cut < 0)
    assert lost[inner][spots[inner] & (np.abs(255 - 2 * left) > 60)[inner]].mean() > 0.9
    assert lost[inner][~spots[inner]].mean() < 0.01
    np.testing.assert_array_equal(whole[~lost], cut[~lost])
