"""glsim fit: recordings with known noise give it back; recordings that cannot serve are refused."""

from __future__ import annotations

import tomllib
from pathlib import Path

import cv2
import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.cli import main
from glsim.errors import ConfigError, DatasetError
from glsim.fit import fit_noise_model, fitted_values, measure_recording, read_recording
from glsim.fit.recording import Recording
from glsim.geometry.camera import Intrinsics
from glsim.sensors.sensor import load_sensor
from glsim.validate import VirtualCamera, published_curves, scenes

IMAGE = Intrinsics(512, 424, 365.456, 365.456, 254.878, 205.395)
EMITTER_M = (0.045, 0.0, 0.0)

GAIN, FLOOR_MM = 250.0, 0.8
PATTERN = {"pixel_sigma_mm": 0.7, "column_sigma_mm": 0.3, "row_step_mm": 0.5}


def write(folder: Path, frames: NDArray[np.generic]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{number:04d}.png"), frame)
    return folder


def pattern_mm(pattern: dict[str, float]) -> float:
    """All of a fixed pattern as one standard deviation."""
    step = pattern["row_step_mm"] / 2
    return float(
        np.sqrt(pattern["pixel_sigma_mm"] ** 2 + pattern["column_sigma_mm"] ** 2 + step**2)
    )


def record(context: moderngl.Context, sensor: str, folder: Path) -> Path:
    """A sensor of other constants before six walls, side by side, 0.7 to 4.2 m away."""
    half_px = 300.0  # of the image from its centre: all of it
    distances = (700.0, 1200.0, 1800.0, 2600.0, 3400.0, 4200.0)
    limits = np.linspace(-half_px, half_px, len(distances) + 1) / IMAGE.fx
    strips = [
        scenes.rectangle((a * z, b * z), (-half_px * z / IMAGE.fx, half_px * z / IMAGE.fx), z)
        for z, a, b in zip(distances, limits[:-1], limits[1:], strict=True)
    ]
    light = "tof_fast" if sensor == "kinect-v2-fast" else "tof_light"
    floor = "tof_fast" if sensor == "kinect-v2-fast" else "tof_floor"
    changes: dict[str, dict[str, float]] = {light: {"gain": GAIN}, "fixed_pattern": PATTERN}
    changes.setdefault(floor, {})["sigma_mm"] = FLOOR_MM
    camera = VirtualCamera(sensor, context, seed=3)
    capture = camera.capture(scenes.merge_meshes(*strips), 30, None, changes=changes)
    return write(folder, capture.encoded)


@pytest.fixture(scope="module")
def recording(_session_context: moderngl.Context, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(_session_context, "kinect-v2", tmp_path_factory.mktemp("recording"))


def check_loop(folder: Path, out: Path, base: str) -> None:
    """The fitted file has the constants of the recording within a tenth."""
    assert main(["fit", str(folder), "-o", str(out), "--base", base]) == 0
    stages = {s["use"]: s for s in tomllib.loads(out.read_text())["stage"]}
    fitted = {k: v for stage in stages.values() for k, v in stage.items()}
    pattern = stages["fixed_pattern"]
    assert fitted["gain"] == pytest.approx(GAIN, rel=0.1)
    assert fitted["sigma_mm"] == pytest.approx(FLOOR_MM, rel=0.1)
    assert pattern_mm(pattern) == pytest.approx(pattern_mm(PATTERN), rel=0.1)
    assert pattern["pixel_sigma_mm"] == pytest.approx(PATTERN["pixel_sigma_mm"], rel=0.1)
    assert pattern["row_step_mm"] == pytest.approx(PATTERN["row_step_mm"], rel=0.1)
    sensor = load_sensor(str(out))
    assert sensor.rig.intrinsics == IMAGE
    assert [s.name for s in sensor.stages] == [s.name for s in load_sensor(base).stages]


def test_the_loop_closes(recording: Path, tmp_path: Path) -> None:
    check_loop(recording, tmp_path / "mine.toml", "kinect-v2")


def test_the_loop_closes_for_the_fast_sensor(context: moderngl.Context, tmp_path: Path) -> None:
    folder = record(context, "kinect-v2-fast", tmp_path / "frames")
    check_loop(folder, tmp_path / "mine.toml", "kinect-v2-fast")


def test_what_it_prints(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(recording), "-o", str(tmp_path / "mine.toml")]) == 0
    printed = capsys.readouterr().out
    for words in ("amplitude of a white wall", "floor", "fixed pattern", "beside depth edges"):
        assert words in printed
    assert "1.1 to 1.5 m" in printed


def test_statistics_of_a_recording(recording: Path) -> None:
    found = measure_recording(read_recording([recording]), IMAGE)
    assert found.frames == 30
    assert found.correlation[:4] == pytest.approx((1, 0.63, 0.25, 0), abs=0.06)
    assert found.edge_pixels > 1000
    assert 0.3 < found.invalid_share < 1
    assert found.flying_share < 0.1
    far = [c.sigma_mm for c in found.table if c.distance_m[0] >= 2.5]
    near = [c.sigma_mm for c in found.table if c.distance_m[1] <= 1.5]
    assert min(far) > max(near) * 0.9


def test_law_without_a_simulator() -> None:
    """Five walls side by side, white noise of the law of the fit, no fixed pattern."""
    rng = np.random.default_rng(1)
    z = np.repeat([700.0, 1200.0, 2000.0, 3000.0], 128)[None].repeat(IMAGE.height, axis=0)
    stretch = np.linalg.norm(np.dstack([IMAGE.rays(), np.ones(z.shape)]), axis=-1)
    amplitude = GAIN / (z / 1000 * stretch) ** 2 / stretch
    sigma = np.hypot(FLOOR_MM, published_curves.white_sigma_mm(amplitude) / stretch)
    depth = np.rint(z + rng.normal(0, 1, (20, *z.shape)) * sigma).astype(np.uint16)
    found = measure_recording(Recording(depth, 1.0, "synthetic"), IMAGE)
    model = fit_noise_model(found, IMAGE, 1.0, 1.0, 0.0, (0.0, 0.0, 0.0))
    assert model.knows_amplitude
    assert model.amplitude == pytest.approx(GAIN, rel=0.05)
    assert model.floor_mm == pytest.approx(FLOOR_MM, rel=0.05)
    assert found.pattern_mm < 0.12
    assert found.correlation[1] == pytest.approx(0, abs=0.02)


def test_one_wall_does_not_tell_the_amplitude() -> None:
    rng = np.random.default_rng(2)
    depth = np.rint(800 + rng.normal(0, 1.0, (12, 424, 512))).astype(np.uint16)
    found = measure_recording(Recording(depth, 1.0, "wall"), IMAGE)
    model = fit_noise_model(found, IMAGE, 1.0, 1.0, 4.0, EMITTER_M)
    assert not model.knows_amplitude
    assert "gain" not in fitted_values(found, model)
    assert "edge_invalid" not in fitted_values(found, model)


def test_holes_and_units(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    depth = (4 * (900 + rng.normal(0, 1.5, (10, 60, 80)))).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.01] = 0
    folder = write(tmp_path / "quarter", depth)
    image = Intrinsics(80, 60, 100, 100, 40, 30)
    found = measure_recording(read_recording([folder], 0.25), image)
    assert float(np.sqrt(np.nanmean(found.variance_mm2))) == pytest.approx(1.5, rel=0.05)
    files = sorted(folder.glob("*.png"))
    assert read_recording(files, 0.25).depth.shape == (10, 60, 80)


def wall(frames: int = 3, shape: tuple[int, int] = (48, 64)) -> NDArray[np.uint16]:
    return np.full((frames, *shape), 900, np.uint16)


def test_recordings_that_cannot_serve(tmp_path: Path) -> None:
    def refused(kind: type[Exception], match: str, *paths: Path) -> None:
        with pytest.raises(kind, match=match) as caught:
            read_recording(paths)
        assert "\n" not in str(caught.value)

    (tmp_path / "empty").mkdir()
    refused(DatasetError, "holds no .png files", tmp_path / "empty")
    refused(ConfigError, "no such file or folder", tmp_path / "missing")
    refused(DatasetError, "one frame only", write(tmp_path / "single", wall(1)))
    mixed = write(tmp_path / "mixed", wall())
    cv2.imwrite(str(mixed / "0001.png"), wall(1, (24, 32))[0])
    refused(DatasetError, "0001.png: is 32x24, but 0000.png is 64x48", mixed)
    refused(
        DatasetError, "1 channels of 8 bits", write(tmp_path / "bytes", wall().astype(np.uint8))
    )
    refused(DatasetError, "no pixel of any frame has depth", write(tmp_path / "holes", 0 * wall()))
    broken = write(tmp_path / "broken", wall())
    (broken / "0002.png").write_bytes(b"not a picture")
    refused(DatasetError, "0002.png: is no readable image", broken)
    with pytest.raises(ConfigError, match="--depth-unit-mm 0"):
        read_recording([mixed], 0)


def test_a_scene_without_smooth_surfaces_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    noise = rng.integers(500, 4000, (48, 64)).astype(np.uint16)[None].repeat(4, axis=0)
    noise[:, ::7] = 0
    noise[:, :, ::7] = 0
    recording = read_recording([write(tmp_path / "mess", noise)])
    with pytest.raises(DatasetError, match="belong to smooth surfaces"):
        measure_recording(recording, Intrinsics(64, 48, 50, 50, 32, 24))


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ([], 2, "the base sensor's 512x424: give --focal-px"),
        (["--focal-px", "50", "--centre-px", "3"], 2, "--centre-px 3: give two numbers, x,y"),
        (["-o", "sensor.json"], 2, "give a name that ends in .toml"),
        (["--base", "kinect-v1"], 2, "no fit starts from 'kinect-v1'"),
    ],
)
def test_command_refuses(
    arguments: list[str], status: int, message: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    folder = write(tmp_path / "wall", wall())
    assert main(["fit", str(folder), *arguments]) == status
    line = capsys.readouterr().err
    assert message in line
    assert line.count("\n") == 1


def test_any_size_with_its_focal_length(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    depth = np.rint(900 + rng.normal(0, 1, (6, 96, 128))).astype(np.uint16)
    out = tmp_path / "out" / "small.toml"
    folder = write(tmp_path / "small", depth)
    assert main(["fit", str(folder), "-o", str(out), "--focal-px", "110"]) == 0
    assert load_sensor(str(out)).rig.intrinsics == Intrinsics(128, 96, 110, 110, 64, 48)
