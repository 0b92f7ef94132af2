"""The layer expected: what a sensor says without noise, blur, edges and fixed pattern."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.core.rect import Rect
from tests.support.stage_harness import Z_MAX, z_mean
from tests.support.tof_harness import Camera, face_scenes, merged, quad

SENSORS = ["kinect-v2", "kinect-v2-fast", "azure-kinect"]
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


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_still_sensor_says_what_is_expected(context: moderngl.Context, sensor: str) -> None:
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


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_mean_of_many_frames_approaches_it(context: moderngl.Context, sensor: str) -> None:
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


@pytest.mark.parametrize("sensor", SENSORS)
def test_wanting_it_changes_nothing_else(context: moderngl.Context, sensor: str) -> None:
    plain, wanting = Camera.open(context, sensor), Camera.open(context, sensor, expected=True)
    scene = [*face_scenes(1)[0], quad(2000.0)]
    without, layers = plain.shoot(scene), wanting.shoot(scene)
    assert "expected" not in without
    for name, image in without.items():
        assert image.tobytes() == layers[name].tobytes(), name
    assert ((layers["expected"] > 0) == (layers["clean"] > 0)).all()
    assert 1000 * np.abs(layers["expected"] - layers["clean"]).max() < 10
