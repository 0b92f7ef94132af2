"""The time-of-flight pixel: taps, decoder, device's noise, filters, multipath."""

import numpy as np
import pytest
from moderngl import Context

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.twins.tof_decode import CONTRAST_MULTIPLIER, companded
from glsim.noise.twins.tof_light import unwrapped_cycles
from tests.support.stage_harness import Z_MAX, z_mean, z_sd
from tests.support.tof_harness import QUIET, Camera, Image, Placed, merged, quad

#: A crop around the principal point; the window is a little larger.
CROP = Rect(216, 172, 80, 64)
RAW = {"tof_bilateral": {"enabled": 0.0}, "tof_edge": {"enabled": 0.0}}


def phasors(layers: dict[str, Image]) -> np.ndarray:
    """(h, w, 3) complex phasors of the window without its rim."""
    a, b = layers["phasor_a"][8:-8, 8:-8], layers["phasor_b"][8:-8, 8:-8]
    return np.stack(
        [a[..., 0] + 1j * a[..., 1], a[..., 2] + 1j * a[..., 3], b[..., 0] + 1j * b[..., 1]], -1
    )


@pytest.mark.parametrize("z_mm", [900.0, 2500.0])
def test_noise_of_the_taps_has_its_variance(context: Context, z_mm: float) -> None:
    cam = Camera.open(context)
    changes = merged(RAW, {"tof_taps": {"companding": 0.0}})
    pure = phasors(cam.shoot([quad(z_mm)], merged(changes, QUIET), crop=CROP))
    wiggle = {"tof_light": {"harmonic_2": 0.0, "harmonic_5": 0.0}}
    for k in range(3):
        amplitude = np.abs(pure[..., k]).mean() / CONTRAST_MULTIPLIER[k]
        sigma = np.sqrt(2 / 3 * (16.5 + 0.0166 * amplitude)) * CONTRAST_MULTIPLIER[k]
        noise = [
            (phasors(cam.shoot([quad(z_mm)], merged(changes, wiggle), seed=s, crop=CROP)) - pure)
            for s in range(6)
        ]
        for part in (np.real(noise)[..., k], np.imag(noise)[..., k]):
            assert abs(z_mean(part)) < Z_MAX
            # The amplitude, and with it sigma, changes by 3 % over the window.
            assert abs(z_sd(part, sigma)) < Z_MAX + 0.01 * np.sqrt(2 * part.size)
        both = np.array([np.real(noise)[..., k].ravel(), np.imag(noise)[..., k].ravel()])
        assert abs(np.corrcoef(both)[0, 1]) < 0.02


def test_companding_is_the_code_of_the_kinect() -> None:
    steps = np.repeat([1, 1, 2, 4, 8, 16, 32, 64], 128)
    table = np.concatenate([[0], np.cumsum(steps)])[:1024].astype(np.float32)
    assert table[-1] == 16320
    np.testing.assert_array_equal(companded(table), table)
    np.testing.assert_array_equal(companded(-table), -table)
    taps = np.random.default_rng(0).uniform(-17000, 17000, 20000).astype(np.float32)
    nearest = table[np.abs(np.abs(taps)[:, None] - table).argmin(axis=1)]
    error = np.abs(np.abs(companded(taps)) - np.minimum(np.abs(taps), 16320))
    assert (error <= np.abs(nearest - np.minimum(np.abs(taps), 16320)) + 1e-3).all()


def test_light_spreads_as_measured(context: Context) -> None:
    """A bright strip: the share of its light in the columns beside it, by halo and haze."""
    cam = Camera.open(context)
    half = 1.5 * 900 / 365.456  # three columns, less what the rims miss
    scene = [quad(900.0, (-half, half)), quad(930.0, albedo=0.0)]
    spread = {"tof_taps": {"halo": 0.1, "haze": 0.0, "psf_sigma_px": 0.22}}
    sharp = {"tof_taps": {"halo": 0.0, "haze": 0.0, "psf_sigma_px": 0.0}}
    row, core = (
        np.abs(phasors(cam.shoot(scene, merged(RAW, QUIET, change))))[200, :, 1].astype(float)
        for change in (spread, sharp)
    )
    assert row.sum() == pytest.approx(core.sum(), rel=1e-3)
    centre = (np.arange(len(core)) * core).sum() / core.sum()
    variance = [((np.arange(len(v)) - centre) ** 2 * v).sum() / v.sum() for v in (row, core)]
    # A core of 0.22 px, and a halo whose variance along an axis is 0.30 + 0.71 px^2.
    assert variance[0] - variance[1] == pytest.approx(0.9 * 0.22**2 + 0.1 * 1.09, rel=0.1)


def test_much_light_saturates(context: Context) -> None:
    cam = Camera.open(context)
    layers = cam.shoot([quad(900)], {"tof_taps": {"saturation_lsb": 300.0}}, crop=CROP)
    inner = layers["reason"][8:-8, 8:-8]
    assert (inner == Reason.SATURATED).all()
    assert (layers["infrared"][8:-8, 8:-8] == 65535).all()
    assert not layers["depth"][8:-8, 8:-8].any()


def test_any_distance_is_unwrapped() -> None:
    """Up to the distance after which all phases repeat, 18.75 m, with errors of 0.1 of a phase."""
    f = np.array([80.0, 16.0, 120.0], np.float32)
    distance = np.linspace(0.3, 18.4, 40_000)
    cycles = distance[:, None] * f / 150.0
    error = np.random.default_rng(0).normal(0, 0.02, cycles.shape)
    phase = np.mod(cycles + error, 1.0).astype(np.float32)
    fast, slow, third = unwrapped_cycles(phase, f)
    found = (fast + slow + third) * 150.0 / f.sum()
    assert (np.abs(found - distance) < 0.2).mean() > 0.999


