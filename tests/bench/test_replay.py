"""Replays: surfaces found in a frame, and the same surfaces rendered through a sensor again."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.bench.compare.comparison import compare_sets
from glsim.bench.compare.replay import Replay
from glsim.bench.compare.replay_noise import half_distance_px, measure_replay_noise
from glsim.bench.compare.replay_surfaces import find_surfaces, smooth_surfaces
from glsim.cli import main
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.files.atomic import write_atomic
from glsim.core.files.png import encode_png
from glsim.data.maps import open_maps
from tests.support.planted_frames import frames_of
from tests.support.real_cameras import REAL_CAMERAS, REAL_KINECT_V2, needs_real_cameras

Array = NDArray[np.float32]

HEIGHT, WIDTH = 120, 200
FRONT_MM, WALL_MM = 800.0, 1600.0


def step(seed: int = 0, sigma_mm: float = 1.5, gap_px: int = 6) -> Array:
    """A tilted near square before a wall, with a gap on its left and on its right, in mm."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    depth = WALL_MM + 0.4 * x
    inside = (np.abs(x - 100) < 40) & (np.abs(y - 60) < 40)
    depth = np.where(inside, FRONT_MM + 0.5 * y, depth)
    depth += np.random.default_rng(seed).normal(0, sigma_mm, depth.shape)
    gap = (np.abs(y - 60) < 40) & (x >= 140) & (x < 140 + gap_px)
    gap |= (np.abs(y - 60) < 40) & (x <= 60) & (x > 58)
    depth[gap] = np.nan
    depth[20, 30:33] = np.nan  # a hole within the wall
    return depth.astype(np.float32)


def test_surfaces_are_smooth_and_gaps_are_given_to_the_far_one() -> None:
    found = find_surfaces(step(), (3.0,), 12)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    wall = WALL_MM + 0.4 * x
    assert np.isfinite(found.front_mm).all()
    error = (found.front_mm - wall)[np.abs(x - 100) > 50]
    assert np.sqrt((error**2).mean()) < 0.4  # 1.5 mm of noise before
    inner = (np.abs(x - 100) < 36) & (np.abs(y - 60) < 36)
    assert np.abs((found.front_mm - FRONT_MM - 0.5 * y)[inner]).max() < 1.5
    assert found.front_mm[60, 140] < 1000  # the rim
    assert (found.front_mm[60, 142:146] > 1500).all()  # the rest of the gap
    # The far surface goes on behind the near one, and lends its light.
    np.testing.assert_allclose(found.behind_mm[60, 121:140], WALL_MM + 0.4 * 142, atol=3)
    assert found.light_from[60, 143] == 60 * WIDTH + 146
    assert {*np.unique(found.behind_from[60, 121:139])} == {60 * WIDTH + 146}
    assert found.light_from[60, 100] == 60 * WIDTH + 100
    open_depth = step()
    open_depth[90:118, 100:160] = np.nan
    assert np.isnan(find_surfaces(open_depth, (3.0,), 12).front_mm[104, 130])
    assert np.isfinite(find_surfaces(open_depth, (3.0,), 80).front_mm[104, 130])


def test_still_frames_are_one_scene_of_their_median() -> None:
    noisy = [np.nan_to_num(step(seed)) for seed in range(5)]
    still, one = (Replay(frames_of("s", n), "ideal", smooth_px=1.0) for n in (noisy, noisy[:1]))
    first, second = still.through(most=2)
    np.testing.assert_array_equal(first.noisy_mm, second.noisy_mm)
    wall = WALL_MM + 0.4 * np.arange(160, WIDTH - 5)
    errors = [(f.noisy_mm[5:-5, 160:-5] - wall).std() for f in (first, one.through()[0])]
    assert errors[0] < 0.7 * errors[1]


def test_scattered_depths_of_a_far_wall_become_a_wall() -> None:
    """A wall of which a tenth of the pixels has depth; flying pixels beside the square do not."""
    depth, rng = step(), np.random.default_rng(1)
    far = np.isnan(depth) | (depth > 1500)
    depth[far & (rng.uniform(size=depth.shape) > 0.1)] = np.nan
    depth[30:90, 141] = np.linspace(900, 1500, 60)
    found = find_surfaces(depth, (3.0,), 12)
    x = np.mgrid[:HEIGHT, :WIDTH][1]
    away = np.abs(x - 100) > 52
    assert np.isfinite(found.front_mm[away]).mean() > 0.9
    assert np.nanmax(np.abs(found.front_mm - WALL_MM - 0.4 * x)[away]) < 15


