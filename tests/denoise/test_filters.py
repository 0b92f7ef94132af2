"""Denoisers: exact parameters, handling of holes, and all ways to name one."""

import functools
import re
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.core.errors import ConfigError, DenoiserError
from glsim.denoise.registry import (
    CLEANUPS,
    GRIDS,
    PAPER_FILTERS,
    denoiser_names,
    describe_denoiser,
    load_denoiser,
    shipped_file,
    tuning_specs,
    with_parameter,
)
from glsim.networks.composites import COMPOSITES, DEFAULT_COMPOSITE
from tests.support.eval_scenes import Array, dome, noisy

CLEAN, NOISY = dome(), noisy(dome())
MASKED = [name for name in denoiser_names() if name in GRIDS]
loaded = functools.cache(load_denoiser)


def run(spec: str, depth: Array = NOISY) -> Array:
    result = load_denoiser(spec).estimate(depth[None]).composites()
    assert set(result) == {""}
    return result[""]


def test_the_papers_filters_are_opencvs_with_its_parameters() -> None:
    whole = NOISY.astype(np.uint16)
    np.testing.assert_array_equal(run("noisy"), NOISY)
    np.testing.assert_array_equal(run("adaptive"), NOISY)
    np.testing.assert_array_equal(run("median"), cv2.medianBlur(whole, 5))
    np.testing.assert_array_equal(run("bilateral"), cv2.bilateralFilter(NOISY, 9, 75, 75))
    expected = cv2.fastNlMeansDenoising(whole, [30.0], None, 7, 21, cv2.NORM_L1)
    np.testing.assert_array_equal(run("nlm"), expected)
    assert set(PAPER_FILTERS) <= set(denoiser_names())


