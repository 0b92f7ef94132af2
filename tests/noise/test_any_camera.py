"""Any depth camera: sizes of noise, its correlation, losses, silhouettes and systematic error."""

import numpy as np
import pytest
from moderngl import Context

from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext
from tests.support.stage_harness import (
    HEIGHT,
    WIDTH,
    Z_MAX,
    Image,
    flat,
    frame,
    run_shader,
    run_twin,
    z_mean,
    z_sd,
)

#: Noise stage without anything but the one part that a test sets.
QUIET = {
    "floor_mm": 0.0, "light_mm": 0.0, "smooth_mm": 0.0, "wiggle_mm": 0.0, "white_share": 1.0,
    "tail": 0.0,
}  # fmt: skip
#: Edges and light without anything but the one part that a test sets.
SHARP = {
    "growth_px": 0.0, "rough_px": 0.0, "cut_px": 0.0, "psf_px": 0.0, "haze": 0.0,
    "shadow_lit": 0.0, "shadow_between": 0.0,
}  # fmt: skip
KEPT = {
    "single_share": 0.0, "cluster_share": 0.0, "dark_signal": 0.0, "grazing_cosine": 0.0,
    "grazing_spread": 0.0, "saturated_signal": 1e6,
}  # fmt: skip


def facing(depth_m: float, at: FrameContext | None = None) -> dict[str, Image]:
    """Skin everywhere that faces the sensor along every ray, so that all pixels are alike."""
    layers = flat(depth_m, at=at or frame())
    layers["rays"] = np.zeros_like(layers["rays"])
    return layers


def errors_mm(depth_m: float, seed: int = 0, albedo: float = 0.6, **p: float) -> Image:
    layers = facing(depth_m)
    layers["albedo"][:] = albedo
    depth = run_twin("any_camera_noise", layers, frame(seed), **QUIET | p)["depth"]
    return 1000.0 * (depth - layers["depth"])


#: Depth (m), albedo, parameters and sigma: of the law of distance, and of light.
SIGMAS: list[tuple[float, float, dict[str, float], float]] = [
    *(
        (z, 0.6, {"floor_mm": 0.5, "light_mm": 1.0, "distance_power": power},
         float(np.hypot(0.5, (z / 0.9) ** power)))
        for z in (0.6, 0.9, 2.0) for power in (1.0, 2.5)
    ),
    *(
        (0.9, albedo, {"light_mm": 1.5, "light_power": power}, 1.5 * (0.6 / albedo) ** power)
        for albedo, power in ((0.15, 1.0), (0.15, 0.5), (0.3, 0.0))
    ),
    *(
        (z, albedo, {"inverse_per_m": 0.004, "floor_mm": 2.0}, float(np.hypot(4.0 * z * z, 2.0)))
        for z in (0.3, 0.9, 2.7) for albedo in (0.1, 0.6)
    ),
    (0.9, 0.6, {"inverse_per_m": 0.004, "max_sigma_mm": 0.1}, 0.1),
]  # fmt: skip


@pytest.mark.parametrize(("z_m", "albedo", "p", "sigma_mm"), SIGMAS)
def test_noise_has_no_bias_and_its_sigma(
    z_m: float, albedo: float, p: dict[str, float], sigma_mm: float
) -> None:
    error = errors_mm(z_m, albedo=albedo, **p)
    assert abs(z_mean(error)) < Z_MAX
    assert abs(z_sd(error, sigma_mm)) < Z_MAX


def test_a_part_of_the_noise_stays_with_the_device() -> None:
    """Frames of a device share the drawn part of the variance; devices do not."""
    p = QUIET | {"floor_mm": 1.0, "white_share": 0.0, "static_share": 0.6, "length_x_px": 2.0}
    layers = facing(0.9)

    def error(seed: int, device: int) -> Image:
        at = frame(seed, device_seed=device)
        drawn = run_twin("any_camera_noise", layers, at, **p, length_y_px=2.0)["depth"]
        return 1000.0 * (drawn - layers["depth"])

    def correlation(a: Image, b: Image) -> float:
        return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])

    apart = [error(seed, 3) for seed in range(6)]
    others = [error(seed, 100 + seed) for seed in range(6)]
    pairs = [(i, j) for i in range(6) for j in range(i)]
    same = np.mean([correlation(apart[i], apart[j]) for i, j in pairs])
    other = np.mean([correlation(others[i], others[j]) for i, j in pairs])
    # About 54,000 pixels, of which one in 10 is independent: each pair within 0.014.
    assert same == pytest.approx(0.6, abs=0.03)
    assert abs(other) < 0.03
    assert np.mean([e.std() for e in apart]) == pytest.approx(1.0, rel=0.03)


