"""Bags of the usual ROS nodes: which topic is depth, which camera_info is its own, and how read."""

import json
import os
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.cli import main
from glsim.core.camera import Distortion
from glsim.core.errors import ConfigError, DatasetError
from glsim.data.maps import open_maps
from glsim.data.recordings import bag, mkv
from tests.support.bags import azure_calibration, rvl, write_bag, write_mkv, write_topics

SIZE = 64, 48


def _image(value: int, size: tuple[int, int] = SIZE, kind: str = "u2") -> NDArray[Any]:
    return np.full(size[::-1], value, kind)


NATIVE = (_image(700), "16UC1")
METRES = (_image(1, kind="f4") * np.float32(0.7), "32FC1")
OTHER = (_image(900), "16UC1")
COLOUR = (np.zeros((48, 64, 3), np.uint8), "rgb8")
INFO = {"size": SIZE, "focal": 58.0}
WRONG = {"size": SIZE, "focal": 99.0}


@pytest.mark.parametrize(
    ("depth", "kind", "other", "own", "wrong", "frames"),
    [
        ("/camera/depth/image_rect_raw", NATIVE, "/camera/aligned_depth_to_color/image_raw",
         "/camera/depth/camera_info",
         "/camera/color/camera_info /camera/aligned_depth_to_color/camera_info", {}),
        ("/camera/camera/depth/image_rect_raw", NATIVE, "", "/camera/camera/depth/camera_info",
         "/camera/camera/color/camera_info", {}),
        ("/camera/aligned_depth_to_color/image_raw", NATIVE, "", "/camera/color/camera_info",
         "/camera/depth/camera_info", {"/camera/depth/camera_info": "depth"}),
        ("/kinect2/sd/image_depth", NATIVE, "/kinect2/sd/image_depth_rect "
         "/kinect2/qhd/image_depth_rect /kinect2/hd/image_depth_rect", "/kinect2/sd/camera_info",
         "/kinect2/qhd/camera_info /kinect2/hd/camera_info", {}),
        ("/zed2/zed_node/depth/depth_registered", METRES,
         "/zed2/zed_node/confidence/confidence_map /zed2/zed_node/disparity/disparity_image",
         "/zed2/zed_node/depth/camera_info", "/zed2/zed_node/rgb/camera_info", {}),
        ("/zed/zed_node/depth/depth_registered", METRES, "", "/zed/zed_node/left/camera_info",
         "/zed/zed_node/right/camera_info", {"/zed/zed_node/right/camera_info": "right"}),
        ("/camera/depth/image_raw", METRES, "", "/camera/camera_info", "", {}),
        ("/depth/image_raw", NATIVE,
         "/ir/image_raw /depth_to_rgb/image_raw /confidence/image_raw", "/depth/camera_info",
         "/ir/camera_info /rgb/camera_info /depth_to_rgb/camera_info", {}),
        ("/depth_to_rgb/image_raw", NATIVE, "", "/rgb/camera_info", "/depth/camera_info",
         {"/depth/camera_info": "depth"}),
        ("/camera/depth/image", METRES, "/camera/depth_registered/image_raw",
         "/camera/depth/camera_info", "/camera/rgb/camera_info", {}),
        ("/cam/depth_image", NATIVE, "/cam/ir_image /cam/depth_confidence",
         "/cam/depth_camera_info", "/cam/color_camera_info", {}),
        ("/scan", NATIVE, "", "/calibration/info", "", {}),
    ],
)  # fmt: skip
def test_depth_and_its_camera_info_have_many_names(
    tmp_path: Path, depth: str, kind: Any, other: str, own: str, wrong: str, frames: Any
) -> None:
    images = dict.fromkeys(other.split(), OTHER) | {depth: kind}
    if depth.startswith("/camera/depth"):
        images["/camera/color/image_raw"] = COLOUR
    infos = dict.fromkeys(wrong.split(), WRONG) | {own: INFO}
    write_topics(tmp_path / "a.bag", images, infos, frames)
    recording = open_maps(tmp_path / "a.bag")
    frame = recording.frames[0]
    np.testing.assert_allclose(frame.noisy_mm, 700.0, rtol=1e-6)
    assert (frame.intrinsics.fx, frame.intrinsics.cx, frame.intrinsics.cy) == (58.0, 32.0, 24.0)
    assert recording.assumed == ""


