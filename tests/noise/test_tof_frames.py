"""Time-of-flight sensors: twins agree, frames repeat, crops are exact; the layer expected."""

import numpy as np
import pytest
from moderngl import Context

from glsim.core.rect import Rect
from tests.support.stage_harness import Z_MAX, z_mean
from tests.support.tof_harness import QUIET, Camera, face_scenes, merged, quad

SENSORS = [
    *("kinect-v2", "kinect-v2-fast", "azure-kinect"),
    pytest.param("azure-kinect-wfov", marks=pytest.mark.long),
]


@pytest.mark.parametrize(
    ("sensor", "faces"),
    [
        ("kinect-v2", 6),
        ("kinect-v2-fast", 6),
        pytest.param("azure-kinect", 6, marks=pytest.mark.long),
        pytest.param("azure-kinect-wfov", 6, marks=pytest.mark.long),
        pytest.param("kinect-v2", 100, marks=pytest.mark.long),
    ],
)
def test_twin_and_shader_agree(context: Context, sensor: str, faces: int) -> None:
    cam = Camera.open(context, sensor, expected=True)
    same, pixels, close, both = 0, 0, 0, 0
    # A frame with a wall takes ten times as long as one without.
    for seed, scene in enumerate(face_scenes(faces, wall_every=14)):
        drawn, computed = cam.shoot(scene, seed=seed), cam.twin(scene, seed=seed)
        one, other = drawn["depth"] > 0, computed["depth"] > 0
        same, pixels = same + (one == other).sum(), pixels + one.size
        apart = np.abs(drawn["depth"] - computed["depth"])[one & other]
        close, both = close + (apart <= 0.00101).sum(), both + len(apart)
        assert (drawn["reason"] == computed["reason"]).mean() >= 0.999
        assert np.abs(drawn["lit"] - computed["lit"]).mean() < 1e-4
        assert np.abs(drawn["expected"] - computed["expected"]).max() < 2e-5
        typical = np.abs(drawn["infrared"] - computed["infrared"])
        assert (typical > 0.01 * drawn["infrared"] + 1).mean() < 1e-3
    assert both > 20_000
    assert same >= 0.999 * pixels
    assert close >= 0.999 * both


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_crop_is_a_part_of_the_frame(context: Context, sensor: str) -> None:
    """Byte for byte: the margin of a crop is wider than the chain's reach."""
    cam = Camera.open(context, sensor)
    scene = [*face_scenes(1)[0], quad(2000.0)]
    image = cam.sensor.rig.intrinsics
    crop = Rect(image.width // 2 - 70, image.height // 2 - 60, 140, 120)
    whole, part = cam.shoot(scene), cam.shoot(scene, crop=crop)
    with cam.renderer.render(scene, crop) as rendered:
        window = rendered.window
    inner = Rect(crop.left - window.left, crop.top - window.top, crop.width, crop.height)
    for name in ("depth", "reason", "infrared"):
        np.testing.assert_array_equal(whole[name][crop.slices], part[name][inner.slices], name)


def test_a_lens_that_distorts_keeps_planes_plane(context: Context) -> None:
    cam = Camera.open(context, deliver="raw")
    layers = cam.shoot([quad(1200.0)], QUIET)
    depth = layers["depth"][40:-40, 40:-40]
    assert (depth > 0).all()
    assert 1000 * np.abs(depth - 1.2).max() < 0.5


SENSORS_EXPECTED = SENSORS[:3]
CROP = Rect(235, 185, 40, 40)

#: Parameters without anything that a denoiser has to remove.
STILL = {
    "tof_taps": {
        "read_variance": 0.0, "shot_variance": 0.0, "companding": 0.0, "psf_sigma_px": 0.0,
        "halo": 0.0, "haze": 0.0, "saturation_lsb": 16320.0,
    },
    "tof_fast": {
        "read_variance": 0.0, "shot_variance": 0.0, "sigma_mm": 0.0, "lateral_px": 0.0,
        "saturation_lsb": 16320.0,
    },
    "tof_floor": {"enabled": 0.0},
    "fixed_pattern": {"enabled": 0.0},
    "range_gate": {"enabled": 0.0},
    "millimetre_quantise": {"enabled": 0.0},
}  # fmt: skip


def still(cam: Camera, **light: float) -> dict[str, dict[str, float]]:
    """Return STILL for the stages of a camera; light: parameters of its light stage."""
    names = {stage.name for stage in cam.sensor.stages}
    own = "tof_light" if "tof_light" in names else "tof_fast"
    return merged({name: STILL[name] for name in STILL if name in names}, {own: light})


@pytest.mark.parametrize("sensor", SENSORS_EXPECTED)
def test_a_still_sensor_says_what_is_expected(context: Context, sensor: str) -> None:
    """At all distances, for devices whose wiggling has other phases, with an offset and skin."""
    cam = Camera.open(context, sensor, expected=True)
    errors_mm = []
    for device in range(3):
        for z_mm in np.linspace(500, 4000, 15):
            light = {"offset_mm": 7.0 * (device - 1), "subsurface_mm": 5.0 * device, "gain": 500.0}
            scene = [quad(float(z_mm), albedo=0.6)]
            layers = cam.shoot(scene, still(cam, **light), device=device, crop=CROP)
            inner = (slice(12, -12), slice(12, -12))
            depth, expected, clean = (layers[n][inner] for n in ("depth", "expected", "clean"))
            assert (depth > 0).all()
            assert 1000 * np.abs(depth - expected).max() < 0.05
            errors_mm.append(1000 * np.median(expected - clean))
    assert np.ptp(errors_mm) > 10  # the offsets of the devices are in it


@pytest.mark.parametrize(
    "sensor",
    [
        "kinect-v2-fast",
        *(pytest.param(n, marks=pytest.mark.long) for n in ("kinect-v2", "azure-kinect")),
    ],
)
def test_the_mean_of_many_frames_approaches_it(context: Context, sensor: str) -> None:
    """Per pixel and with the fixed pattern off, of a wall and a slanted one."""
    cam = Camera.open(context, sensor, expected=True)
    changes = {"fixed_pattern": {"enabled": 0.0}, "millimetre_quantise": {"enabled": 0.0}}
    apart = []
    for z_mm, yaw_deg in ((850.0, 0.0), (1310.0, 30.0)):
        scene = [quad(z_mm, albedo=0.6, yaw_deg=yaw_deg)]
        shots = [cam.shoot(scene, changes, seed=s, crop=CROP) for s in range(60)]
        error = np.stack([1000 * (shot["depth"] - shot["expected"]) for shot in shots])
        error = error[:, 12:-12, 12:-12]
        # Neighbouring pixels' noise is correlated: one number per frame.
        means = error.mean(axis=(1, 2))
        assert abs(z_mean(means, 0.0)) < Z_MAX
        far = 1000 * np.abs(shots[0]["expected"] - shots[0]["clean"])[12:-12, 12:-12].mean()
        apart.append(far / (5 * means.std() / np.sqrt(len(means))))
    assert max(apart) > 1  # so the clean depth is not approached


@pytest.mark.parametrize("sensor", SENSORS_EXPECTED)
def test_wanting_it_changes_nothing_else(context: Context, sensor: str) -> None:
    plain, wanting = Camera.open(context, sensor), Camera.open(context, sensor, expected=True)
    scene = [*face_scenes(1)[0], quad(2000.0)]
    without, layers = plain.shoot(scene), wanting.shoot(scene)
    assert "expected" not in without
    for name, image in without.items():
        assert image.tobytes() == layers[name].tobytes(), name
    assert ((layers["expected"] > 0) == (layers["clean"] > 0)).all()
    assert 1000 * np.abs(layers["expected"] - layers["clean"]).max() < 10