@pytest.mark.parametrize("spec", [*MASKED, *(f"{name}:cleanup=5" for name in MASKED)])
def test_masked_filters_look_at_valid_pixels_only(spec: str) -> None:
    filtered = run(spec)
    assert filtered.dtype == np.float32
    if "cleanup" not in spec:
        np.testing.assert_array_equal(filtered > 0, NOISY > 0)
    # Away from the silhouette, where the input has flying pixels.
    inner = cv2.erode((CLEAN > 0).astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
    inner &= (filtered > 0) & (NOISY > 0)
    before, after = (np.sqrt(np.mean((d - CLEAN)[inner] ** 2)) for d in (NOISY, filtered))
    assert after < 0.95 * before
    assert filtered[filtered > 0].min() > 400, "no zero was averaged in"


@pytest.mark.parametrize(
    "spec",
    [
        pytest.param(name, marks=pytest.mark.long if name == "face-video" else ())
        for name in (*denoiser_names(), *(f"{name}:cleanup=3" for name in MASKED))
    ],
)
@pytest.mark.parametrize("kind", ["empty", "pixel", "full", "corner"])
def test_hard_inputs(spec: str, kind: str) -> None:
    """Networks take seconds to load: each is loaded once."""
    if spec.startswith("bm3d"):
        pytest.importorskip("bm3d", reason="bm3d is free for non-commercial use only")
    depth = np.full((24, 30), 800 if kind == "full" else 0, np.float32)
    if kind == "pixel":
        depth[12, 12] = 700
    if kind == "corner":
        depth[:3, :3] = 650
    method = loaded(spec)
    before = depth.copy()
    parts = method.estimate(depth[None]).composites()
    out = parts["" if "" in parts else DEFAULT_COMPOSITE]
    np.testing.assert_array_equal(depth, before)
    assert np.isfinite(out).all()
    if kind == "empty":
        assert not out.any()
    if kind == "full":
        # face-stereo denoises maps without noise too (keep_clean=0).
        np.testing.assert_allclose(out, 800, atol=10 if spec == "face-stereo" else 1e-3)
    if "cleanup" not in spec and spec in MASKED:
        np.testing.assert_allclose(out[depth > 0], depth[depth > 0], atol=1e-2)


@pytest.mark.parametrize(("spec", "degree"), [("plane", 1), ("quadric", 2)])
def test_polynomials_are_kept_with_holes_too(spec: str, degree: int) -> None:
    y, x = np.mgrid[:30, :34].astype(np.float64)
    surface = 900 + 2 * x - 1.5 * y + (0.05 * x * x - 0.03 * x * y if degree == 2 else 0)
    rng = np.random.default_rng(0)
    depth = np.where(rng.random(surface.shape) < 0.2, 0, surface).astype(np.float32)
    out = run(f"{spec}:sigma_px=2", depth)
    np.testing.assert_allclose(out[depth > 0], depth[depth > 0], atol=0.02)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_local_polynomial_is_weighted_least_squares(degree: int) -> None:
    sigma, row, column = 1.5, 20, 24
    spec = {0: "masked_gaussian", 1: "plane", 2: "quadric"}[degree]
    ours = run(f"{spec}:sigma_px={sigma}")[row, column]
    radius = 4
    part = NOISY[row - radius : row + radius + 1, column - radius : column + radius + 1]
    v, u = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(np.float64)
    basis = [u**p * v**q for p in range(degree + 1) for q in range(degree + 1 - p)]
    weight = np.sqrt(np.exp(-(u**2 + v**2) / (2 * sigma**2)) * (part > 0)).ravel()
    design = np.stack([b.ravel() for b in basis], 1) * weight[:, None]
    target = part.ravel().astype(np.float64) * weight
    value = np.linalg.lstsq(design, target, rcond=None)[0][0]
    assert ours == pytest.approx(value, abs=1e-2)


def test_masked_median_and_bilateral_by_hand() -> None:
    row, column = 20, 24
    part = NOISY[row - 2 : row + 3, column - 2 : column + 3]
    assert run("masked_median:size=5")[row, column] == np.median(part[part > 0])
    window = NOISY[row - 3 : row + 4, column - 3 : column + 4].astype(np.float64)
    v, u = np.mgrid[-3:4, -3:4]
    weight = np.exp(-(u**2 + v**2) / 8 - (window - NOISY[row, column]) ** 2 / 200) * (window > 0)
    expected = (weight * window).sum() / weight.sum()
    ours = run("masked_bilateral:diameter=7,sigma_mm=10,sigma_px=2")[row, column]
    assert ours == pytest.approx(expected, abs=1e-2)


def test_clean_up_closes_holes_and_takes_islands_away() -> None:
    depth = CLEAN.copy()
    depth[20, 20:22] = 0
    depth[2, 2] = 700
    depth[18, 30] = 500
    out = run("quadric:cleanup=5", depth)
    assert (out[20, 20:22] > 880).all()
    assert out[2, 2] == 0
    assert out[18, 30] == pytest.approx(CLEAN[18, 30], abs=3)


def test_temporal_filters() -> None:
    stack = np.stack([noisy(CLEAN, seed) for seed in range(5)])
    median = load_denoiser("temporal_median")
    assert (median.before, median.after) == (1, 1)
    out = median.estimate(stack[1:4], 1).composite("")
    three = np.where(stack[1:4] > 0, stack[1:4], np.nan)
    kept = (stack[1:4] > 0).sum(0) >= 2
    expected = np.zeros_like(CLEAN)
    expected[kept] = np.nanmedian(three[:, kept], axis=0)
    np.testing.assert_allclose(out, expected)
    adaptive = load_denoiser("adaptive:frames=5")
    assert (adaptive.before, adaptive.after) == (4, 0)
    smooth = adaptive.estimate(stack, 4).composite("")
    inner = (smooth > 0) & (CLEAN > 0)
    error = [(d - CLEAN)[inner].std() for d in (stack[4], smooth)]
    assert error[1] < 0.8 * error[0]
    moved = stack.copy()
    moved[:4] += 100 * (moved[:4] > 0)
    np.testing.assert_array_equal(adaptive.estimate(moved, 4).composite(""), stack[4])
    # A network with average=5 sees the same means of still pixels.
    face, of_five = (load_denoiser(f"face{end}") for end in ("", ":average=5"))
    mean = load_denoiser("adaptive:frames=5,threshold_mm=100").estimate(stack, 4).composite("")
    for frames, seen in ((stack, mean), (moved, stack[4])):
        depth_mm = of_five.estimate(frames, 4).depth_mm
        np.testing.assert_array_equal(depth_mm, face.estimate(seen[None]).depth_mm)


def test_soft_validity_gives_four_composites(here: Path) -> None:
    (here / "my_denoiser.py").write_text(
        "import numpy as np\n"
        "def soft(noisy, valid, level=0.75):\n"
        "    noisy += 10\n"
        "    return noisy, np.where(valid, level, 0.2)\n"
        "class Later:\n"
        "    before = 1\n"
        "    def __call__(self, noisy, valid, now):\n"
        "        return noisy[0], valid[0]\n"
    )
    parts = load_denoiser("my_denoiser:soft:level=0.5").estimate(NOISY[None]).composites()
    np.testing.assert_allclose(parts["soft"][NOISY > 0], 0.5 * (NOISY[NOISY > 0] + 10))
    assert set(parts) == set(COMPOSITES)
    assert not parts["hard"].any()
    np.testing.assert_array_equal(parts["input mask"], np.where(NOISY > 0, NOISY + 10, 0))
    later = load_denoiser("mine@my_denoiser:Later")
    assert later.label == "mine"
    both = np.stack([NOISY, CLEAN])
    np.testing.assert_array_equal(later.estimate(both, 1).composite(""), NOISY)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("medan", "did you mean 'median'"),
        ("median:sze=5", "did you mean 'size'"),
        ("median:size=4", "size 3 or 5"),
        ("median:size=five", "whole number"),
        ("quadric:sigma_px=100", r"\[0.7, 20\]"),
        ("median:size", "name=value"),
        ("", "give a name"),
        ("no_such_module:function", "cannot be imported"),
        ("math:no_such_function", "has no 'no_such_function'"),
        ("math:pi", "no function"),
        ("run/none.pt", "no such file: give best.pt"),
        ("a_run", "is the folder of a run: give a_run/best.pt"),
    ],
)
def test_wrong_specifications(spec: str, words: str, here: Path) -> None:
    (here / "a_run").mkdir()
    (here / "a_run" / "best.pt").touch()
    not_loaded = re.search("math|module|none", spec) is not None
    with pytest.raises(DenoiserError if not_loaded else ConfigError, match=words):
        load_denoiser(spec)