@pytest.mark.parametrize(
    ("images", "infos"),
    [
        ({"/camera/depth/image_raw": NATIVE, "/camera/color/image_raw": COLOUR},
         {"/camera/color/camera_info": WRONG}),
        ({"/camera/depth/image_raw": NATIVE}, {"/camera/color/camera_info": WRONG}),
        ({"/left/depth/image_raw": NATIVE}, {"/back/depth/camera_info": WRONG,
                                            "/back/color/camera_info": WRONG}),
        ({"/camera/depth/image_raw": NATIVE}, {"/camera/depth/camera_info": {"size": (64, 36)}}),
        ({"/camera/depth/image_raw": NATIVE},
         {"/camera/depth/camera_info": {"size": SIZE, "focal": 0.0}}),
        ({"/camera/depth/image_raw": NATIVE}, {}),
    ],
)  # fmt: skip
def test_the_camera_of_other_images_is_not_taken(tmp_path: Path, images: Any, infos: Any) -> None:
    write_topics(tmp_path / "a.bag", images, infos)
    recording = open_maps(tmp_path / "a.bag")
    assert (recording.camera, recording.assumed) == (None, "kinect-v2")
    assert "states no intrinsics: those of kinect-v2 (f 365 px" in recording.sentence()
    assert len(recording.notes) == (1 if infos else 0)


@pytest.mark.parametrize(
    ("info", "size", "expected"),
    [
        ({"size": (128, 96), "focal": 80.0}, SIZE, (40.0, 40.0, 32.0, 24.0)),
        ({"size": (128, 96), "focal": 80.0, "binning": 2}, SIZE, (40.0, 40.0, 32.0, 24.0)),
        ({"size": SIZE, "focal": 80.0, "binning": 2}, SIZE, (80.0, 80.0, 32.0, 24.0)),
        ({"size": (128, 96), "focal": 80.0, "roi": (30, 20, 64, 48)}, SIZE, (80, 80, 34, 28)),
        ({"size": (256, 192), "focal": 80.0, "binning": 2, "roi": (60, 40, 128, 96)}, SIZE,
         (40.0, 40.0, 34.0, 28.0)),
        ({"size": (129, 97), "focal": 80.0, "binning": 2}, SIZE, (40.0, 40.0, 32.25, 24.25)),
    ],
)  # fmt: skip
def test_a_camera_info_is_scaled_to_the_images(
    tmp_path: Path, info: Any, size: tuple[int, int], expected: tuple[float, ...]
) -> None:
    images = {"/camera/depth/image_raw": (_image(700, size), "16UC1")}
    write_topics(tmp_path / "a.bag", images, {"/camera/depth/camera_info": info})
    camera = open_maps(tmp_path / "a.bag").camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx(expected)


LENS = [0.1, -0.2, 0.001, 0.002, 0.05]


@pytest.mark.parametrize(
    ("topic", "d", "model", "expected"),
    [
        ("/camera/depth/image_raw", LENS, "plumb_bob", (58.0, LENS)),
        ("/camera/depth/image_rect", LENS, "plumb_bob", (60.0, [])),
        ("/camera/depth/image_rect_raw", LENS, "plumb_bob", (60.0, [])),
        ("/camera/depth/depth_registered", LENS, "plumb_bob", (60.0, [])),
        ("/camera/depth/image_raw", [*LENS, 1, 2, 3], "rational_polynomial",
         (58.0, [*LENS, 1, 2, 3])),
        ("/camera/depth/image_raw", LENS[:4], "equidistant", (58.0, [])),
    ],
)  # fmt: skip
def test_rectified_images_go_with_the_projection(
    tmp_path: Path, topic: str, d: list[float], model: str, expected: Any
) -> None:
    info = {"size": SIZE, "focal": 58.0, "p": 60.0, "d": d, "model": model}
    write_topics(tmp_path / "a.bag", {topic: NATIVE}, {"/camera/depth/camera_info": info})
    recording = open_maps(tmp_path / "a.bag")
    assert (recording.camera.fx, list(recording.distortion)) == expected
    assert any("'equidistant'" in note for note in recording.notes) == (model == "equidistant")


