"""Total generalised variation: adjoints, planes, steps, holes; BM3D where its package is there."""

import cv2
import numpy as np
import pytest

from glsim.core.array_types import Depth, Mask
from glsim.denoise.filters.block_matching import noise_spectrum
from glsim.denoise.filters.tgv import SurfaceGradients
from glsim.denoise.registry import load_denoiser
from glsim.networks.safeguards import estimate_noise_mm, local_noise_mm, noise_share

SIGMA_MM = 2.0
RNG = np.random.default_rng
Y, X = np.mgrid[:64, :80].astype(np.float32)
PLANE: Depth = (900 + 0.8 * X - 0.5 * Y).astype(np.float32)
SPECS = ("tgv:alpha=2", "bm3d:correlation_px=0")


def noisy(depth_mm: Depth, seed: int = 0, smooth_px: float = 0.0) -> Depth:
    noise = RNG(seed).normal(0, 1, depth_mm.shape)
    if smooth_px:
        noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), smooth_px))
        noise /= noise.std()
    return np.where(depth_mm > 0, depth_mm + SIGMA_MM * noise, 0).astype(np.float32)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))


@pytest.fixture(params=SPECS)
def denoise(request: pytest.FixtureRequest) -> object:
    if request.param.startswith("bm3d"):
        pytest.importorskip("bm3d")
    return load_denoiser(request.param)


def test_the_adjoints_are_adjoint() -> None:
    """<K x, y> = <x, K* y>, with holes and a step, for both gradients."""
    depth = PLANE.copy()
    depth[:, 40:] += 300
    domain = RNG(1).random(PLANE.shape) > 0.1
    on = SurfaceGradients(depth, domain)
    u, w, v, p, q, xx, yy, xy = RNG(2).normal(size=(8, *PLANE.shape)).astype(np.float32)

    def dot(a: Depth, b: Depth) -> float:
        return float(np.vdot(a.astype(np.float64), b.astype(np.float64)))

    across, down = on.gradient(u)
    assert dot(across, p) + dot(down, q) == pytest.approx(dot(u, on.gradient_adjoint(p, q)), 1e-4)
    e_xx, e_yy, e_xy = on.symmetrised(w, v)
    back_w, back_v = on.symmetrised_adjoint(xx, yy, xy)
    left = dot(e_xx, xx) + dot(e_yy, yy) + 2 * dot(e_xy, xy)
    assert left == pytest.approx(dot(w, back_w) + dot(v, back_v), rel=1e-4)
    assert not across[:, 39].any()  # no difference over the step
    assert not across[~domain].any()


def test_noise_of_a_plane_is_smoothed_away_and_the_plane_stays(denoise: object) -> None:
    given = noisy(PLANE)
    depth, valid = denoise(given)  # type: ignore[operator]
    assert valid.all()
    error = (depth - PLANE)[5:-5, 5:-5]
    assert rms(error) < 0.3 * SIGMA_MM
    assert abs(error.mean()) < 0.1
    again, _ = denoise(given)  # type: ignore[operator]
    np.testing.assert_array_equal(depth, again)


def test_a_step_stays_where_it_is(denoise: object) -> None:
    step = PLANE.copy()
    step[:, 40:] += 400
    depth, _ = denoise(noisy(step))  # type: ignore[operator]
    assert np.abs(depth - step).max() < 4 * SIGMA_MM
    assert rms(depth - step) < 0.6 * SIGMA_MM


def test_holes_stay_holes_and_have_no_influence() -> None:
    given = noisy(PLANE)
    holes: Mask = (Y > 40) & (X > 50)
    with_holes = np.where(holes, 0, given).astype(np.float32)
    depth, valid = load_denoiser("tgv:alpha=2")(with_holes)
    np.testing.assert_array_equal(valid, ~holes)
    other, _ = load_denoiser("tgv:alpha=2")(np.where(holes, 3000, given).astype(np.float32))
    # The noise around a pixel is estimated without the windows that hold an edge.
    assert rms((depth - other)[~holes]) < 0.15 * SIGMA_MM
    assert rms((depth - PLANE)[~holes]) < 0.4 * SIGMA_MM


def test_bm3d_that_knows_the_correlation_smooths_correlated_noise() -> None:
    pytest.importorskip("bm3d")
    given = noisy(PLANE, smooth_px=0.8)
    told, untold = (
        rms((load_denoiser(f"bm3d:correlation_px={c}")(given)[0] - PLANE)[5:-5, 5:-5])
        for c in (0.8, 0)
    )
    assert told < 0.7 * untold


def test_the_spectrum_is_that_of_the_noise() -> None:
    spectrum = noise_spectrum(0.8, (64, 80))
    assert spectrum.mean() == pytest.approx(1, rel=1e-6)
    white, other = RNG(0).normal(size=(2, 100, 64, 80))
    smooth = [cv2.GaussianBlur(np.pad(w, 5, mode="wrap"), (0, 0), 0.8)[5:-5, 5:-5] for w in white]
    noise = np.sqrt(0.97) * np.array(smooth) / np.std(smooth) + np.sqrt(0.03) * other
    drawn = np.mean(np.abs(np.fft.fft2(noise)) ** 2, axis=0) / (64 * 80)
    assert (drawn / spectrum).mean() == pytest.approx(1, abs=0.1)
    assert (drawn / spectrum).std() < 0.2
    seen = [estimate_noise_mm((900 + frame).astype(np.float32)) or 0.0 for frame in noise[:20]]
    assert np.mean(seen) == pytest.approx(noise_share(spectrum), rel=0.03)
    assert noise_share(noise_spectrum(0.0)) == pytest.approx(1)


def test_local_noise_is_where_it_is() -> None:
    depth = PLANE + RNG(0).normal(0, 1, PLANE.shape) * np.where(X < 40, 1.0, 4.0)
    depth[:, 70:] = 0
    local = local_noise_mm(depth.astype(np.float32), 7.0)
    assert local[10:-10, 10:30].mean() == pytest.approx(1, rel=0.15)
    assert local[10:-10, 50:60].mean() == pytest.approx(4, rel=0.15)
    assert (local[:, 79] == 7.0).all()