#: Measured correlation of the noise of RealSense cameras (plane residual of a D435, a D455 and a
#: D405; mean of rows and columns) at these distances, px.
LAGS = [1, 2, 3, 4, 6, 8, 12]
REALSENSE = [0.95, 0.90, 0.83, 0.75, 0.60, 0.40, 0.10]
#: The same of TrueDepth, unfiltered.
TRUEDEPTH = [0.85, 0.69, 0.56, 0.46, 0.28, 0.10, 0.0]


@pytest.mark.parametrize(
    ("length", "white", "measured"),
    [(8.0, 0.05, REALSENSE), pytest.param(5.0, 0.1, TRUEDEPTH, marks=pytest.mark.long)],
)
def test_noise_has_the_measured_correlation(
    length: float, white: float, measured: list[float]
) -> None:
    """The ranges of the sensor hold both settings."""
    p = {"length_x_px": length, "length_y_px": length, "white_share": white, "floor_mm": 2.0}
    errors = [errors_mm(0.9, seed, **p) / 2.0 for seed in range(40)]
    for axis, size in ((1, WIDTH), (0, HEIGHT)):
        found = [np.mean([_shifted_product(e, axis, lag, size) for e in errors]) for lag in LAGS]
        assert np.abs(np.array(found) - measured).max() < 0.11
        assert np.abs(np.array(found) - measured).mean() < 0.06


def _shifted_product(field: Image, axis: int, lag: int, size: int) -> float:
    ahead, behind = (
        np.take(field, np.arange(*ends), axis) for ends in ((lag, size), (0, size - lag))
    )
    return float((ahead * behind).mean())


def test_single_pixels_are_lost_at_the_drawn_rate() -> None:
    hits = _lost(single_share=0.02)
    assert abs((hits.mean() - 0.02) / np.sqrt(0.02 * 0.98 / hits.size)) < Z_MAX


def _lost(seed: int = 0, **p: float) -> Image:
    written = run_twin("any_camera_losses", facing(0.9), frame(seed), **KEPT | p)
    assert ((written["depth"] == 0) == (written["reason"] == Reason.DROPPED)).all()
    return written["depth"] == 0


def test_dark_grazing_and_bright_surfaces_are_lost_with_their_reasons() -> None:
    layers = facing(0.9)
    layers["albedo"][:, :100] = 0.012  # 0.02 of skin
    layers["normal"][:, 100:180] = (0.98, 0.0, -0.199, 0.0)
    bright = 0.3 * facing(1.0)["depth"]
    layers["depth"][:, 220:] = bright[:, 220:]  # 9 times the light
    p = {"dark_signal": 0.02, "dark_spread": 0.4, "grazing_cosine": 0.25, "saturated_signal": 5.0}
    written = run_twin("any_camera_losses", layers, frame(), **KEPT | p)
    reason = written["reason"]
    assert (reason[:, 100:180] == Reason.LOW_SIGNAL).all()
    assert (reason[:, 180:220] == Reason.VALID).all()
    assert (reason[:, 220:] == Reason.SATURATED).all()
    half = np.mean([
        (run_twin("any_camera_losses", layers, frame(n), **KEPT | p)["depth"] == 0)[:, :100].mean()
        for n in range(10)
    ])  # fmt: skip
    assert half == pytest.approx(0.5, abs=0.03)


#: Focal length times baseline of real cameras, px mm, and the step of their disparity, px.
LATTICES = {"D435 at 640x480": (19136.0, 1 / 32), "Kinect V1": (43500.0, 1 / 8)}


@pytest.mark.parametrize("camera", LATTICES)
def test_depth_is_a_constant_over_a_whole_number(camera: str) -> None:
    """After rounding to millimetres it is round(K / n), as in recordings of a D435."""
    focal_baseline, step = LATTICES[camera]
    p = KEPT | {"step_px": step, "focal_baseline_px_mm": focal_baseline}
    for z_m in (0.4, 0.9, 2.8):
        layers = facing(z_m)
        layers["depth"] = layers["depth"] + np.linspace(0, 0.1 * z_m, WIDTH, dtype=np.float32)
        layers["depth"] = run_twin("any_camera_losses", layers, frame(), **p)["depth"]
        constant, middle_mm = focal_baseline / step, 1050 * z_m
        steps_mm = np.diff(np.unique(1000 * layers["depth"]))
        assert np.median(steps_mm) == pytest.approx(middle_mm**2 / constant, rel=0.05)
        whole = run_twin("millimetre_quantise", layers, frame())["depth"]
        n = np.rint(constant / (1000.0 * layers["depth"].astype(np.float64)))
        np.testing.assert_array_equal(np.rint(1000 * whole), np.rint(constant / n))


def silhouette() -> dict[str, Image]:
    """A near half plane before a wall, 0.9 and 1.5 m; column 128 is the wall's first."""
    layers = facing(1.5)
    for name in ("clean", "depth"):
        layers[name][:, :128] = 0.9
    return layers


