"""ROS bags and Matroska files: read as the same frames in a folder are, one frame at a time."""

import pickle
import shutil
import subprocess
import sys
import tracemalloc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError, DatasetError, pip_install
from glsim.data.maps import open_maps
from glsim.data.reader import open_dataset
from glsim.data.recordings.imports import RecordingSource
from glsim.data.recordings.streams import nearest
from tests.support.bags import SENSOR, azure_calibration, write_bag, write_mkv, write_topics

RNG = np.random.default_rng(3)
DEPTHS = [RNG.integers(400, 3000, (48, 64)).astype(np.uint16) for _ in range(6)]
LIGHTS = [RNG.integers(0, 255, (48, 64)).astype(np.uint8) for _ in range(6)]
AZURE = [RNG.integers(0, 4000, (576, 640)).astype(np.uint16) for _ in range(4)]
AZURE_IR = [RNG.integers(0, 60000, (576, 640)).astype(np.uint16) for _ in range(4)]


def test_a_bag_of_librealsense(tmp_path: Path) -> None:
    file = tmp_path / "a.bag"
    write_bag(file, DEPTHS, LIGHTS, options={"Depth_Units": 1e-4, "Stereo_Baseline": 50.17})
    recording = open_maps(file)
    assert (recording.kind, len(recording.frames)) == ("bag", 6)
    assert recording.stated.unit_mm == 0.1
    assert recording.stated.baseline_m == pytest.approx(0.05017, abs=1e-6)
    assert recording.stated.name == "Intel RealSense D435"
    # ROS counts from the centre of the first pixel, glsim from its corner.
    assert (recording.camera.fx, recording.camera.cx) == (390.4315, 32.5)
    for number in (3, 0, 1, 2, 5, 5):  # in any order
        frame = recording.frames[number]
        np.testing.assert_allclose(frame.noisy_mm, DEPTHS[number] * 0.1, rtol=1e-6)
        np.testing.assert_array_equal(frame.infrared, LIGHTS[number])
    (tmp_path / "camera.toml").write_text("unit_mm = 2\n")
    np.testing.assert_array_equal(open_maps(file).frames[1].noisy_mm, DEPTHS[1] * 2.0)
    again = pickle.loads(pickle.dumps(recording))
    np.testing.assert_array_equal(again.frames[4].infrared, LIGHTS[4])
    (tmp_path / "camera.toml").write_text("unit_mm = 0.5\n")
    stated = open_maps(tmp_path)  # the folder that holds it
    np.testing.assert_array_equal(stated.frames[0].noisy_mm, DEPTHS[0] * 0.5)
    assert stated.camera.fx == 390.4315


def test_a_bag_of_a_ros_node_with_depth_in_metres(tmp_path: Path) -> None:
    metres = [np.where(d > 600, d / 1000, np.nan).astype(np.float32) for d in DEPTHS]
    topics = ("/camera/depth/image_rect_raw", "/camera/infra1/image_rect_raw")
    lights = [light.astype(np.uint16) * 3 for light in LIGHTS]
    write_bag(tmp_path / "a.bag", metres, lights, topics=topics, encoding="32FC1")
    frame = open_maps(tmp_path / "a.bag").frames[2]
    np.testing.assert_allclose(frame.noisy_mm, np.where(DEPTHS[2] > 600, DEPTHS[2], 0), rtol=1e-5)
    np.testing.assert_array_equal(frame.infrared, lights[2])
    assert frame.step_mm == 0.0


