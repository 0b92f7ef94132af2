"""A device's own wiggling: what the simulated sensor adds is what is subtracted."""

from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.bench import scenes
from glsim.cli import main
from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError
from glsim.core.files.png import encode_png, read_image
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from glsim.sensors.wiggling import Wave, remove_wiggling, wiggling_mm
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.planted_frames import encoded

MHZ = (80.0, 16.0, 120.0)
HARMONICS = {
    "harmonic_2": 0.012, "harmonic_2_phase_deg": 60.0,
    "harmonic_5": 0.005, "harmonic_5_phase_deg": -100.0,
    "harmonic_phase_spread": 0.0,
}  # fmt: skip
DISTANCES_MM = (700, 850, 1000, 1150, 1300)


def device_file(folder: Path, pattern_mm: np.ndarray | None = None) -> Path:
    """kinect-v2-fast with fixed harmonics, and the pattern of one device."""
    text = (SENSOR_FOLDER / "kinect-v2-fast.toml").read_text()
    values = "".join(f"{key} = {value}\n" for key, value in HARMONICS.items())
    text = text.replace('use = "tof_fast"\n', f'use = "tof_fast"\n{values}')
    waves = ", ".join(
        f"{{harmonic = {h}, modulation_mhz = {mhz}, size = {HARMONICS[f'harmonic_{h}']}, "
        f"phase_deg = {HARMONICS[f'harmonic_{h}_phase_deg']}}}"
        for h in (2, 5)
        for mhz in MHZ
    )
    text = text.replace("[rig]\n", f"[rig]\nwiggling = [{waves}]\n", 1)
    if pattern_mm is not None:
        np.save(folder / "pattern.npy", pattern_mm.astype(np.float32))
        text = text.replace("[rig]\n", '[rig]\nfixed_pattern_map = "pattern.npy"\n', 1)
    (folder / "device.toml").write_text(text)
    return folder / "device.toml"


def test_one_wave_has_its_size_period_and_phase() -> None:
    distance = np.linspace(0.5, 4.0, 2001)
    wave = Wave(harmonic=2, modulation_mhz=120, size=0.01, phase_deg=40)
    found = wiggling_mm(distance, [wave], MHZ)
    turn = 2 * np.pi * 3 * distance / (3e8 / 2 / 120e6)
    np.testing.assert_allclose(found, -110.5 * 0.01 * np.sin(turn - np.radians(40)), atol=0.01)


def test_removal_is_the_inverse_of_the_error() -> None:
    camera = Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0)
    rays, emitter = camera.rays(), (0.045, 0.0, 0.0)
    waves = [
        Wave(harmonic=h, modulation_mhz=f, size=0.013, phase_deg=p)
        for h, f, p in ((2, 80, 10), (2, 120, -170), (5, 16, 80))
    ]
    true_mm = 600 + 2000 * np.random.default_rng(0).random((48, 64))
    z = 1e-3 * true_mm[..., None] * np.concatenate([rays, np.ones((48, 64, 1))], -1)
    half = 0.5 * (np.linalg.norm(z, axis=-1) + np.linalg.norm(z - emitter, axis=-1))
    wrong = half + 1e-3 * wiggling_mm(half, waves, MHZ)
    # libfreenect2: depth from the path, with the emitter beside the lens.
    direction = np.concatenate([rays, np.ones((48, 64, 1))], -1)
    stretch = np.linalg.norm(direction, axis=-1)
    measured_mm = 1e3 * (4 * wrong**2 - 0.045**2) / (4 * wrong * stretch - 2 * 0.045 * rays[..., 0])
    assert np.abs(measured_mm - true_mm).max() > 1
    measured_mm[0, :5] = 0
    found = remove_wiggling(measured_mm, waves, MHZ, rays, emitter)
    assert not found[0, :5].any()
    np.testing.assert_allclose(found[1:], true_mm[1:], atol=0.01)