@pytest.mark.parametrize("alike_px", [1.5, 5.0])
def test_noses_stay_and_noise_does_not(alike_px: float) -> None:
    """A head with a nose and eyes, no plane anywhere; noise of 1.5 mm alike over some pixels."""
    y, x = np.mgrid[:160, :130].astype(np.float64) - np.array([80, 65]).reshape(2, 1, 1)
    ball = 700.0 + 60.0 * ((x / 55) ** 2 + (y / 75) ** 2)
    nose = -14.0 * np.exp(-((x / 6) ** 2) - (y / 10) ** 2)
    eyes = sum(6.0 * np.exp(-(((x - k) / 6) ** 2) - ((y + 25) / 5) ** 2) for k in (-18, 18))
    inside = (x / 55) ** 2 + (y / 75) ** 2 < 1
    truth, sigma = ball + nose + eyes, alike_px / np.sqrt(4 * np.log(2))
    white = np.random.default_rng(0).normal(size=(2, *x.shape))
    noise = np.stack([cv2.GaussianBlur(image, (0, 0), sigma) for image in white])
    depth = np.where(inside, truth + 1.5 * noise / noise.std(), np.nan).astype(np.float32)
    camera = Intrinsics(130, 160, 365, 365, 65, 80)
    frames = list(frames_of("heads", list(depth), None, camera))
    assert half_distance_px(frames) == pytest.approx(alike_px, rel=0.25)
    found = measure_replay_noise(frames, None)
    inner, part = (x / 55) ** 2 + (y / 75) ** 2 < 0.7, np.abs(nose + eyes) > 2
    widest = smooth_surfaces(depth[0], found.scales_px).widest_mm
    front = find_surfaces(depth[0], found.scales_px, 12, found.energy(frames[0])).front_mm

    def kept(z: np.ndarray) -> float:
        """Share of the relief of nose and eyes, beside that of the ball alone."""
        relief = (nose + eyes)[part & inner]
        return float(((z - ball)[part & inner] * relief).sum() / (relief**2).sum())

    assert kept(front) > max(0.85, kept(widest) + 0.03)
    smooth = inner & (np.abs(nose + eyes) < 0.05)
    error = (front - ball)[smooth]
    assert (error - error.mean()).std() < 0.7 * 1.5
    unknown = np.full((3, *x.shape), np.inf)
    np.testing.assert_array_equal(
        smooth_surfaces(depth[0], found.scales_px).with_relief(unknown), widest
    )


@pytest.fixture(scope="module")
def recorded() -> Frames:
    """Frames of kinect-v2 of steps at four distances, each by a replay of a perfect one."""
    depths = [np.kron(step(k, 0.0, 1) * (0.8 + 0.1 * k), np.ones((2, 2))) for k in range(4)]
    lights = [np.nan_to_num(3e9 / depth**2).astype(np.float32) for depth in depths]
    return Replay(frames_of("perfect", depths, lights), "kinect-v2").through(seed=1)


@pytest.mark.long
def test_a_sensor_is_not_told_from_its_own_replay(recorded: Frames) -> None:
    """The same device; a replay of it differs by what the smoothing leaves of the noise."""
    again = Replay(recorded, "kinect-v2").through(seed=1)
    assert [f.name for f in again] == [f.name for f in recorded]
    for first, second in zip(recorded, again, strict=True):
        both = np.isfinite(first.measured_mm) & np.isfinite(second.measured_mm)
        assert both.mean() > 0.9
        assert np.median(np.abs(first.measured_mm - second.measured_mm)[both]) < 3.0
        ratio = second.infrared[both] / np.maximum(first.infrared[both], 1)
        assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
    own = compare_sets(recorded, again).verdicts["planes"]
    assert max(own.auc, own.boosted_auc) < 0.7
    quiet = ["tof_floor.sigma_mm=0.3", "tof_taps.read_variance=2"]
    for changes in (["tof_floor.sigma_mm=4"], quiet):
        other = Replay(recorded, "kinect-v2").through(seed=1, assignments=changes)
        told = compare_sets(recorded, other).verdicts["planes"]
        assert told.boosted_auc > own.boosted_auc + 0.1, changes