def test_a_parameter_is_added_as_a_person_would_type_it(here: Path) -> None:
    shutil.copy(shipped_file("face"), here / "mine.onnx")
    for spec, longer in (
        ("face", "face:average=8"),
        ("face:keep_clean=0", "face:keep_clean=0,average=8"),
        ("face:average=2,mirror=1", "face:average=8,mirror=1"),
        ("mine.onnx", "mine.onnx:average=8"),
        (f"still@{here}/mine.onnx:mirror=1", f"still@{here}/mine.onnx:mirror=1,average=8"),
    ):
        assert with_parameter(spec, "average", 8) == longer
        assert load_denoiser(longer).before == 7


def test_a_function_of_a_file_or_a_module_here(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "here_code.py").write_text(
        "def moved(noisy_mm, valid, by_mm=0):\n    return noisy_mm + by_mm, valid\n"
    )
    monkeypatch.setattr(sys, "path", [*sys.path])
    for code in ("here_code", "here_code.py", str(here / "here_code.py")):
        denoiser = load_denoiser(f"{code}:moved:by_mm=3")
        assert denoiser(np.full((4, 4), 900, np.uint16)).depth_mm.max() == 903


def test_every_denoiser_is_described_and_every_grid_loads() -> None:
    for name in denoiser_names():
        help, parameters = describe_denoiser(name)
        assert help
        assert all(text for _, text in parameters.values())
    for name in GRIDS:
        for spec in tuning_specs(name, (0, *CLEANUPS)):
            assert load_denoiser(spec).label == spec