@pytest.mark.parametrize("z_mm", [600.0, 1500.0, 4200.0])
def test_geometry_of_the_emitter_is_undone(context: Context, z_mm: float) -> None:
    """A wall stays flat to the corners: the path over the emitter is 45 mm off centre."""
    cam = Camera.open(context)
    bright = {
        "tof_light": {"tail": 1.0, "gain": 1000.0},
        "tof_taps": {"psf_sigma_px": 0.0, "halo": 0.0, "haze": 0.0},  # they mix directions
    }
    layers = cam.shoot([quad(z_mm)], merged(QUIET, bright))
    error = 1000 * layers["depth"][2:-2, 2:-2] - z_mm  # filters end at the border
    assert np.abs(error).max() < 0.02 + 2e-5 * z_mm


CROP_DEVICE = Rect(215, 165, 80, 80)
EXACT = {"millimetre_quantise": {"enabled": 0.0}}
SENSORS = ["kinect-v2", "kinect-v2-fast"]


def walls(
    cam: Camera, frames: int, changes: dict[str, dict[str, float]], z_mm: float = 900.0
) -> Image:
    """(frames, h, w) mm of a wall, without the rim of the window."""
    shots = [
        cam.shoot([quad(z_mm)], changes, seed=seed, crop=CROP_DEVICE)["depth"]
        for seed in range(frames)
    ]
    return 1000 * np.stack(shots)[:, 12:-12, 12:-12]


def test_floor_alone_has_its_sigma(context: Context) -> None:
    cam = Camera.open(context)
    for sigma in (0.5, 1.1):
        changes = merged(QUIET, {"tof_floor": {"enabled": 1.0, "sigma_mm": sigma}})
        noise = walls(cam, 12, changes) - 900.0
        # Neighbours are alike: every third pixel of every third row is independent.
        independent = noise[:, ::3, ::3]
        assert abs(z_mean(independent)) < Z_MAX
        assert independent.std() == pytest.approx(sigma, rel=0.03)


def test_floor_grows_with_the_slope(context: Context) -> None:
    """A tenth of a pixel of 2.5 mm, times the tangent."""
    cam = Camera.open(context)
    changes = merged(QUIET, {"tof_floor": {"enabled": 1.0, "sigma_mm": 0.0}})
    scene = [quad(900.0, (-300, 300), (-300, 300), yaw_deg=60)]
    shots = [cam.shoot(scene, changes, seed=seed, crop=CROP_DEVICE)["depth"] for seed in range(12)]
    noise = 1000 * np.stack(shots)[:, 40:60, 40:60]
    sigma = np.sqrt(noise.var(axis=0, ddof=1).mean())
    assert sigma == pytest.approx(0.1 * 900 / 365.456 * np.tan(np.radians(60)), rel=0.1)


@pytest.mark.parametrize("z_mm", [900.0, 2000.0, 4000.0])
def test_the_fast_sensor_is_as_noisy(context: Context, z_mm: float) -> None:
    sigmas = [
        np.sqrt(walls(Camera.open(context, name), 12, EXACT, z_mm).var(axis=0, ddof=1).mean())
        for name in SENSORS
    ]
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.05)


def test_a_pixel_among_others_of_another_phase_is_marked(context: Context) -> None:
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


@pytest.mark.parametrize("deliver", ["raw", pytest.param("undistorted", marks=pytest.mark.long)])
def test_the_field_stop_cuts_the_same_directions_in_both_geometries(
    context: Context, deliver: str
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


ON = {"tof_multipath": {"enabled": 1.0}}


def corner() -> list[Placed]:
    """Two walls at a right angle, the corner 1.5 m away on the axis."""
    return [
        quad(1500.0, (0, 400), (-300, 300), yaw_deg=-45),
        quad(1500.0, (-400, 0), (-300, 300), yaw_deg=45),
    ]


def test_a_corner_is_bent(context: Context) -> None:
    cam = Camera.open(context)
    scene = corner()
    without, bent = cam.shoot(scene, QUIET), cam.shoot(scene, merged(QUIET, ON))
    inner = (without["depth"] > 0) & (bent["depth"] > 0)
    by_mm = 1000 * (bent["depth"] - without["depth"])[inner]
    assert 1.45 < without["depth"].max() < 1.55
    assert by_mm.min() > -0.2
    assert 3 < np.quantile(by_mm, 0.9) < 60
    assert (bent["infrared"] - without["infrared"])[inner].mean() > 0


def test_a_wall_and_a_ridge_stay(context: Context) -> None:
    cam = Camera.open(context)
    ridge = [
        quad(1200.0, (-400, 0), (-300, 300), yaw_deg=-45),
        quad(1200.0, (0, 400), (-300, 300), yaw_deg=45),
    ]
    for scene in ([quad(1200.0)], ridge):
        without, lit = cam.shoot(scene, QUIET), cam.shoot(scene, merged(QUIET, ON))
        both = (without["depth"] > 0) & (lit["depth"] > 0)
        apart = 1000 * np.abs(without["depth"] - lit["depth"])[both]
        assert np.quantile(apart, 0.99) < 0.05


def test_twin_agrees(context: Context) -> None:
    cam = Camera.open(context)
    drawn, computed = cam.shoot(corner(), ON), cam.twin(corner(), ON)
    one, other = drawn["depth"] > 0, computed["depth"] > 0
    assert (one == other).mean() >= 0.999
    apart = np.abs(drawn["depth"] - computed["depth"])[one & other]
    assert (apart <= 0.00101).mean() >= 0.999