@pytest.mark.parametrize("packed", [False, True])
def test_a_ros_2_bag_is_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packed: bool
) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    message = types.types
    stamp = message["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = message["std_msgs/msg/Header"](stamp=stamp, frame_id="0")
    kind = "sensor_msgs/msg/Image"
    writer = Writer(tmp_path / "bag", version=8)
    if packed:
        writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer as bag:
        topic = bag.add_connection("/camera/depth/image_rect_raw", kind, typestore=types)
        for number, depth in enumerate(DEPTHS):
            image = message[kind](
                header=header, height=48, width=64, encoding="16UC1", is_bigendian=0, step=128,
                data=depth.view(np.uint8).ravel(),
            )  # fmt: skip
            bag.write(topic, number * 10**7, types.serialize_cdr(image, kind))
    recording = open_maps(tmp_path / "bag")
    assert (recording.kind, len(recording.frames)) == ("bag", 6)
    np.testing.assert_array_equal(recording.frames[3].noisy_mm, DEPTHS[3])
    if packed:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
        with pytest.raises(DatasetError, match="more than half of the free space"):
            open_maps(tmp_path / "bag")


@pytest.mark.parametrize("codec", ["rawvideo", pytest.param("ffv1", marks=pytest.mark.long)])
def test_an_azure_kinect(tmp_path: Path, codec: str) -> None:
    file = tmp_path / "a.mkv"
    colour = [np.zeros((64, 64, 3), np.uint8)] * 4
    tracks: dict[str, list[Any]] = {"COLOR": colour, "DEPTH": AZURE, "IR": AZURE_IR}
    write_mkv(file, tracks, azure_calibration(), codec=codec)
    recording = open_maps(file)
    assert (recording.kind, len(recording.frames)) == ("mkv", 4)
    for number in (2, 0, 1, 3):
        frame = recording.frames[number]
        np.testing.assert_array_equal(frame.noisy_mm, AZURE[number])
        np.testing.assert_array_equal(frame.infrared, AZURE_IR[number])
    camera = recording.camera
    assert camera.fx == pytest.approx(0.4928 * 1024)
    assert camera.cx == pytest.approx(0.513 * 1024 - 192)
    assert camera.cy == pytest.approx(0.517 * 1024 - 180)
    assert recording.distortion[0] == pytest.approx(0.548)
    assert recording.distortion[3] == pytest.approx(-7e-5)  # p2
    assert recording.notes == ()
    again = pickle.loads(pickle.dumps(recording))
    np.testing.assert_array_equal(again.frames[3].noisy_mm, AZURE[3])


def test_binned_modes_have_their_part_of_the_chip(tmp_path: Path) -> None:
    images = [image[::2, ::2].copy() for image in AZURE]
    write_mkv(tmp_path / "a.mkv", {"DEPTH": images}, azure_calibration())
    recording = open_maps(tmp_path / "a.mkv")
    assert recording.camera.fx == pytest.approx(0.4928 * 512)
    assert recording.camera.cx == pytest.approx(0.513 * 512 - 96)
    assert recording.frames[0].infrared is None


@pytest.mark.parametrize(
    ("calibration", "note"), [(None, "has no calibration.json"), (b"{}", "cannot be used")]
)
def test_without_calibration_the_shipped_camera_is_assumed_and_said(
    tmp_path: Path, calibration: bytes | None, note: str
) -> None:
    write_mkv(tmp_path / "a.mkv", {"DEPTH": AZURE}, calibration)
    recording = open_maps(tmp_path / "a.mkv")
    assert (recording.frames.intrinsics.fx, recording.assumed) == (504.5, "azure-kinect")
    assert note in recording.notes[0]


def test_a_recording_that_was_cut_off_ends_with_its_last_whole_frame(tmp_path: Path) -> None:
    file = tmp_path / "a.mkv"
    write_mkv(file, {"DEPTH": AZURE, "IR": AZURE_IR}, azure_calibration())
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    recording = open_maps(file)
    assert 1 <= len(recording.frames) < 4
    np.testing.assert_array_equal(recording.frames[-1].noisy_mm, AZURE[len(recording.frames) - 1])


def test_frames_are_read_one_by_one(tmp_path: Path) -> None:
    """A recording of 100 frames takes no more memory than one of 20 (a chunk holds seven)."""
    peaks = []
    for count in (20, 100):
        file = tmp_path / f"{count}.bag"
        write_bag(file, [np.full((240, 320), 900, np.uint16)] * count)
        tracemalloc.start()
        recording = open_maps(file)
        for number in range(len(recording.frames)):
            assert recording.frames[number].noisy_mm.any()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def _write_bad(file: Path, case: str) -> None:
    if case == "colour":
        write_mkv(file, {"COLOR": [np.zeros((64, 64, 3), np.uint8)]})
    elif case == "truncated":
        write_bag(file, DEPTHS, LIGHTS)
        data = file.read_bytes()
        file.write_bytes(data[: len(data) * 2 // 3])
    elif case == "no depth":
        write_bag(file, LIGHTS, encoding="mono8", topics=(f"{SENSOR}/Infrared_1/image/data", ""))
    elif case == "cut image":
        write_bag(file, [np.zeros((4, 4), np.uint16)])
    elif case == "no frames":
        from rosbags.rosbag1 import Writer

        with Writer(file):
            pass


@pytest.mark.parametrize(
    ("name", "case", "message"),
    [
        ("a.mkv", "colour", "has no depth track of 16-bit grey, only COLOR (yuvj420p)"),
        ("a.bag", "truncated", "repair it by rosbag reindex"),
        ("a.bag", "no depth", "holds no images whose name says depth"),
        ("a.bag", "cut image", "has 4 x 4 pixels"),
        ("a.bag", "no frames", "holds no images whose name says depth"),
    ],
)
def test_bad_files_get_one_line(
    tmp_path: Path, name: str, case: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    _write_bad(tmp_path / name, case)
    out = str(tmp_path / "d")
    assert main(["import", "kinect2", str(tmp_path / name), "-o", out, "-q"]) == 1
    error = capfd.readouterr().err.strip()
    assert message in error
    assert name in error
    assert "\n" not in error


def test_several_recordings_are_not_mixed(tmp_path: Path) -> None:
    for name in ("a.bag", "b.bag"):
        write_bag(tmp_path / name, DEPTHS)
    with pytest.raises(DatasetError, match="each holds a recording of its own"):
        open_maps(tmp_path)
    with pytest.raises(ConfigError, match="holds the infrared images itself"):
        open_maps(tmp_path / "a.bag", infrared=tmp_path)


@pytest.mark.parametrize("names", [
    ["x_2020-01-01-10-00-00_0.bag", "x_2020-01-01-10-05-00_1.bag", "x_2020-01-01-10-10-00_2.bag"],
    ["p1_0.mcap", "p1_1.mcap", "p1_2.mcap"],
])  # fmt: skip
def test_the_parts_of_a_split_bag_are_one_recording(tmp_path: Path, names: list[str]) -> None:
    folder, out = tmp_path / "p1", tmp_path / "out"
    folder.mkdir()
    for number, name in enumerate(names):
        own = DEPTHS[2 * number : 2 * number + 2]
        lights = LIGHTS[2 * number : 2 * number + 2]
        images = {"/depth/image_raw": (own, "16UC1"), "/ir/image_raw": (lights, "mono8")}
        info = {"/depth/camera_info": {"size": (64, 48)}}
        write_topics(folder / name, images, info, start=2 * number)
    recording = open_maps(folder)
    assert len(recording.frames) == 6
    assert "its 3 files are read as the parts of one recording" in recording.sentence()
    for number in (5, 0, 1, 2, 3, 4, 1):
        np.testing.assert_array_equal(recording.frames[number].noisy_mm, DEPTHS[number])
        np.testing.assert_array_equal(recording.frames[number].infrared, LIGHTS[number])
    for place in (folder, tmp_path):  # as a recording, and as the folder of one
        assert main(["import", "kinect2", str(place), "-o", str(out), "-q"]) == 0
        assert len(open_dataset(out)) == 6
        shutil.rmtree(out)
    hashes = RecordingSource(folder).contents(["p1"])
    assert {*names} <= {*hashes}
    (folder / names[2]).write_bytes(b"changed")
    alone = open_maps(folder / names[1])
    assert len(alone.frames) == 2
    assert f"is one of 3 parts: give the folder {folder} to read all" in alone.sentence()
    (folder / names[1]).unlink()
    with pytest.raises(DatasetError, match="each holds a recording of its own"):
        open_maps(folder)


@pytest.mark.parametrize(("name", "library"), [("a.bag", "rosbags"), ("a.mkv", "av")])
def test_without_the_library_the_extra_is_named(tmp_path: Path, name: str, library: str) -> None:
    (tmp_path / name).write_bytes(b"x")
    code = (
        "import importlib.util, sys; find = importlib.util.find_spec\n"
        "import glsim.core.errors\n"
        f"glsim.core.errors.find_spec = lambda n: None if n == {library!r} else find(n)\n"
        "from glsim.cli import main\n"
        f"sys.exit(main(['import', 'kinect2', {str(tmp_path / name)!r}, '-o', 'x']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    cure = pip_install("recordings")
    assert f"needs {library}, which is not installed: {cure}" in done.stderr


def test_nearest_moments() -> None:
    times = np.array([0, 33, 66, 99])
    assert nearest(times, np.array([1, 34, 65, 98])) == [0, 1, 2, 3]
    assert nearest(times, np.array([34, 65])) == [None, 0, 1, None]
    assert nearest(times, np.array([], int)) == [None] * 4
    assert nearest(np.array([5]), np.array([7])) == [0]
    assert nearest(np.array([4, 4, 4]), np.array([4, 4, 4])) == [0, 1, 2]
