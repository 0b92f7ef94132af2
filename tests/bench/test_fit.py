"""glsim fit: recordings with known noise give it back; recordings that cannot serve are refused."""

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.bench import scenes
from glsim.bench.fit.fit_wiggling import fit_wiggling
from glsim.bench.fit.noise_model import LightProfile, TapNoise, fit_infrared, fit_noise_model
from glsim.bench.fit.recording_statistics import measure_recording, pattern_map, pattern_parameters
from glsim.cli import main
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError, DatasetError
from glsim.data.maps import open_maps
from glsim.measures.pattern import measure_pattern
from glsim.measures.static import mask_moving
from glsim.noise.registry import find_stage
from glsim.sensors.kinect_v2 import white_sigma_mm
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.planted_frames import encoded, frames_of
from tests.support.real_cameras import REAL_KINECT_V2, needs_real_kinect_v2
from tests.support.recordings import write_frames

IMAGE = Intrinsics(512, 424, 365.456, 365.456, 254.878, 205.395)

GAIN, FLOOR_MM = 1500.0, 0.8
PATTERN = {
    "pixel_sigma_mm": 0.5,
    "column_sigma_mm": 0.3,
    "row_sigma_mm": 0.4,
    "row_alternation_mm": 0.6,
    "row_step_mm": 0.0,
}


def read(*paths: Path, unit_mm: float = 1.0, infrared: Path | None = None) -> Frames:
    return open_maps(paths, unit_mm=unit_mm, infrared=infrared).read_static()


def record(context: Context, sensor: str, folder: Path) -> Path:
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
    return write_frames(folder, encoded(capture), capture.stack("infrared"))


