"""Every metric against another implementation, on random and adversarial inputs."""

import math

import numpy as np
import pytest
from skimage.metrics import mean_squared_error, peak_signal_noise_ratio, structural_similarity

from glsim.core.errors import DenoiserError
from glsim.eval.metrics.frame_score import score
from glsim.eval.metrics.scored_map import Truth, angles_deg
from tests.support.eval_scenes import ADVERSARIAL, CAMERA, SIZE, Array, dome

RAYS = CAMERA.rays()
NAN = float("nan")


def scored(prediction: Array, clean: Array, noisy_mm: Array) -> dict[str, float]:
    return score(prediction, Truth(clean, noisy_mm, RAYS))


def pixel_by_pixel(p: Array, c: Array, i: Array) -> dict[str, list[float]]:
    """The errors of each set, and the angles, in loops that follow the written definitions."""
    height, width = c.shape
    near = [(dy, dx) for dy in range(-3, 4) for dx in range(-3, 4)]
    steps = [(0, 1), (1, 0), (0, -1), (-1, 0)]

    def at(image: Array, y: int, x: int) -> float | None:
        return float(image[y, x]) if 0 <= y < height and 0 <= x < width else None

    def jump(y: int, x: int) -> bool:
        others = [at(c, y + dy, x + dx) for dy, dx in steps]
        return c[y, x] > 0 and any(o and abs(o - float(c[y, x])) > 30 for o in others)

    jumps = {(y, x) for y in range(height) for x in range(width) if jump(y, x)}
    names = ("both", "both_interior", "both_edge", "input", "input_interior", "input_edge")
    other = ("input_beside_holes", "filled", "angle", "harm", "ring")
    sets: dict[str, list[float]] = {name: [] for name in (*names, *other)}
    for y in range(height):
        for x in range(width):
            if c[y, x] <= 0:
                continue
            hole = any(at(c, y + dy, x + dx) == 0 for dy, dx in near)
            beside = any((y + dy, x + dx) in jumps for dy, dx in near if max(abs(dy), abs(dx)) < 3)
            part = "edge" if hole or beside else "interior"
            error = float(p[y, x]) - float(c[y, x])
            if p[y, x] > 0:
                sets["both"].append(error)
                sets[f"both_{part}"].append(error)
                if i[y, x] == 0:
                    sets["filled"].append(error)
            touching = [at(c, y + dy, x + dx) for dy, dx in near if max(abs(dy), abs(dx)) < 2]
            outermost = any(z is not None and (z == 0 or z - c[y, x] > 30) for z in touching)
            if outermost and i[y, x] > 0 and abs(float(i[y, x]) - float(c[y, x])) <= 50:
                sets["ring"].append(p[y, x] == 0 or abs(error) > 50)
            if i[y, x] > 0:
                error = error if p[y, x] > 0 else float(i[y, x]) - float(c[y, x])
                sets["input"].append(error)
                sets[f"input_{part}"].append(error)
                if part == "interior":
                    sets["harm"].append(abs(error) > abs(float(i[y, x]) - float(c[y, x])))
                    if any(at(c, y + b, x + a) and not at(i, y + b, x + a) for b, a in near):
                        sets["input_beside_holes"].append(error)
            window = [(y + dy, x + dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
            if all(at(p, *q) and at(c, *q) and q not in jumps for q in window):
                sets["angle"].append(_angle(p, c, y, x))
    return sets


def _angle(p: Array, c: Array, y: int, x: int) -> float:
    normals = []
    for depth in (p, c):
        points = CAMERA.unproject(depth.astype(np.float64) / 1000) * 1000
        n = np.cross(points[y + 1, x] - points[y - 1, x], points[y, x + 1] - points[y, x - 1])
        normals.append(n / np.linalg.norm(n))
    return math.degrees(2 * math.asin(min(1.0, float(np.linalg.norm(normals[0] - normals[1])) / 2)))


def same(ours: float, theirs: float) -> bool:
    if math.isnan(ours) or math.isnan(theirs):
        return math.isnan(ours) and math.isnan(theirs)
    return math.isclose(ours, theirs, rel_tol=1e-6, abs_tol=1e-6)


@pytest.mark.parametrize("name", ADVERSARIAL)
def test_paper_block_is_scikit_images(name: str) -> None:
    prediction, clean, noisy_mm = ADVERSARIAL[name]
    ours = scored(prediction, clean, noisy_mm)
    p, c = prediction.astype(np.float64), clean.astype(np.float64)
    assert same(ours["mse_mm2"], mean_squared_error(c, p))
    equal = bool((p == c).all())
    assert same(ours["psnr_db"], NAN if equal else peak_signal_noise_ratio(c, p, data_range=8000))
    flips = ((p - c) ** 2)[(p > 0) != (c > 0)].sum() / ((p - c) ** 2).sum() if not equal else NAN
    assert same(ours["mse_flips_pct"], 100 * flips)
    for preset, k1, k2, span in (
        ("paper", 0.001, 0.003, 8000),
        ("standard", 0.01, 0.03, 8000),
        ("16bit", 0.01, 0.03, 65535),
    ):
        theirs = structural_similarity(c, p, data_range=span, K1=k1, K2=k2)
        assert same(ours[f"ssim_{preset}"], float(theirs)), preset


@pytest.mark.parametrize("name", ADVERSARIAL)
def test_honest_block_is_what_its_words_say(name: str) -> None:
    prediction, clean, noisy_mm = ADVERSARIAL[name]
    ours = scored(prediction, clean, noisy_mm)
    v, w = prediction > 0, clean > 0
    hits, either = int((v & w).sum()), int((v | w).sum())
    assert same(ours["iou"], hits / either if either else NAN)
    assert same(ours["precision"], hits / int(v.sum()) if v.any() else NAN)
    assert same(ours["recall"], hits / int(w.sum()) if w.any() else NAN)
    assert ours["flips_px"] == int((v != w).sum())
    far = v & (~w | (np.abs(prediction - clean) > 50))
    assert ours["flying_px"] == int(far.sum())
    sets = pixel_by_pixel(prediction, clean, noisy_mm)
    angles = np.asarray(sets.pop("angle"))
    for key, name in (("harm", "harm_pct"), ("ring", "ring_lost_pct")):
        shares = sets.pop(key)
        assert same(ours[name], 100 * float(np.mean(shares)) if shares else NAN), name
    for key, errors in sets.items():
        e = np.asarray(errors)
        none = e.size == 0
        expected = {
            "rmse": NAN if none else float(np.sqrt(np.mean(e**2))),
            "mae": NAN if none else float(np.mean(np.abs(e))),
            "median": NAN if none else float(np.median(np.abs(e))),
            "p95": NAN if none else float(np.quantile(np.abs(e), 0.95)),
            "bias": NAN if none else float(np.mean(e)),
        }
        for statistic, value in expected.items():
            assert same(ours[f"{key}_{statistic}_mm"], value), f"{key} {statistic}"
    # unproject gives float32 points: their normals are good to some 1e-3 degrees.
    if angles.size == 0:
        assert math.isnan(ours["normal_mean_deg"])
    else:
        assert ours["normal_mean_deg"] == pytest.approx(angles.mean(), abs=0.02)
        assert ours["normal_median_deg"] == pytest.approx(np.median(angles), abs=0.02)
        assert ours["normal_good_pct"] == pytest.approx(100 * (angles < 10).mean(), abs=1)


def test_small_angles_are_exact() -> None:
    tilt = np.radians([1e-7, 1e-3, 90.0, 180.0])
    tilted = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], -1)
    up = np.tile([0.0, 0.0, 5.0], (4, 1))
    np.testing.assert_allclose(angles_deg(up, tilted), np.degrees(tilt), rtol=1e-9)


