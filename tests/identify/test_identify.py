"""Which camera made a recording: real folders, simulated ones, and ones that no camera made."""

from __future__ import annotations

from pathlib import Path

import cv2
import moderngl
import numpy as np
import pytest

from glsim.cli import main
from glsim.files.atomic import write_atomic
from glsim.files.png import encode_png
from glsim.identify.evidence import gather_evidence
from glsim.identify.ranking import UNKNOWN, Guess, rank_cameras
from glsim.recordings.recording import open_recording
from glsim.validate import VirtualCamera
from glsim.validate.corner_scene import room_corner
from tests.support.bags import write_bag, write_mkv
from tests.support.face_sets import FACE, TRIANGLES, obj_bytes
from tests.support.real_cameras import REAL_CAMERAS, needs_real_cameras, real_depths


def guesses(path: Path) -> list[Guess]:
    return rank_cameras(gather_evidence(open_recording(path)))


@needs_real_cameras
@pytest.mark.parametrize(
    ("folder", "title", "sensor"),
    [
        ("d435_wall_2frames", "RealSense D435", "realsense-d435-vga"),
        ("d435_robot_room", "RealSense D435", "realsense-d435-vga"),
        ("d405_bed", "RealSense D405", "realsense-d405"),
        ("kinect_v1_tables", "Kinect V1", "kinect-v1-pattern"),
        ("azure_kinect_mug", "Azure Kinect, Femto Bolt (NFOV)", "azure-kinect"),
        ("truedepth_box_and_can/box_can", "TrueDepth (iPhone, iPad)", "truedepth"),
        ("truedepth_zeiss/eval_iPhone11Pro_iOS14", "TrueDepth (iPhone, iPad)", "truedepth"),
        ("truedepth_zeiss/eval_iPadPro12_4gen_iOS15", "TrueDepth (iPhone, iPad)", "truedepth"),
        ("truedepth_zeiss/board_iPhone11Pro_iOS14", "TrueDepth (iPhone, iPad)", "truedepth"),
        ("truedepth_zeiss/board_iPadPro12_4gen_iOS15", "TrueDepth (iPhone, iPad)", "truedepth"),
        ("../kinect-v2-real", "Kinect V2", "kinect-v2"),
    ],
)
def test_real_cameras_are_named(folder: str, title: str, sensor: str) -> None:
    best = guesses(REAL_CAMERAS / folder)[0]
    assert (best.title, best.sensor) == (title, sensor)
    assert best.share > 0.6
    assert best.reasons


@needs_real_cameras
def test_the_lattice_says_the_device() -> None:
    best = guesses(REAL_CAMERAS / "d435_wall_2frames")[0]
    assert best.share > 0.95
    assert best.unit_mm == 1.0
    assert best.focal_baseline_px_mm == pytest.approx(390.4315 * 50.1707, rel=1e-3)


@needs_real_cameras
def test_a_cut_image_is_recognised_by_its_lattice(tmp_path: Path) -> None:
    for number, depth in enumerate(real_depths("d435_wall_2frames")):
        cut = np.ascontiguousarray(depth[100:400, 50:450]).astype(np.uint16)
        write_atomic(encode_png(cut), tmp_path / f"{number}.png")
    best, second = guesses(tmp_path)[:2]
    assert best.title == "RealSense D435"
    assert second.title == UNKNOWN
    assert any("none of its modes" in reason for reason in best.reasons)


def _simulated(context: moderngl.Context, sensor: str, folder: Path, unit_mm: float) -> Path:
    camera = VirtualCamera(sensor, context)
    shot = camera.capture(room_corner(), 2, None, scene="corner")
    for number, (depth, light) in enumerate(zip(shot.fine_mm, shot.infrared, strict=True)):
        steps = np.rint(np.nan_to_num(depth) / unit_mm).clip(0, 65535).astype(np.uint16)
        write_atomic(encode_png(steps), folder / f"depth_{number}.png")
        counts = light.clip(0, 65535).astype(np.uint16)
        write_atomic(encode_png(counts), folder / f"ir_{number}.png")
    return folder


@pytest.mark.parametrize(
    ("sensor", "title", "unit_mm"),
    [
        ("realsense-d435", "RealSense D435", 1.0),
        ("realsense-d455", "RealSense D455", 1.0),
        ("truedepth", "TrueDepth (iPhone, iPad)", 0.1),
        ("kinect-v1-pattern", "Kinect V1", 1.0),
        ("kinect-v2", "Kinect V2", 1.0),
        ("azure-kinect-nfov-binned", "Azure Kinect, Femto Bolt (NFOV)", 1.0),
    ],
)
def test_simulated_cameras_are_named(
    context: moderngl.Context, tmp_path: Path, sensor: str, title: str, unit_mm: float
) -> None:
    best = guesses(_simulated(context, sensor, tmp_path, unit_mm))[0]
    assert best.title == title
    assert best.share > 0.6


@pytest.mark.parametrize("case", ["noise", "wrong lattice"])
def test_depths_that_no_camera_made_are_unknown(tmp_path: Path, case: str) -> None:
    rng = np.random.default_rng(8)
    true = 700 + 3.0 * np.arange(640)[None] + rng.normal(0, 2, (480, 640))
    if case == "wrong lattice":
        true = 400_000 / np.rint(400_000 / true)
    write_atomic(encode_png(np.rint(true).astype(np.uint16)), tmp_path / "a.png")
    best = guesses(tmp_path)[0]
    assert best.title == UNKNOWN
    assert best.sensor == ""


def test_a_bag_says_its_unit_and_the_camera_it_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    n = np.linspace(170, 640, 640).round()[None] + np.arange(480)[:, None] // 40
    depth = np.rint(2_239_488 / n).astype(np.uint16)  # 388.8 px, 18 mm, 1/32 px, 0.1 mm
    write_bag(tmp_path / "a.bag", [depth] * 2, options={"Depth_Units": 1e-4}, name="D405 of mine")
    assert main(["inspect", str(tmp_path / "a.bag")]) == 0
    out = capsys.readouterr().out
    assert "2 frames of 640x480" in out
    assert "in units of 0.1 mm" in out
    assert out.index("RealSense D405 (sensor realsense-d405): ") > 0
    assert "the recording says: D405 of mine" in out


def test_inspect_decides_by_content(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat = np.full((576, 640), 1000, np.uint16)
    (tmp_path / "all").mkdir()
    write_mkv(tmp_path / "all" / "a.mkv", {"DEPTH": [flat + n for n in range(2)]})
    write_atomic(encode_png(flat), tmp_path / "all" / "b" / "depth_0.png")
    cv2.imwrite(str(tmp_path / "all" / "b" / "rgb_0.png"), np.zeros((9, 9, 3), np.uint8))
    assert main(["inspect", str(tmp_path / "all")]) == 0
    captured = capsys.readouterr()
    assert "a.mkv: 2 frames" in captured.out
    assert "/b: 1 frames of 640x576" in captured.out
    assert "has no calibration.json" in captured.err
    write_atomic(obj_bytes(FACE, TRIANGLES), tmp_path / "all" / "ann" / "1.obj")
    assert main(["inspect", str(tmp_path / "all"), "--shown", "0"]) == 0
    assert "1 people" in capsys.readouterr().out


@pytest.mark.parametrize("case", ["empty", "colour"])
def test_folders_without_depth_get_one_line(
    tmp_path: Path, case: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if case == "colour":
        cv2.imwrite(str(tmp_path / "a.png"), np.zeros((40, 40, 3), np.uint8))
    assert main(["inspect", str(tmp_path)]) != 0
    assert capsys.readouterr().err.count("glsim: error: ") == 1