@pytest.fixture(scope="module")
def recording(_session_context: Context, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(_session_context, "kinect-v2", tmp_path_factory.mktemp("recording"))


def check_loop(files: list[str], out: Path, base: str) -> dict[str, dict[str, float]]:
    """The fitted file has the constants of the recording within a tenth; its stages by name."""
    assert main(["fit", *files, "-o", str(out), "--base", base, "--no-proof"]) == 0
    stages = {s["use"]: s for s in tomllib.loads(out.read_text())["stage"]}
    fitted = {k: v for stage in stages.values() for k, v in stage.items()}
    assert fitted["gain"] == pytest.approx(GAIN, rel=0.1)
    assert fitted["sigma_mm"] == pytest.approx(FLOOR_MM, rel=0.1)
    # A device's rows and columns are a few hundred draws, of which the scene shows a part.
    for name, share in (
        ("pixel_sigma_mm", 0.1), ("column_sigma_mm", 0.15), ("row_sigma_mm", 0.15),
        ("row_alternation_mm", 0.1),
    ):  # fmt: skip
        assert stages["fixed_pattern"][name] == pytest.approx(PATTERN[name], rel=share), name
    sensor = load_sensor(str(out))
    assert sensor.rig.intrinsics == IMAGE
    assert [s.name for s in sensor.stages] == [s.name for s in load_sensor(base).stages]
    pattern = np.load(out.with_name(f"{out.stem}_fixed_pattern.npy"))
    assert (pattern.dtype, pattern.shape) == (np.float32, (IMAGE.height, IMAGE.width))
    return stages


def copy_depth(folder: Path, to: Path) -> Path:
    """The same recording without its infrared."""
    to.mkdir(parents=True)
    for file in folder.glob("*_depth.png"):
        (to / file.name).write_bytes(file.read_bytes())
    return to


@pytest.mark.parametrize("infrared", [True, False])
@pytest.mark.long
def test_the_loop_closes(recording: Path, tmp_path: Path, infrared: bool) -> None:
    folder = recording if infrared else copy_depth(recording, tmp_path / "depth")
    stages = check_loop([str(folder)], tmp_path / "mine.toml", "kinect-v2")
    if infrared:
        declared = find_stage("tof_taps").parameters["read_variance"].default
        base = tomllib.loads((SENSOR_FOLDER / "kinect-v2.toml").read_text())["stage"]
        own = {k: v for stage in base for k, v in stage.items()}.get("read_variance", declared)
        assert stages["tof_taps"]["read_variance"] == pytest.approx(own, rel=0.2)


@pytest.mark.long
def test_the_loop_closes_for_the_fast_sensor(context: Context, tmp_path: Path) -> None:
    folder = record(context, "kinect-v2-fast", tmp_path / "frames")
    check_loop([str(folder)], tmp_path / "mine.toml", "kinect-v2-fast")


def test_law_without_a_simulator() -> None:
    """Five walls side by side, white noise of the law of the fit, no fixed pattern."""
    rng = np.random.default_rng(1)
    z = np.repeat([700.0, 1200.0, 2000.0, 3000.0], 128)[None].repeat(IMAGE.height, axis=0)
    stretch = np.linalg.norm(np.dstack([IMAGE.rays(), np.ones(z.shape)]), axis=-1)
    amplitude = GAIN / (z / 1000 * stretch) ** 2 / stretch
    sigma = np.hypot(FLOOR_MM, white_sigma_mm(amplitude) / stretch)
    depth = np.rint(z + rng.normal(0, 1, (20, *z.shape)) * sigma).astype(np.uint16)
    found = measure_recording(frames_of("synthetic", depth, camera=IMAGE))
    model = fit_noise_model(found, IMAGE, 1.0, 1.0, LightProfile(), (0.0, 0.0, 0.0), TapNoise())
    assert model.knows_amplitude
    assert model.amplitude == pytest.approx(GAIN, rel=0.05)
    assert model.floor_mm == pytest.approx(FLOOR_MM, rel=0.05)
    assert np.linalg.norm(list(found.pattern.values())) < 0.2


def wall(frames: int = 3, step: int = 0) -> NDArray[np.uint16]:
    return 900 + step * np.indices((frames, 48, 64), np.uint16)[0]


def test_recordings_that_cannot_serve(tmp_path: Path) -> None:
    for count, message in ((1, "has 1 frame;"), (3, "the 3 frames read are copies")):
        with pytest.raises(DatasetError, match=message):
            read(write_frames(tmp_path / str(count), wall(count)))
    rows, columns = np.mgrid[:96, :128]
    room = 1500.0 + 3.0 * columns + rows
    views = [np.roll(room, k * 40, axis=1) if k < 5 else room for k in range(13)]
    noise = np.random.default_rng(0).normal(0, 2.0, (13, *room.shape))
    folder = write_frames(tmp_path / "m", np.rint(views + noise).astype(np.uint16))
    with pytest.raises(DatasetError, match=r"show different scenes .*--frames 5:13"):
        read(folder)
    assert "8 of 8 frames" in open_maps([folder]).read_static(part=slice(5, 13)).note


@pytest.mark.parametrize("sigma_mm", [1.5, 8.0])
@pytest.mark.parametrize("moves", ["walks", "sways", "breathes", "leaves"])
def test_what_moves_before_a_still_wall_is_masked(moves: str, sigma_mm: float) -> None:
    """A square of 40 px at 0.9 m before a wall at 2 m; noise alike over 3 px; the wall stays."""
    rng, (y, x) = np.random.default_rng(0), np.mgrid[:120, :160]
    depths, person = [], []
    for k in range(24):
        turn = np.sin(k / 3)
        middle = {"walks": 20 + 5 * k, "sways": 80 + 12 * turn}.get(moves, 80)
        near = 900 + (6 * sigma_mm * turn if moves == "breathes" else 0)
        inside = (np.abs(x - middle) < 20) & (np.abs(y - 60) < 20) & (moves != "leaves" or k < 8)
        noise = cv2.blur(rng.normal(size=x.shape), (3, 3)) * 3 * sigma_mm
        depths.append(np.rint(np.where(inside, near, 2000 + 2 * x) + noise))
        person.append(inside)
    still, share = mask_moving(frames_of("room", depths))
    left = np.stack([frame.noisy_mm > 0 for frame in still])
    inside = np.stack(person)
    moved = inside if moves == "breathes" else inside != (inside.mean(axis=0) > 0.5)
    assert left[moved].mean() < 0.03
    away = ~np.any([cv2.dilate(p.astype(np.uint8), np.ones((25, 25))) for p in person], axis=0)
    assert left[:, away].mean() > 0.97
    assert share > 0.5
    # The noise of what stays is that of the wall.
    seen = np.stack([f.measured_mm for f in still])[:, away]
    assert np.nanmean(np.nanvar(seen, axis=0, ddof=1)) == pytest.approx(sigma_mm**2, rel=0.1)


def test_a_scene_without_smooth_surfaces_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    noise = rng.integers(500, 4000, (48, 64), np.uint16) + np.indices((4, 48, 64), np.uint16)[0]
    noise[:, ::7] = 0
    noise[:, :, ::7] = 0
    recording = read(write_frames(tmp_path / "mess", noise))
    with pytest.raises(DatasetError, match="0 pixels on smooth surfaces"):
        measure_recording(recording)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ([], 2, "cannot tell which camera this is: name it by --base"),
        (["--base", "kinect-v2"], 2, "base 512x424: give --focal-px"),
        (["-o", "sensor.json"], 2, "give a name that ends in .toml"),
        (["--base", "kinect-v1"], 2, "no fit starts from 'kinect-v1'"),
        (["--frames", "7"], 2, "--frames 7: give the first frame"),
        (["--frames", "2:3", "--base", "kinect-v2"], 1, "has 1 frame in --frames"),
    ],
)
def test_command_refuses(
    arguments: list[str], status: int, message: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    folder = write_frames(tmp_path / "wall", wall(step=1))
    assert main(["fit", str(folder), *arguments]) == status
    line = capsys.readouterr().err
    assert message in line
    assert line.count("\n") == 1


REAL_IMAGE = Intrinsics(512, 424, 364.961, 365.641, 256.189, 202.049)


def real(*names: str) -> list[Path]:
    return [REAL_KINECT_V2 / f"{name}_depth.png" for name in names]


@needs_real_kinect_v2
def test_unrelated_real_frames_are_refused_and_a_static_pair_is_not() -> None:
    assert read(*real("0007", "0008"))[0].infrared is not None
    for other in (("0000", "0005"), ("0007_sync", "0008_sync"), ("0008", "0007_sync")):
        with pytest.raises(DatasetError, match="show different scenes"):
            read(*real(*other))


@needs_real_kinect_v2
def test_a_real_pair_gives_the_published_light_and_noise() -> None:
    """204 other frames of this device give the law of its light, IR = 30,300 / r^2 (r in m)."""
    pair = read(*real("0007", "0008"))
    recording = Frames.of([frame.changed(intrinsics=REAL_IMAGE) for frame in pair])
    found = measure_recording(recording)
    law = fit_infrared(found, recording, 1.0, TapNoise())
    assert 16 * law.gain == pytest.approx(30_300, rel=0.15)
    assert found.pattern["row_alternation_mm"] == pytest.approx(0.69, rel=0.1)
    rows_mm = np.hypot(found.pattern["row_alternation_mm"], found.pattern["row_sigma_mm"])
    assert rows_mm == pytest.approx(0.64, rel=0.1)  # four devices: 0.59 to 0.68
    assert found.pattern["column_sigma_mm"] < 0.29


def test_infrared_in_a_folder_of_its_own(recording: Path, tmp_path: Path) -> None:
    depth = copy_depth(recording, tmp_path / "depth")
    light = tmp_path / "light"
    light.mkdir()
    for number, file in enumerate(sorted(recording.glob("*_ir.png"))):
        (light / f"{number}.png".rjust(8, "0")).write_bytes(file.read_bytes())
    for pair, apart in zip(read(recording), read(depth, infrared=light), strict=True):
        np.testing.assert_array_equal(pair.infrared, apart.infrared)
    (light / "0003.png").unlink()
    with pytest.raises(ConfigError, match="holds 29 infrared images for 30 depth maps"):
        read(depth, infrared=light)
    (depth / "0004_ir.png").write_bytes((light / "0001.png").read_bytes())
    with pytest.raises(DatasetError, match="1 of 30 frames have an infrared image"):
        read(depth)


@pytest.mark.parametrize("smooth", [True, False])
def test_pattern_and_its_map(smooth: bool) -> None:
    """A known pattern under correlated noise of 3 mm: its parts and the map itself."""
    rng = np.random.default_rng(8)
    shape = (IMAGE.height, IMAGE.width)
    own = rng.normal(0, 1, shape)
    own = np.asarray(3.0 * cv2.blur(own, (3, 3)), np.float64) if smooth else own
    y = np.arange(IMAGE.height)[:, None]
    truth = 0.25 * own + 0.3 * rng.normal(0, 1, (len(y), 1)) + 0.15 * rng.normal(0, 1, shape[1:])
    alternation = np.where(y < len(y) // 2, 0.65, -0.65) - 0.1
    truth = truth + alternation * np.where(y % 2 == 0, 1, -1)
    wall_mm = 900 + 300 * np.sin(np.arange(IMAGE.width) / 300) + 0.4 * y

    def mean(frames: int) -> NDArray[np.float64]:
        noise = [3.0 * cv2.blur(rng.normal(0, 1, shape), (3, 3)) for _ in range(frames)]
        return np.asarray(np.mean([np.rint(wall_mm + truth + n) for n in noise], axis=0))

    halves = (mean(15), mean(15))
    used = np.zeros(shape, np.bool_)
    used[5:-5, 5:-5] = True
    frames = frames_of("half", halves, camera=IMAGE, step_mm=0.0)
    found, alike = pattern_parameters(frames), measure_pattern(frames).rest_correlation
    assert found["row_alternation_mm"] == pytest.approx(0.65, rel=0.1)
    assert found["row_step_mm"] == pytest.approx(0.2, abs=0.05)
    assert found["row_sigma_mm"] == pytest.approx(0.3, rel=0.12)
    assert found["column_sigma_mm"] == pytest.approx(0.15, rel=0.12)
    assert found["pixel_sigma_mm"] == pytest.approx(0.25, rel=0.06)
    assert alike == pytest.approx(0.55 if smooth else 0.0, abs=0.06)
    map_mm = pattern_map(0.5 * (halves[0] + halves[1]), used)
    known = np.isfinite(map_mm)
    assert known[used].mean() > 0.99
    assert not known[~used].any()
    assert np.corrcoef(map_mm[known], truth[known])[0, 1] > 0.9


def test_wiggling_of_a_slanted_wall() -> None:
    """Harmonics of known size and phase are found; a wall that faces the camera shows none."""
    rng = np.random.default_rng(9)
    rays = IMAGE.rays().astype(np.float64)
    stretch = np.sqrt(1.0 + (rays**2).sum(axis=-1))
    depth = 1000.0 / (0.6 + 0.75 * rays[..., 0] + 0.1 * rays[..., 1])
    truth = {2: (0.012, {80: 0.9, 120: -1.2}), 5: (0.004, {80: 2.0, 120: 0.3})}
    error = np.zeros(depth.shape)
    for harmonic, (size, phases) in truth.items():
        for mhz, phase in phases.items():
            turn = 2 * np.pi * depth * stretch * mhz / 149_896.229
            error -= 110.5 * size * np.sin((3 if harmonic == 2 else 6) * turn - phase)
    depth = np.where(depth > 3500, 0.0, depth + error / stretch)
    frames = np.rint(depth + rng.normal(0, 1.0, (10, *depth.shape)) * (depth > 0))
    found = measure_recording(frames_of("slanted", frames.astype(np.uint16), camera=IMAGE))
    wiggling = fit_wiggling(found, IMAGE)
    for harmonic, (size, phases) in truth.items():
        assert wiggling.known(harmonic)
        assert wiggling.amplitude[harmonic] == pytest.approx(size, rel=0.1)
        assert wiggling.phase_rad[harmonic] == pytest.approx(list(phases.values()), abs=0.15)
    facing = np.rint(900 + rng.normal(0, 1.0, (4, *depth.shape))).astype(np.uint16)
    assert fit_wiggling(measure_recording(frames_of("wall", facing, camera=IMAGE)), IMAGE) is None