def test_smaller_than_a_window_is_undefined() -> None:
    tiny = np.full((2, 3), 900, np.float32)
    ours = score(tiny, Truth(tiny, tiny, np.zeros((2, 3, 2), np.float32)))
    assert math.isnan(ours["ssim_paper"])
    assert math.isnan(ours["normal_mean_deg"])
    assert ours["iou"] == 1.0


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (np.full(SIZE, np.nan, np.float32), "no number"),
        (np.full(SIZE, -1, np.float32), "negative"),
        (np.zeros((5, 5), np.float32), "shape"),
        (np.zeros(SIZE, np.complex64), "type complex64"),
    ],
)
def test_what_is_no_depth_map_is_refused(bad: Array, words: str) -> None:
    with pytest.raises(DenoiserError, match=words):
        scored(bad, dome(), dome())


def _waves(period_px: float, height_mm: float) -> Array:
    along = np.arange(96) * 2 * np.pi / period_px
    return np.tile(900 + height_mm * np.sin(along), (96, 1)).astype(np.float32)


def test_relief_that_is_smoothed_away_is_not_kept_and_noise_takes_none() -> None:
    rng = np.random.default_rng(1)
    for period_px in (4.0, 6.0, 8.0):
        clean, rays = _waves(period_px, 2.0), np.zeros((96, 96, 2))
        left = 900 + 0.3 * (clean - 900) + rng.normal(0, 2, clean.shape)
        kept = score(left.astype(np.float32), Truth(clean, clean, rays))["relief_kept_pct"]
        assert kept == pytest.approx(30, abs=4), period_px
    flat = np.full((96, 96), 900, np.float32)
    assert math.isnan(score(flat, Truth(flat, flat, rays))["relief_kept_pct"])


def test_a_surface_that_bends_towards_a_hole_is_concave() -> None:
    """An error of -k x^2 / 2 has the Laplacian -k, and the curvature -k / (2 pitch^2)."""
    column = np.tile(np.arange(96.0), (96, 1))
    rays = np.stack([(column - 48) / 365, (column.T - 48) / 365], axis=-1)
    clean = np.where(column < 40, 0, 900).astype(np.float32)
    bent = np.where(column < 40, 0, 900 - 0.01 * (60 - column) ** 2 / 2).astype(np.float32)
    added = score(bent, Truth(clean, clean, rays))["hole_curvature_per_m"]
    assert added == pytest.approx(-1000 * 0.01 / 2 / (900 / 365) ** 2, rel=1e-2)
    assert math.isnan(score(clean + 1, Truth(clean + 1, clean, rays))["hole_curvature_per_m"])


def test_the_error_that_two_frames_share_is_lost_form_without_noise() -> None:
    rng = np.random.default_rng(2)
    clean, rays = _waves(6.0, 2.0), np.zeros((96, 96, 2))
    first, second = (900 + rng.normal(0, 1.5, (2, 96, 96))).astype(np.float32)
    truth = Truth(clean, first, rays)
    shared = score(second, truth, (first, clean))["systematic_mm2"]
    # The mean of 2 sin squared, and of a product of noise that is 0 within three deviations.
    assert shared == pytest.approx(2.0, abs=3 * 1.5 * (1.5 + 2 * 2**0.5) / 90)
    assert math.isnan(score(second, truth)["systematic_mm2"])
    assert math.isnan(score(second, truth, (first, clean + 1))["systematic_mm2"])