@pytest.mark.long
def test_calibration_takes_bias_and_pattern_from_planes(context: Context, tmp_path: Path) -> None:
    """Bias by distance falls from 1 mm and more to below 0.15 mm; the pattern goes."""
    pattern = np.random.default_rng(0).normal(0, 0.8, (424, 512))
    file = device_file(tmp_path, pattern)
    camera = VirtualCamera(str(file), context, seed=3)
    frames = tmp_path / "frames"
    frames.mkdir()
    truth = {}
    for distance in DISTANCES_MM:
        shot = camera.capture(scenes.wall(distance), 1, None, scene=f"wall {distance}")
        (frames / f"{distance}.png").write_bytes(encode_png(encoded(shot)[0]))
        truth[distance] = shot.truth_mm
    whole = ("-d", "noisy", "--out-unit-mm", "1")
    for out, extra in (("raw", ()), ("calibrated", ("--device", str(file)))):
        assert main(["denoise", str(frames), "-o", str(tmp_path / out), *whole, *extra]) == 0
    middle = np.s_[130:290, 170:340]
    bias, spread = {}, {}
    for out in ("raw", "calibrated"):
        error = [
            (read_image(tmp_path / out / f"{d}.png").astype(float) - truth[d])[middle]
            for d in DISTANCES_MM
        ]
        bias[out] = np.array([np.mean(e) for e in error])
        spread[out] = np.mean(error, axis=0).std()
    assert np.abs(bias["raw"]).max() > 1.0
    assert np.abs(bias["calibrated"]).max() < 0.15
    assert spread["calibrated"] ** 2 < spread["raw"] ** 2 - 0.7 * 0.8**2


def test_a_fitted_sensor_holds_the_waves_that_it_measured(context: Context, tmp_path: Path) -> None:
    """Phases that differ between the frequencies have no place in a stage, but in the file."""
    from glsim.bench.fit.fit_wiggling import fit_wiggling
    from glsim.bench.fit.recording_statistics import measure_recording
    from glsim.bench.fit.time_of_flight import fitted_toml
    from tests.bench.test_wiggling import EMITTER_M, FRAMES, IMAGE, walls
    from tests.support.planted_frames import frames_of

    changes = {"tof_fast": {"harmonic_2": 0.015, "harmonic_5": 0.0}}  # phases are drawn
    camera = VirtualCamera("kinect-v2-fast", context, seed=5)
    shot = camera.capture(walls(35.0), FRAMES, None, changes=changes)
    statistics = measure_recording(frames_of("walls", encoded(shot), camera=IMAGE))
    wiggling = fit_wiggling(statistics, IMAGE, EMITTER_M)
    sensor, file = load_sensor("kinect-v2-fast"), tmp_path / "mine.toml"
    file.write_text(fitted_toml(sensor, {}, IMAGE, ["walls"], "", wiggling.waves()))
    sensor = load_sensor(str(file))
    assert [(w.harmonic, w.modulation_mhz) for w in sensor.wiggling] == [(2, 80), (2, 120)]


@pytest.mark.parametrize(
    ("waves", "words"),
    [
        ("{harmonic = 3, modulation_mhz = 80, size = 0.01, phase_deg = 0}", "not one of 2, 5"),
        ("{harmonic = 2, modulation_mhz = 90, size = 0.01, phase_deg = 0}", "90 MHz is none"),
        ("{harmonic = 2, modulation_mhz = 80, size = 2.0, phase_deg = 0}", "size"),
    ],
)
def test_wrong_waves_are_refused(tmp_path: Path, waves: str, words: str) -> None:
    text = (SENSOR_FOLDER / "kinect-v2-fast.toml").read_text()
    text = text.replace("[rig]\n", f"[rig]\nwiggling = [{waves}]\n", 1)
    (tmp_path / "x.toml").write_text(text)
    with pytest.raises(ConfigError, match=words):
        load_sensor(str(tmp_path / "x.toml"))
