"""glsim fit for stereo: lattice, noise, static share and correlation come back as a sensor."""

import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from moderngl import Context

from glsim.bench.fit.base_choice import choose_base
from glsim.bench.fit.figures import FRAME, STATIC, disparity_figures
from glsim.bench.fit.stereo_sensor import fit_stereo
from glsim.bench.modes import find_lattice
from glsim.bench.scenes import merge_meshes, rectangle, room_corner
from glsim.cli import main
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import write_atomic
from glsim.data.maps import open_maps
from glsim.measures.stacks import with_nan
from glsim.measures.validity import hole_share_beside_band
from glsim.sensors.sensor import load_sensor
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.planted_frames import encoded, frames_of, noisy, plane
from tests.support.real_cameras import REAL_CAMERAS, box_noise, needs_real_cameras
from tests.support.recordings import write_frames

PRODUCT, STEPS = 390.4 * 50.17, 32


def planted(frame_px: float = 0.09, static_px: float = 0.06, count: int = 8) -> Frames:
    """Frames of slanted planes: noise of 13 px boxes, as a D435 rounds its depths."""
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[:480, :640]
    true = PRODUCT / (700.0 + 2.0 * columns + 0.3 * rows)
    static = box_noise(rng, 1, (480, 640), 13, static_px)
    moving = box_noise(rng, count, (480, 640), 13, frame_px)
    depth = PRODUCT * STEPS / np.rint(STEPS * (true + static + moving))
    depth[:, :, :20] = 0.0
    depth[::2, 100:130, 200:230] = 0.0
    return frames_of("planted", list(np.rint(depth)))


@pytest.mark.long
def test_planted_noise_is_measured() -> None:
    frames = planted()
    lattice = find_lattice(frames)
    assert lattice is not None
    assert lattice.constant / STEPS == pytest.approx(PRODUCT, rel=1e-3)
    found = disparity_figures(frames, PRODUCT)
    assert found[FRAME][0] == pytest.approx(0.09, rel=0.1)
    assert found[STATIC][0] == pytest.approx(0.06, rel=0.2)


