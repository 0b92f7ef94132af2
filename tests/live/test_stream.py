"""The pictures of ``glsim live``: measured and denoised, and the loop of a recording."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.cli import main
from glsim.denoise import load_denoiser
from glsim.errors import ConfigError, DatasetError
from glsim.files.png import encode_png
from glsim.live.source import RecordingSource
from glsim.live.stream import STEP_MM, LiveStream
from glsim.recordings.recording import open_recording
from tests.support.bags import write_bag, write_mkv
from tests.support.networks import write_checkpoint
from tests.support.recordings import scene, write_static_pair

SHAPE = (40, 48)


def unpack(packet: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """The head and the layers of a packet, as assets/packet.js reads them."""
    size = int.from_bytes(packet[:4], "little")
    head = json.loads(packet[4 : 4 + size])
    layers, at = {}, 4 + size
    for name, kind in head["layers"]:
        shape = head["window"][3], head["window"][2]
        count = shape[0] * shape[1]
        layers[name] = np.frombuffer(packet, f"<{kind}", count, at).reshape(shape)
        at += -(-layers[name].nbytes // 4) * 4
    return head, layers


def frames(count: int = 3) -> list[Any]:
    """Noisy planes, (T, H, W) uint16 mm; frame k is k mm farther."""
    rng = np.random.default_rng(3)
    planes = [rng.normal(900 + k, 3, SHAPE) for k in range(count)]
    return [np.rint(plane).astype(np.uint16) for plane in planes]


def live(path: Path, spec: str = "median:size=5", around: str | None = None) -> LiveStream:
    return LiveStream(
        RecordingSource(open_recording(path)),
        lambda spec, around: load_denoiser(spec, around=around),
        spec,
        around,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number, depth in enumerate(frames()):
        (tmp_path / f"frame_{number}.png").write_bytes(encode_png(depth))
    return tmp_path


def test_pictures_hold_what_is_measured_and_what_glsim_denoise_makes_of_it(folder: Path) -> None:
    stream, denoiser = live(folder), load_denoiser("median:size=5")
    for number, depth in enumerate([*frames()[1:], frames()[0]], 1):
        head, layers = unpack(stream.next(number))
        assert (head["number"], head["source_frame"]) == (number, number % 3)
        assert head["depth_unit_mm"] == STEP_MM
        assert (head["width"], head["height"]) == SHAPE[::-1]
        assert head["milliseconds"] > 0
        np.testing.assert_allclose(layers["noisy"] * STEP_MM, depth, atol=STEP_MM / 2)
        expected = denoiser(depth).depth_mm
        np.testing.assert_allclose(layers["clean"] * STEP_MM, expected, atol=STEP_MM / 2 + 1e-3)
        assert (layers["noisy"] != layers["clean"]).mean() > 0.5


def test_a_recording_begins_again_and_so_does_what_uses_earlier_frames(folder: Path) -> None:
    """A first frame that remembered the last ones would be their median, not itself."""
    stream = live(folder, "temporal_median")
    first = unpack(stream.again(1))[1]["clean"]
    for number in range(2):
        stream.next(number)
    np.testing.assert_array_equal(unpack(stream.next(4))[1]["clean"], first)


def test_a_recording_is_not_faster_than_a_camera(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        clock[0] += seconds

    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    monkeypatch.setattr("time.sleep", sleep)
    source = RecordingSource(open_recording(folder))
    for _ in range(4):
        source.next()
    assert slept == pytest.approx([0, 1 / 30, 1 / 30, 1 / 30])


def test_the_denoiser_changes_and_a_wrong_one_leaves_the_former(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    infrared = str(
        write_checkpoint(tmp_path_factory.mktemp("net") / "infrared.pt", inputs="infrared")
    )
    stream = live(folder, "noisy")
    layers = unpack(stream.again(1))[1]
    np.testing.assert_array_equal(layers["clean"], layers["noisy"])
    stream.choose("median:size=3", "face")
    assert (stream.spec, stream.around) == ("median:size=3", "face")
    assert (unpack(stream.again(2))[1]["clean"] != layers["clean"]).any()
    for wrong, said in (("medium", "did you mean"), (infrared, "uses infrared, which")):
        with pytest.raises(ConfigError, match=said):
            stream.choose(wrong, None)
        assert stream.spec == "median:size=3"
    assert unpack(stream.next(3))[0]["source_frame"] == 1


def test_the_ends_of_the_colours_follow_slowly(tmp_path: Path) -> None:
    """One flying pixel, or a person who comes in, does not make all colours jump."""
    for number, far in enumerate((1000, 1000, 5000)):
        depth = np.full(SHAPE, far, np.uint16)
        depth[:20] = 800
        (tmp_path / f"{number}.png").write_bytes(encode_png(depth))
    stream = live(tmp_path, "noisy")
    ends = [unpack(stream.again(1))[0]["depth_ends"]]
    ends += [unpack(stream.next(number))[0]["depth_ends"] for number in (2, 3)]
    assert ends[0] == ends[1] == pytest.approx([800 / STEP_MM, 1000 / STEP_MM])
    assert ends[2] == pytest.approx([800 / STEP_MM, 1400 / STEP_MM])


def test_bags_and_matroska_files_play_with_their_infrared(tmp_path: Path) -> None:
    depths = frames(2)
    lights = [np.full(SHAPE, 80 + k, np.uint8) for k in range(2)]
    pytest.importorskip("rosbags", reason="the extra glsim[recordings] is not installed")
    write_bag(tmp_path / "a.bag", depths, lights)
    wide = [light.astype(np.uint16) * 100 for light in lights]
    write_mkv(tmp_path / "a.mkv", {"DEPTH": depths, "IR": wide})
    for file, scale in (("a.bag", 1), ("a.mkv", 100)):
        stream = live(tmp_path / file)
        layers = unpack(stream.next(1))[1]
        np.testing.assert_allclose(layers["noisy"] * STEP_MM, depths[1], atol=STEP_MM / 2)
        assert (layers["infrared"] == scale * 81).all()


def test_infrared_reaches_the_network_that_uses_it(tmp_path: Path) -> None:
    (tmp_path / "recording").mkdir()
    write_static_pair(tmp_path / "recording", scene(), 2.0)
    network = str(write_checkpoint(tmp_path / "infrared.pt", inputs="infrared"))
    stream = live(tmp_path / "recording", network)
    head, layers = unpack(stream.again(1))
    assert [name for name, _ in head["layers"]] == ["noisy", "clean", "infrared"]
    frame = RecordingSource(open_recording(tmp_path / "recording")).next()
    denoiser = load_denoiser(network)
    seen = denoiser(frame.depth_mm, infrared=frame.infrared).depth_mm
    np.testing.assert_allclose(layers["clean"] * STEP_MM, seen, rtol=0, atol=0.51 * STEP_MM)
    assert np.abs(seen - denoiser(frame.depth_mm).depth_mm).max() > STEP_MM


def test_a_frame_that_cannot_be_read_is_said_and_the_next_one_is_shown(folder: Path) -> None:
    stream = live(folder)
    (folder / "frame_1.png").write_bytes(b"damaged")
    with pytest.raises(DatasetError, match=r"frame_1\.png"):
        stream.next(1)
    assert unpack(stream.next(2))[0]["source_frame"] == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "give either a recording or --camera"),
        (["recording", "--camera", "oak"], "give either a recording or --camera"),
        (["nowhere"], "nowhere: no such folder"),
        (["recording", "-d", "medium"], "did you mean 'median'"),
        (["recording", "--around", "feet"], "--around feet: known: face"),
        (["recording", "-d", "infrared.pt"], "uses infrared, which recording does not give"),
        (["--camera", "webcam"], "--camera webcam: known: azure-kinect, oak, realsense"),
        (["--camera", "oak", "--depth-unit-mm", "1"], "--depth-unit-mm does not go with --camera"),
        (["recording", "--host", "300.1.1.1"], "--host 300.1.1.1"),
    ],
)
def test_mistakes_are_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    pytest.importorskip("nicegui", reason="the extra glsim[tune] is not installed")
    (tmp_path / "recording").mkdir()
    (tmp_path / "recording" / "a.png").write_bytes(encode_png(frames(1)[0]))
    write_checkpoint(tmp_path / "infrared.pt", inputs="infrared")
    monkeypatch.chdir(tmp_path)
    assert main(["live", *words, "--no-browser"]) in (1, 2)
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