def test_frames_follow_the_seed_and_frames_without_depth_stay_so(recorded: Frames) -> None:
    first = recorded[0]
    empty = first.changed({"noisy_mm": np.zeros_like(first.noisy_mm)})
    made = [Replay(Frames.of([first, empty]), "kinect-v2").through(seed=3) for _ in range(2)]
    np.testing.assert_array_equal(made[0][0].measured_mm, made[1][0].measured_mm)
    assert [np.isfinite(f.measured_mm).any() for f in made[0]] == [True, False]


def test_a_gate_does_not_cut_the_real_scene(recorded: Frames) -> None:
    close = [f.changed({"noisy_mm": 0.3 * f.noisy_mm}) for f in recorded[:1]]  # from 240 mm on
    again = Replay(Frames.of(close), "kinect-v2", smooth_px=3.0).through()[
        0
    ]  # its gate begins at 500 mm
    near = close[0].measured_mm < 450
    assert near.sum() > 1000
    assert np.isfinite(again.measured_mm[near]).mean() > 0.8


@pytest.mark.long
def test_mirrored_frames_are_replayed_mirrored(recorded: Frames) -> None:
    """Shadows stay on the side that they have in the real frames."""
    mirrored = Frames.of(
        [
            f.changed({name: f.layer(name)[:, ::-1] for name in ("noisy_mm", "infrared")})
            for f in recorded
        ]
    )
    own = compare_sets(recorded, recorded).first.silhouettes.shadow_side
    for frames, side in ((recorded, own), (mirrored, {"left": "right", "right": "left"}[own])):
        again = Replay(frames, "kinect-v2").through(seed=1)
        assert compare_sets(frames, again).second.silhouettes.shadow_side == side


@pytest.mark.long
def test_the_command_replays_and_refuses_what_it_cannot(
    tmp_path: Path, recorded: Frames, capsys: pytest.CaptureFixture[str]
) -> None:
    for frame in recorded[:2]:
        depth = np.nan_to_num(frame.measured_mm).astype(np.uint16)
        write_atomic(encode_png(depth), tmp_path / "real" / f"{frame.name}_depth.png")
    real = str(tmp_path / "real")
    assert main(["compare", real, "--replay", "kinect-v2", "-q", "-o", f"{tmp_path}/t.md"]) == 0
    (table,) = (tmp_path / "t.md").read_text().split("--replay")  # it is not advised again
    assert table.startswith("# real against kinect-v2, replay")
    for wrong, message in (
        ([real], "give the simulated frames, or --replay"),
        ([real, real, "--replay", "kinect-v2"], "give the simulated frames, or --replay"),
        ([real, real, "--set", "a.b=1"], "add --replay"),
        ([real, "--replay", "kinekt"], "did you mean"),
        ([real, "--replay", "kinect-v2", "--depth-unit-mm", "10"], "give the unit"),
        ([real, "--replay", "realsense-d435", "--depth-unit-mm", "0.1"], "another camera"),
    ):
        capsys.readouterr()
        assert main(["compare", *wrong]) in (1, 2)
        assert message in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.long
@needs_real_cameras
def test_replays_of_real_frames() -> None:
    """A Kinect V2's rooms, a wall and rooms of a D435; figures as in docs/results/comparison.md."""
    kinect = open_maps(REAL_KINECT_V2).read(16)
    verdicts = compare_sets(kinect, Replay(kinect, "kinect-v2").through()).verdicts
    assert verdicts["planes"].auc < 0.72
    assert verdicts["silhouettes, lit side"].auc < 0.72
    wall = sorted((REAL_CAMERAS / "d435_wall_2frames").glob("depth*.png"))
    rooms = sorted((REAL_CAMERAS / "d435_robot_room").glob("depth*.png"))[::3]
    for real in (
        open_maps(wall, unit_mm=1).read(60, 390.43),
        open_maps(rooms, unit_mm=1.0).read(60, 381.4),
    ):
        verdicts = compare_sets(real, Replay(real, "realsense-d435-vga").through()).verdicts
        assert verdicts["planes"].auc < 0.75
        assert verdicts["curved"].auc < 0.75
