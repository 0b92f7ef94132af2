"""``glsim denoise --watch``: files as they appear, kills, Ctrl-C, wrong arguments."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.denoise import load_denoiser
from glsim.denoise.watch import Watched, watch_folder
from glsim.errors import ConfigError
from glsim.files import arrivals
from glsim.files.png import encode_png, read_depth_png
from glsim.map_files import encode_map, read_map_mm
from tests.support.eval_scenes import dome, noisy

FRAMES = [np.rint(noisy(dome(), seed)).astype(np.uint16) for seed in range(6)]


def write(folder: Path, number: int) -> None:
    folder.mkdir(exist_ok=True)
    (folder / f"{number}.png").write_bytes(encode_png(FRAMES[number]))


def some(folder: Path, out: Path, count: int, spec: str = "noisy") -> list[Watched]:
    watched = watch_folder(folder, out, load_denoiser(spec), 1.0)
    return [next(watched) for _ in range(count)]


def test_maps_that_appear_are_denoised_in_order_with_those_before(tmp_path: Path) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    for number in (0, 1):
        write(folder, number)
    watched = watch_folder(folder, out, load_denoiser("temporal_median"), 1.0)
    done = [next(watched), next(watched)]
    for number in (3, 2, 4):
        write(folder, number)
    done += [next(watched) for _ in range(3)]
    assert [item.source.name for item in done] == [f"{n}.png" for n in range(5)]
    assert [item.latency_s is None for item in done] == [True, True, False, False, False]
    assert all(not item.problem and item.seconds > 0 for item in done)
    stream = load_denoiser("temporal_median").stream()
    for number in range(5):
        expected = stream.push(FRAMES[number]).depth_mm
        np.testing.assert_allclose(read_depth_png(out / f"{number}.png"), expected, atol=0.501)


#: Suffix -> format.
FORMS = {".npy": "npy", ".tif": "tiff", ".exr": "exr"}


@pytest.mark.parametrize("suffix", FORMS)
def test_maps_of_other_formats_keep_them(tmp_path: Path, suffix: str) -> None:
    if suffix == ".exr":
        pytest.importorskip("OpenEXR")
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    for number in (0, 1):
        depth_m = np.asarray(FRAMES[number] / 1000, np.float32)
        (folder / f"{number}{suffix}").write_bytes(encode_map(depth_m, FORMS[suffix], 1.0))
    (folder / "notes.txt").write_text("no map")
    done = some(folder, out, 2)
    assert [(item.source.name, item.problem) for item in done] == [
        (f"{number}{suffix}", "") for number in (0, 1)
    ]
    for number in (0, 1):
        found_mm = read_map_mm(out / f"{number}{suffix}", 1.0)
        np.testing.assert_allclose(found_mm, FRAMES[number], atol=0.01)


def test_a_broken_map_is_reported_and_the_others_are_denoised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrivals, "STALLED_S", -1.0)
    folder, out = tmp_path / "in", tmp_path / "out"
    for number in (0, 1, 2):
        write(folder, number)
    (folder / "1.png").write_bytes(encode_png(FRAMES[1])[:-30])
    done = some(folder, out, 3)
    assert [bool(item.problem) for item in done] == [False, True, False]
    assert "1.png: is no readable image" in done[1].problem
    assert sorted(path.name for path in out.iterdir()) == ["0.png", "2.png"]


def test_a_second_watch_goes_on_where_the_first_ended(tmp_path: Path) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    for number in (0, 1):
        write(folder, number)
    some(folder, out, 2)
    write(folder, 2)
    assert [item.source.name for item in some(folder, out, 1)] == ["2.png"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a.png", "--watch", "in"), "either depth maps to denoise, or a folder"),
        ((), "either depth maps to denoise, or a folder"),
        (("--watch", "none"), "no such folder"),
        (("--watch", "in", "--uncertainty", "s"), "does not go with --watch"),
        (("--watch", "in", "--composite", "hart"), "did you mean 'hard'"),
        (("--watch", "in", "--device", "kinect-v2"), "give the sensor file"),
    ],
)
def test_wrong_arguments(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    assert main(["denoise", *arguments, "-o", "out", "-d", "noisy"]) == 2
    assert words in capsys.readouterr().err


def test_the_watched_folder_is_not_written_to(tmp_path: Path) -> None:
    write(tmp_path / "in", 0)
    (tmp_path / "file").touch()
    for out, words in (("in", "is the folder that is watched"), ("file", "is a file")):
        with pytest.raises(ConfigError, match=words):
            some(tmp_path / "in", tmp_path / out, 1)


def wait_for(true: Callable[[], bool]) -> None:
    """Wait until something is true; ten minutes at most, for a machine that does much else."""
    for _ in range(12_000):
        if true():
            return
        time.sleep(0.05)
    raise AssertionError("it did not become true within ten minutes")


def start(folder: Path, out: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "glsim", "denoise", "--watch", str(folder), "-o", str(out)]
    # A process that a shell put into the background ignores Ctrl-C, and so do its children.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            [*command, "-d", "masked_median"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_ctrl_c_ends_with_a_count_and_the_latency(tmp_path: Path, number: signal.Signals) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    write(folder, 0)
    process = start(folder, out)
    wait_for((out / "0.png").is_file)
    write(folder, 1)
    wait_for((out / "1.png").is_file)
    process.send_signal(number)
    printed = " ".join("".join(process.communicate(timeout=60)).split())
    assert process.returncode == 0
    assert "wrote 2 denoised depth map(s)" in printed
    assert re.search(r"time of a map: median \d+ ms, 95 % within \d+ ms", printed)
    assert re.search(r"latency, file complete to map written: median \d+ ms", printed)
    assert "Traceback" not in printed


@pytest.mark.long
def test_a_killed_watch_leaves_whole_maps_only_and_can_be_started_again(tmp_path: Path) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    for number in range(3):
        write(folder, number)
    process = start(folder, out)
    wait_for((out / "0.png").is_file)
    process.kill()
    process.communicate(timeout=60)
    for path in out.glob("*.png"):
        read_depth_png(path)
    for number in range(3, 6):
        write(folder, number)
    watched = watch_folder(folder, out, load_denoiser("masked_median"), 1.0)
    wait_for(lambda: next(watched).source.name == "5.png")
    assert sorted(path.name for path in out.glob("*.png")) == [f"{n}.png" for n in range(6)]