def test_a_recording_without_planes_is_refused(tmp_path: Path) -> None:
    bars = np.tile(np.array([900] * 30 + [0] * 10, np.uint16), (480, 16))
    recording = open_maps(write_frames(tmp_path / "bars", np.stack([bars, bars + bars // 900])))
    with pytest.raises(DatasetError, match="only 0 parts of 40x40 px full of depth"):
        fit_stereo(recording, "realsense-d435-vga", None, slice(None))


def test_the_depths_choose_the_base(tmp_path: Path) -> None:
    depths = np.stack([np.nan_to_num(f.measured_mm) for f in planted(count=2)])
    stereo = open_maps(write_frames(tmp_path / "stereo", depths.astype(np.uint16)))
    assert choose_base(stereo, None, 390.4).name == "realsense-d435-vga"
    assert choose_base(stereo, "realsense-d455", None).text == "realsense-d455, as named"
    with pytest.raises(ConfigError, match="no fit starts from 'kinect-v1'"):
        choose_base(stereo, "kinect-v1", None)
    time_of_flight = [noisy(plane(900.0, 0.2), 1.2, seed, 3) for seed in (1, 2)]
    choice = choose_base(open_maps(write_frames(tmp_path / "tof", time_of_flight)), None, None)
    assert choice.name == "kinect-v2-fast"
    assert "rivals: azure-kinect" in choice.text


@pytest.mark.parametrize(
    ("size", "focal", "baseline_mm", "box_px", "unit_mm", "expected"),
    [
        ((848, 480), 433.1, 95.0, 13, 1.0, "realsense-d455"),
        ((640, 360), 326.9, 95.0, 13, 1.0, "realsense-d455"),
        ((1280, 720), 943.6, 56.2, 11, 1.0, "realsense-d415"),
        ((640, 480), 613.0, 50.17, 13, 1.0, "realsense-d435-vga"),
        ((640, 480), 602.4, 0.0, 6, 0.1, "truedepth"),
        ((640, 480), 434.6, 0.0, 6, 0.1, "truedepth"),
        ((640, 576), 504.5, 0.0, 5, 1.0, "azure-kinect"),
        ((320, 288), 252.2, 0.0, 3, 1.0, "azure-kinect-nfov-binned"),
        ((640, 480), 500.0, 0.0, 6, 1.0, ""),
    ],
)
def test_no_camera_becomes_another_kind(
    size: tuple[int, int], focal: float, baseline_mm: float, box_px: int, unit_mm: float,
    expected: str, tmp_path: Path,
) -> None:  # fmt: skip
    """Walls with noise as of each kind; depths in steps of disparity, or in whole units."""
    rng, (rows, columns) = np.random.default_rng(5), np.mgrid[: size[1], : size[0]]
    wall = 700.0 + 3800.0 * columns / size[0] + 0.3 * rows
    depth_focal = 390.4 if focal == 613.0 else focal
    product = depth_focal * (baseline_mm or 50.0)
    disparity = product / wall + box_noise(rng, 2, (size[1], size[0]), box_px, 0.08)
    depth = product * STEPS / np.rint(STEPS * disparity) if baseline_mm else product / disparity
    maps = np.rint(depth / unit_mm).astype(np.uint16)
    recording = open_maps(write_frames(tmp_path / "r", maps), unit_mm=unit_mm)
    if expected:
        assert choose_base(recording, None, focal).name == expected
    else:
        with pytest.raises(ConfigError, match="cannot tell which camera this is"):
            choose_base(recording, None, focal)


@needs_real_cameras
def test_a_real_d435_and_a_real_kinect_v1_are_stereo() -> None:
    kinect_v1 = open_maps(REAL_CAMERAS / "kinect_v1_tables")
    assert choose_base(kinect_v1, None, None).name == "kinect-v1-pattern"
    assert kinect_v1.recognised.sensor == "kinect-v1-pattern"
    recording = open_maps(REAL_CAMERAS / "d435_wall_2frames")
    assert choose_base(recording, None, None).name == "realsense-d435-vga"
    found = disparity_figures(recording.read(), 390.4315 * 50.1707)
    assert found[FRAME][0] == pytest.approx(0.097, abs=0.01)


@pytest.mark.long
def test_a_changed_sensor_comes_back(context: Context, tmp_path: Path) -> None:
    """Another baseline, more noise in time, a larger error of its own, more single holes."""
    camera = tmp_path / "camera" / "mine.toml"
    text = (
        'extends = "realsense-d435-vga"\ntitle = "t"\n'
        "[[rig.imager]]\nposition_m = [0, 0, 0]\n[[rig.imager]]\nposition_m = [0.052, 0, 0]\n"
        '[[stage]]\nuse = "match_stereo"\ndevice_sigma_px = 0.09\nunlike_medians = 7.0\n'
        '[[stage]]\nuse = "stereo_exposure"\nspeckle_sigma = 0.16\n'
    )
    write_atomic(text.encode(), camera)
    product = 390.4315 * 52.0
    # Walls at a slant: of one in parallel to the image, noise depends on its fraction of a pixel.
    turn = cv2.Rodrigues(np.radians([10.0, 18.0, 0.0]))[0]
    corner, away = room_corner(product), np.array([0.0, 0.0, 1500.0])
    points = ((corner.vertices_mm - away) @ turn.T + away).astype(np.float32)
    scene = replace(corner, vertices_mm=points)
    shot = VirtualCamera(str(camera), context, seed=2).capture(scene, 8, None, scene="corner")
    recording = write_frames(tmp_path / "recording", encoded(shot))
    out = tmp_path / "fitted.toml"
    assert main(["fit", str(recording), "-o", str(out), "--no-proof"]) == 0
    assert tomllib.loads(out.read_text())["extends"] == "realsense-d435-vga"
    sensor = load_sensor(str(out))
    rig, stages = sensor.rig, {stage.name: stage.settings for stage in sensor.stages}
    assert 1000 * rig.baseline_m * rig.intrinsics.fx == pytest.approx(product, rel=1e-3)
    assert stages["stereo_exposure"]["speckle_sigma"].typical == pytest.approx(0.16, rel=0.3)
    assert stages["match_stereo"]["unlike_medians"].typical == pytest.approx(7.0, rel=0.1)
    again = VirtualCamera(str(out), context, seed=5).capture(scene, 8, None, scene="corner")
    shots = [list(encoded(s)) for s in (shot, again)]
    planted_share, found = (hole_share_beside_band(list(map(with_nan, s))) for s in shots)
    assert planted_share / 1.3 < found < 1.3 * planted_share
    real, own = (disparity_figures(frames_of("corner", s), product) for s in shots)
    for name, (value, _) in real.items():
        if name.startswith("noise from frame to frame: correlation"):
            assert own[name][0] == pytest.approx(value, abs=0.1), name
    assert own[FRAME][0] == pytest.approx(real[FRAME][0], rel=0.2)


@pytest.mark.long
def test_an_azure_kinects_width_and_light_noise_come_back(context: Context, tmp_path: Path) -> None:
    base, out = "azure-kinect", tmp_path / "fitted.toml"
    changes = {"tof_smooth": {"width_px": 2.0}, "tof_taps": {"shot_variance": 0.6}}
    walls = rectangle((-2700, 600), (-2000, 2000), (2000, 1600), 0.6)
    scene = merge_meshes(walls, rectangle((600, 2700), (-2000, 2000), (1600, 1200), 0.4))
    shot = VirtualCamera(base, context, seed=2).capture(scene, 6, None, changes=changes)
    folder = write_frames(tmp_path / "recording", encoded(shot), shot.stack("infrared"))
    assert main(["fit", str(folder), "--base", base, "-o", str(out), "--no-proof"]) == 0
    stages = {stage.name: stage.settings for stage in load_sensor(str(out)).stages}
    assert stages["tof_smooth"]["width_px"].typical == pytest.approx(2.0, rel=0.15)
    assert stages["tof_taps"]["shot_variance"].typical == pytest.approx(0.6, rel=0.3)