def test_two_cameras_are_said_and_chosen(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file, data = tmp_path / "a.bag", tmp_path / "data"
    light = (_image(40), "16UC1")
    images = {"/back/depth/image_raw": OTHER, "/left/depth/image_raw": NATIVE}
    write_topics(file, images | {"/left/ir/image_raw": light}, {"/left/depth/camera_info": INFO})
    assert open_maps(file).frames[0].infrared is None  # which is the other camera's
    assert main(["import", "kinect2", str(file), "-o", str(data)]) == 0
    said = capfd.readouterr().err.splitlines()[-1]
    assert "that of /back/depth/image_raw; --topic chooses /left/depth/image_raw" in said
    assert said.endswith(" px for 64x48) are taken; a camera.toml states them")
    notes = json.loads((data / "manifest.jsonl").read_text())["notes"]
    assert notes["intrinsics_assumed"] == "kinect-v2"
    other = ["--topic", "/left/depth/image_raw"]
    assert main(["import", "kinect2", str(file), "-o", str(tmp_path / "left"), *other]) == 0
    record = json.loads((tmp_path / "left" / "manifest.jsonl").read_text())
    capfd.readouterr()
    assert main(["inspect", str(file), *other, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["intrinsics"]["fx"] == 58.0
    assert "intrinsics_assumed" not in record["notes"]
    assert (record["intrinsics"]["fx"], sorted(record["files"])) == (58.0, ["infrared", "noisy"])
    (data / "dataset.json").unlink()
    assert main(["import", "kinect2", str(file), "-o", str(data), *other]) == 2  # not two cameras
    with pytest.raises(ConfigError, match=r"has /back/depth/image_raw \(16UC1\)"):
        open_maps(file, topic="/front")
    with pytest.raises(ConfigError, match="is no bag"):
        open_maps(_folder(tmp_path / "folder"), topic="/front")


def _folder(folder: Path) -> Path:
    folder.mkdir()
    cv2.imwrite(str(folder / "1.png"), _image(700))
    return folder


def test_compare_says_whose_intrinsics_it_takes(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = _folder(tmp_path / "folder")
    write_topics(tmp_path / "a.bag", {"/depth/image_raw": NATIVE}, {"/depth/camera_info": INFO})
    assert main(["compare", str(tmp_path / "a.bag"), str(folder)]) == 0
    last = capfd.readouterr().err.splitlines()[-1]
    assert last.startswith(f"{folder}: ")
    assert "states no intrinsics: those of kinect-v2 (f 365 px" in last


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_lone_files_of_ros_2(tmp_path: Path, suffix: str) -> None:
    infos = {"/camera/depth/camera_info": INFO | {"d": LENS}}
    write_topics(tmp_path / f"a{suffix}", {"/camera/depth/image_raw": NATIVE}, infos, count=3)
    for place in (tmp_path / f"a{suffix}", tmp_path):
        recording = open_maps(place)
        assert (recording.kind, len(recording.frames)) == ("bag", 3)
        assert (recording.camera.fx, list(recording.distortion)) == (58.0, LENS)
        np.testing.assert_array_equal(recording.frames[2].noisy_mm, NATIVE[0])


STEPS = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64) * 3 % 5000 * (np.arange(64) > 9)


@pytest.mark.parametrize("codec", ["png", "rvl"])
@pytest.mark.parametrize("kind", ["16UC1", "32FC1"])
def test_compressed_depth(tmp_path: Path, codec: str, kind: str) -> None:
    codes = STEPS.astype(np.uint16)
    data = rvl(codes) if codec == "rvl" else bytes(12) + cv2.imencode(".png", codes)[1].tobytes()
    a, b = 1500.0, -20.0  # of a / (code - b) metres
    data = struct.pack("<iff", 0, a, b) + data[12:]
    topic = "/camera/depth/image_raw/compressedDepth"
    infos = {"/camera/depth/camera_info": INFO}
    write_topics(tmp_path / "a.bag", {topic: (data, f"{kind}; compressedDepth {codec}")}, infos)
    recording = open_maps(tmp_path / "a.bag")
    metres = np.where(codes > 0, a / (codes - b), 0)
    expected = codes if kind == "16UC1" else 1000 * metres
    np.testing.assert_allclose(recording.frames[0].noisy_mm, expected, rtol=1e-5)
    assert recording.camera is not None
    cut = {topic: (data[:200], f"{kind}; compressedDepth {codec}")}
    write_topics(tmp_path / "b.bag", cut, infos)
    with pytest.raises(DatasetError, match="image is damaged"):
        open_maps(tmp_path / "b.bag")


@pytest.mark.parametrize(
    "images",
    [
        {"/camera/depth/image_raw/compressed": (b"\xff\xd8", "16UC1; jpeg compressed")},
        {"/camera/confidence": OTHER},
        {"/stereo/disparity": METRES},
        {"/a/range": OTHER, "/a/quality": OTHER},
        {"/thermal/image_raw": OTHER},
        {"/camera/mono": (_image(7), "mono16")},
    ],
)
def test_what_is_no_depth_is_refused(tmp_path: Path, images: Any) -> None:
    write_topics(tmp_path / "a.bag", images, {})
    with pytest.raises(DatasetError, match="choose by --topic of"):
        open_maps(tmp_path / "a.bag")


def test_a_file_that_was_cut_off_ends_in_one_line(tmp_path: Path) -> None:
    write_topics(tmp_path / "c.mcap", {"/depth/image": NATIVE}, {}, count=9)
    data = (tmp_path / "c.mcap").read_bytes()
    (tmp_path / "c.mcap").write_bytes(data[: len(data) // 2])
    with pytest.raises(DatasetError, match="mcap recover"):
        open_maps(tmp_path / "c.mcap")


def test_frames_without_infrared_at_the_end_are_left_out(tmp_path: Path) -> None:
    image = _image(700, (640, 576))
    write_mkv(tmp_path / "a.mkv", {"DEPTH": [image] * 4, "IR": [image] * 3}, azure_calibration())
    recording = open_maps(tmp_path / "a.mkv")
    assert len(recording.frames) == 3
    assert "the last 1 frame, without infrared, left out" in recording.notes[0]


@pytest.mark.parametrize(
    ("name", "said"), [("a.r3d", "export EXR"), ("a.zip", "unpack it"), ("a.mcap.zstd", "zstd -d")]
)
def test_packed_files_get_one_line(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / name).write_bytes(b"PK")
    with pytest.raises(DatasetError, match=said):
        open_maps(tmp_path / name)


def test_a_mirrored_lens_shows_what_the_camera_shows(tmp_path: Path) -> None:
    info = {"size": SIZE, "focal": 58.0, "d": LENS}
    write_topics(tmp_path / "a.bag", {"/depth/image": NATIVE}, {"/depth/camera_info": info})
    points = np.array([[0.3, 0.2], [-0.1, 0.25]])
    placed = []
    for mirror in (False, True):
        lens = open_maps(tmp_path / "a.bag", mirror=mirror).distortion
        own = Distortion(**dict(zip(("k1", "k2", "p1", "p2", "k3"), lens, strict=True)))
        side = np.array([-1.0 if mirror else 1.0, 1.0])
        placed.append(own.distort(points * side) * side)
    np.testing.assert_allclose(placed[1], placed[0], atol=1e-12)


def test_what_a_part_of_a_bag_unpacks_to_is_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bag(tmp_path / "a.bag", [np.full((48, 64), 900, np.uint16)] * 3)
    assert len(open_maps(tmp_path / "a.bag").frames) == 3
    monkeypatch.setattr(bag, "MOST_HELD", 10_000)
    with pytest.raises(DatasetError, match="or unpacks to more than"):
        open_maps(tmp_path / "a.bag")


def test_a_large_calibration_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_mkv(tmp_path / "a.mkv", {"DEPTH": [_image(700, (640, 576))]}, b" " * 200_000)
    monkeypatch.setattr(mkv, "_PART_BYTES", 100_000)
    with pytest.raises(DatasetError, match="before a frame"):
        open_maps(tmp_path / "a.mkv")


@pytest.mark.parametrize("name", ["x.bag", "x.mkv", "x.mcap"])
def test_a_pipe_is_no_recording(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)  # to open it would wait for ever
    with pytest.raises(DatasetError, match="is a pipe"):
        open_maps(tmp_path / name)


def test_what_drivers_send_against_the_conventions(tmp_path: Path) -> None:
    """Floats in millimetres, plain PNG files as "png", and infrared that starts late."""
    topic, ramp = "/camera/depth/image_raw", STEPS + 300
    write_topics(tmp_path / "mm.bag", {topic: (ramp.astype("f4"), "32FC1")}, {})
    png = cv2.imencode(".png", ramp.astype(np.uint16))[1].tobytes()
    write_topics(tmp_path / "png.bag", {f"{topic}/compressed": (png, "png")}, {})
    for name in ("mm", "png"):
        recording = open_maps(tmp_path / f"{name}.bag")
        np.testing.assert_allclose(recording.frames[0].noisy_mm, ramp)
    assert "floats are taken for mm" in open_maps(tmp_path / "mm.bag").sentence()
    grey = cv2.imencode(".png", np.zeros((48, 64), np.uint8))[1].tobytes()
    write_topics(tmp_path / "grey.bag", {f"{topic}/compressed": (grey, "png")}, {})
    with pytest.raises(DatasetError, match="holds no images whose name says depth"):
        open_maps(tmp_path / "grey.bag")
