"""Test ``glsim import biwi``: real depth with the posed template as the clean map."""

from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import DatasetError
from glsim.data.maps import open_maps
from glsim.data.reader import open_dataset
from glsim.data.recordings.biwi import read_depth_bin
from glsim.faces.scans.head_pose import read_pose
from glsim.faces.sources.biwi import Biwi
from tests.support.face_sets import OTHERS, needs_others, put, write_recording


def _import(root: Path, out: Path, *options: str) -> int:
    return main(["import", "biwi", str(root), "-o", str(out), "--workers", "1", "-q", *options])


def test_the_depth_is_that_of_the_file_and_the_template_lies_where_the_pose_says(
    tmp_path: Path,
) -> None:
    for number in (1, 2, 21):
        write_recording(tmp_path / "hpdb", number, frames=2)
    out = tmp_path / "out"
    assert _import(tmp_path, out, "--split", "0.5,0.5,0") == 0
    dataset = open_dataset(out)
    pairs = list(dataset)
    assert len(pairs) == 6
    assert len({pair.record["split"] for pair in pairs if pair.key.subject == "F02"}) == 1
    source = Biwi(tmp_path)
    for pair in pairs:
        path = tmp_path / "hpdb" / pair.record["notes"]["depth_file"]
        np.testing.assert_array_equal(pair.noisy_mm, read_depth_bin(path))
        assert pair.intrinsics.fx == 575.816
        assert pair.record["notes"]["colour_camera"]["centre_px"] == [320.5, 240.5]
        key = next(
            k for k in source.frames(pair.key.subject, None) if k.path == pair.record["path"]
        )
        points = source.in_camera(key).vertices_mm * np.array([1, -1, -1])
        nose = points[np.argmin(points[:, 2])]
        column, row = (pair.intrinsics.project(nose[None] / 1000)[0]).astype(int)
        assert abs(pair.clean_mm[row, column] - nose[2]) < 2
        centre = read_pose(tmp_path / "hpdb" / key.path).centre_mm
        ys, xs = np.nonzero(pair.clean_mm)
        assert abs(xs.mean() - (575.816 * centre[0] / centre[2] + 320)) < 20
        assert abs(ys.mean() - (575.816 * centre[1] / centre[2] + 240)) < 20


def test_damaged_frames_are_skipped_with_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_recording(tmp_path / "hpdb", 1, frames=4)
    data = (root / "01/frame_00003_depth.bin").read_bytes()
    put(root / "01/frame_00003_depth.bin", data[:-3])
    (root / "01/frame_00004_depth.bin").unlink()
    put(root / "01/frame_00005_pose.txt", b"1 2 3")
    out = tmp_path / "out"
    assert _import(root, out) == 0
    assert len(open_dataset(out)) == 1
    skipped = (out / "skipped.jsonl").read_text()
    assert "00003_depth.bin: is no depth file of Biwi" in skipped
    assert "00004_depth.bin: No such file" in skipped
    assert "3 numbers, not 12" in skipped
    put(root / "01/depth.cal", b"")
    assert _import(root, tmp_path / "none") == 1
    assert "no frame could be made" in capsys.readouterr().err


@needs_others
def test_a_whole_tree(tmp_path: Path) -> None:
    assert _import(OTHERS / "hpdb", tmp_path / "out") == 0
    (pair,) = open_dataset(tmp_path / "out")
    both = (pair.clean_mm > 0) & (pair.noisy_mm > 0)
    assert both.any()


def test_the_frames_of_a_person_are_a_recording(tmp_path: Path) -> None:
    write_recording(tmp_path / "hpdb", 1, frames=2)
    folder = tmp_path / "hpdb" / "01"
    recording = open_maps(folder)
    assert (recording.kind, recording.camera.fx) == ("biwi", 575.816)  # type: ignore[union-attr]
    frames = recording.read()
    files = sorted(folder.glob("*_depth.bin"))
    for frame, file in zip(frames, files, strict=True):
        np.testing.assert_array_equal(np.nan_to_num(frame.measured_mm), read_depth_bin(file))
    files[0].write_bytes(files[0].read_bytes()[:50])
    with pytest.raises(DatasetError, match="is no depth file of Biwi"):
        recording.read()