@pytest.mark.parametrize("growth", [-1.3, -0.5, 0.4, 1.0, 1.7])
def test_surfaces_grow_and_shrink_by_the_drawn_width(growth: float) -> None:
    """Fractions of a pixel are met in the mean along the silhouette."""
    p = SHARP | {"growth_px": growth, "edge_holes": 0.0, "rough_length_px": 1.0, "max_mixed": 1.0}
    widths = []
    for seed in range(5):
        depth = run_twin("any_camera_edges", silhouette(), frame(seed), **p)["depth"]
        assert set(np.unique(depth)) == {np.float32(0.9), np.float32(1.5)}
        widths.append((depth == np.float32(0.9)).sum(axis=1).mean() - 128)
    # On a straight edge the diagonal neighbours at 1.41 - 0.5 and 2.24 - 0.5 px count too.
    assert np.mean(widths) == pytest.approx(growth, abs=0.1)


def test_edges_are_cut_or_mixed_as_drawn() -> None:
    rows = silhouette()
    cut = run_twin("any_camera_edges", rows, frame(), **SHARP | {"cut_px": 1.0})
    lost = (cut["reason"] == Reason.EDGE).sum(axis=1)
    assert lost.mean() == pytest.approx(1.0, abs=0.1)
    assert (cut["reason"][:, :128] == Reason.VALID).all()
    mixes = SHARP | {"psf_px": 0.6, "light_mix": 0.0, "max_mixed": 1.0}
    linear = run_twin("any_camera_edges", rows, frame(), **mixes, wavelength_m=1e4)["depth"]
    assert ((linear > 0.9) & (linear < 1.5))[:, 126:130].all()
    weights = np.exp(-0.5 * (np.arange(-2, 3) / 0.6) ** 2)
    share = weights[3:].sum() / weights.sum()  # of the wall, in the last near pixel
    assert linear[50, 127] == pytest.approx(0.9 + 0.6 * share, abs=1e-3)
    phasor = run_twin("any_camera_edges", rows, frame(), **mixes, wavelength_m=2.0)["depth"]
    assert phasor[50, 127] < linear[50, 127] - 0.005  # the smaller part pulls less than linearly
    dropped = run_twin("any_camera_edges", rows, frame(), **mixes | {"max_mixed": 0.02})
    assert (dropped["reason"][:, 127:129] == Reason.MIXED).all()


def test_shadows_keep_the_drawn_share_of_depths() -> None:
    layers = silhouette()
    layers["lit"][:, 128:140] = 0.0
    p = SHARP | {"shadow_lit": 0.5, "shadow_kept": 0.1}
    for between in (0.0, 1.0):
        kept, behind = [], []
        for seed in range(8):
            drawn = p | {"shadow_between": between}
            written = run_twin("any_camera_edges", layers, frame(seed), **drawn)
            inside = written["depth"][:, 128:132]
            assert (written["reason"][:, 128:140][written["depth"][:, 128:140] == 0] == 2).all()
            kept.append(inside > 0)
            behind += list(inside[inside > 0])
        error = np.sqrt(0.1 * 0.9 / np.array(kept).size)
        assert abs(np.mean(kept) - 0.1) / error < Z_MAX
        assert (np.array(behind) < 1.499).mean() == pytest.approx(between, abs=0.02)


def test_expected_has_the_wave_of_the_device_and_nothing_random(context: Context) -> None:
    """Amplitude and period are found again by a fit; devices differ in phase."""
    z_m = np.linspace(0.6, 2.6, WIDTH)
    layers = facing(1.0)
    for name in ("clean", "depth"):
        layers[name] = np.broadcast_to(z_m, (HEIGHT, WIDTH)).astype(np.float32)
    layers["expected"] = layers["clean"].copy()
    p = QUIET | {"floor_mm": 3.0, "wiggle_mm": 2.5, "wiggle_period_m": 0.4, "offset_mm": 4.0}
    phases = []
    for device in range(3):
        at = frame(device, device_seed=device)
        written = run_shader(context, "any_camera_noise", layers, at, **p)
        twin = run_twin("any_camera_noise", layers, at, **p)
        assert 1000 * np.abs(written["expected"] - twin["expected"]).max() < 0.01
        error = 1000 * (written["expected"] - layers["clean"])[0].astype(np.float64)
        waves = [np.ones_like(z_m), np.cos(2 * np.pi * z_m / 0.4), np.sin(2 * np.pi * z_m / 0.4)]
        fit, rest, *_ = np.linalg.lstsq(np.stack(waves, -1), error, rcond=None)
        assert fit[0] == pytest.approx(4.0, abs=0.01)
        assert np.hypot(*fit[1:]) == pytest.approx(2.5, abs=0.01)
        assert rest[0] < 1e-2
        phases.append(np.arctan2(fit[1], fit[2]))
        noise = 1000 * (written["depth"] - written["expected"])
        assert abs(z_mean(noise)) < Z_MAX
        assert abs(z_sd(noise, 3.0)) < Z_MAX
    assert np.ptp(phases) > 0.3
