"""Test ``glsim import kinect2``: recordings as data sets without clean maps, and their readers."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.cli import main
from glsim.core.errors import DatasetError
from glsim.core.files.atomic import write_atomic
from glsim.core.files.png import encode_png
from glsim.data.maps import open_maps
from glsim.data.reader import open_dataset
from glsim.data.verification import verify
from tests.support.planted_frames import SHAPE, noisy, plane

DEPTH = noisy(plane(900.0, 0.2), 1.2, 1)
LIGHT = np.where(np.arange(SHAPE[1]) < 200, 5000, 9000).astype(np.uint16) * np.ones(
    SHAPE, np.uint16
)


def _iai(folder: Path, frames: int = 2, infrared: bool = True) -> Path:
    """A calibration folder of iai_kinect2 with colour pictures beside the depth frames."""
    for number in range(frames):
        for middle in ("", "_sync"):
            stem = f"{number:04d}{middle}"
            write_atomic(encode_png(DEPTH + number), folder / f"{stem}_depth.png")
            if infrared:
                write_atomic(encode_png(LIGHT), folder / f"{stem}_ir.png")
        cv2.imwrite(str(folder / f"{number:04d}_color.png"), np.zeros((40, 40, 3), np.uint8))
    return folder


def _import(root: Path, out: Path, *options: str) -> int:
    return main(["import", "kinect2", str(root), "-o", str(out), "-q", *options])


def test_a_calibration_folder_becomes_a_data_set_without_clean_maps(tmp_path: Path) -> None:
    root = _iai(tmp_path / "room 1")
    storage = cv2.FileStorage(str(root / "calib_ir.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.write("cameraMatrix", np.array([[364.9, 0, 255.7], [0, 365.6, 201.5], [0, 0, 1]]))
    storage.write("distortionCoefficients", np.array([[0.11, -0.36, -0.004, 0.004, 0.16]]))
    storage.release()
    out = tmp_path / "out"
    assert _import(root, out) == 0
    dataset = open_dataset(out)
    assert dataset.layers == ("noisy", "infrared")
    assert verify(out, deep=True) == []
    pairs = list(dataset.split("test"))
    assert len(pairs) == 4
    assert [pair.record["path"] for pair in pairs][:2] == ["0000_depth.png", "0000_sync_depth.png"]
    np.testing.assert_array_equal(pairs[0].noisy_mm, DEPTH)
    np.testing.assert_array_equal(pairs[0].infrared, LIGHT)
    # OpenCV counts from the centre of the first pixel, glsim from its corner.
    assert (pairs[0].intrinsics.fx, pairs[0].intrinsics.cx) == (364.9, pytest.approx(256.2))
    assert pairs[0].record["notes"]["distortion_not_removed"][0] == 0.11
    assert "clean_mm" not in pairs[0]
    with pytest.raises(DatasetError, match="has no layer 'clean'"):
        _ = pairs[0].clean_mm


def test_import_finds_the_kind_of_a_path(tmp_path: Path) -> None:
    root, out = _iai(tmp_path / "room"), tmp_path / "out"
    assert main(["import", str(root), "-o", str(out), "-q"]) == 0
    assert _import(root, tmp_path / "named") == 0
    names = [p.relative_to(out) for p in sorted(out.rglob("*.png"))]
    assert names
    assert all((out / n).read_bytes() == (tmp_path / "named" / n).read_bytes() for n in names)


def test_an_import_of_changed_recordings_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A set of two halves could otherwise be made: frames of before and of after the change."""
    root, out = _iai(tmp_path / "room"), tmp_path / "set"
    assert _import(root, out) == 0
    (out / "dataset.json").unlink()
    assert _import(root, out, "--mirror") == 2
    assert "source 0 kinect2 was changed since" in capsys.readouterr().err
    file = sorted(root.glob("*_depth.png"))[-1]
    whole = file.read_bytes()
    file.write_bytes(encode_png(np.full(SHAPE, 1234, np.uint16)))
    assert _import(root, out) == 2
    assert "source 0 kinect2 was changed since" in capsys.readouterr().err
    file.write_bytes(whole)
    assert _import(root, out) == 0


def _stack(folder: Path, depth: np.ndarray, light: np.ndarray | None = None) -> Path:
    folder.mkdir()
    np.save(folder / "run_depth.npy", depth)
    if light is not None:
        np.save(folder / "run_ir.npy", light)
    return folder


@pytest.mark.parametrize(
    ("dtype", "factor"), [(np.uint16, 1.0), (np.float32, 1.0), (np.float64, 0.001)]
)
def test_stacks_of_millimetres_and_metres(tmp_path: Path, dtype: type, factor: float) -> None:
    stack: NDArray[Any] = (np.stack([DEPTH, DEPTH + 5]) * factor).astype(dtype)
    stack[0, 0, 0] = 0 if dtype is np.uint16 else np.nan
    found = open_maps(_stack(tmp_path / "s", stack, np.stack([LIGHT, LIGHT])))
    assert found.kind == "npy"
    assert [frame.name for frame in found.frames] == ["run_depth_00000", "run_depth_00001"]
    np.testing.assert_allclose(found.frames[1].noisy_mm, DEPTH + 5, atol=0.01)
    assert found.frames[0].noisy_mm[0, 0] == 0
    assert found.frames[0].step_mm == (1.0 if dtype is np.uint16 else 0.0)
    assert np.array_equal(found.frames[1].infrared, LIGHT)  # type: ignore[arg-type]
    out = tmp_path / "out"
    assert _import(tmp_path / "s", out) == 0
    pair = open_dataset(out).frames()[1]
    np.testing.assert_allclose(pair.noisy_mm, DEPTH + 5, atol=0.13)


def test_dumps_of_libfreenect2_are_floats_as_in_a_mirror(tmp_path: Path) -> None:
    dump = DEPTH.astype("<f4") + 0.25
    write_atomic(dump.tobytes(), tmp_path / "d" / "0001.depth")
    write_atomic(LIGHT.astype("<f4").tobytes(), tmp_path / "d" / "0001.ir")
    frame = open_maps(tmp_path / "d", mirror=True).frames[0]
    np.testing.assert_array_equal(frame.noisy_mm, dump[:, ::-1])
    np.testing.assert_array_equal(frame.infrared, LIGHT[:, ::-1])


def test_folders_of_tiff_files_with_infrared_in_a_folder_beside(tmp_path: Path) -> None:
    for layer, image in (("depth", DEPTH), ("ir", LIGHT)):
        (tmp_path / layer).mkdir()
        cv2.imwrite(str(tmp_path / layer / "0001.tiff"), image)
    frame = open_maps(tmp_path, unit_mm=0.5).frames[0]
    np.testing.assert_array_equal(frame.noisy_mm, DEPTH * 0.5)
    np.testing.assert_array_equal(frame.infrared, LIGHT)


@pytest.mark.parametrize("imported", [False, True])
def test_static_frames_of_a_folder_and_of_its_data_set(tmp_path: Path, imported: bool) -> None:
    """What ``glsim fit`` reads: two frames of a plane that show one view."""
    root, stack = tmp_path / "iai", [DEPTH, noisy(plane(900.0, 0.2), 1.2, 2)]
    for number, depth in enumerate(stack):
        write_atomic(encode_png(depth), root / f"{number:04d}_depth.png")
    if imported:
        assert _import(root, tmp_path / "set") == 0
    frames = open_maps(tmp_path / "set" if imported else root).read_static()
    for frame, depth in zip(frames, stack, strict=True):
        np.testing.assert_allclose(frame.measured_mm, depth, atol=1e-3)
    assert frames[0].step_mm == 1.0


def test_a_folder_of_recordings_has_one_subject_each(tmp_path: Path) -> None:
    _iai(tmp_path / "all" / "kitchen", 1)
    _iai(tmp_path / "all" / "hall", 2, infrared=False)
    out = tmp_path / "out"
    assert _import(tmp_path / "all", out, "--every", "2", "--split", "0.5,0,0.5") == 0
    dataset = open_dataset(out)
    assert dataset.layers == ("noisy",)
    assert sorted((pair.key.subject, pair.key.frame) for pair in dataset) == [
        ("hall", 0), ("hall", 2), ("kitchen", 0),
    ]  # fmt: skip


def test_damaged_frames_are_skipped_with_a_reason(tmp_path: Path) -> None:
    root = _iai(tmp_path / "room")
    write_atomic((root / "0001_depth.png").read_bytes()[:500], root / "0001_depth.png")
    write_atomic(encode_png(LIGHT[:100]), root / "0001_sync_ir.png")
    write_atomic(encode_png(np.zeros(SHAPE, np.uint16)), root / "0000_sync_depth.png")
    out = tmp_path / "out"
    assert _import(root, out) == 0
    assert len(open_dataset(out)) == 1
    skipped = (out / "skipped.jsonl").read_text()
    for why in ("is no readable image", "is 512x100, its depth map 512x424", "no pixel has depth"):
        assert why in skipped


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("missing", "no such file or folder"),
        ("empty", "holds no depth maps"),
        ("colour", "is (40, 40, 3) uint8: a depth map is (H, W)"),
        ("packets", "decode raw packets with libfreenect2 first"),
        ("unit", "must be above 0"),
    ],
)
def test_other_folders_are_refused_in_one_line(
    tmp_path: Path, case: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "dir"
    if case != "missing":
        root.mkdir()
    if case == "colour":
        cv2.imwrite(str(root / "a.png"), np.zeros((40, 40, 3), np.uint8))
    elif case == "packets":
        (root / "a.bin").write_bytes(bytes(2_984_960))
    elif case == "unit":
        (root / "a.png").write_bytes(encode_png(DEPTH))
    options = ["--depth-unit-mm", "0"] if case == "unit" else []
    assert _import(root, tmp_path / "out", *options) in (1, 2)
    error = capsys.readouterr().err.strip()
    assert error.startswith("glsim: error: ")
    assert message in error
    assert "\n" not in error


def test_every_reader_copes_with_a_data_set_without_clean_maps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert _import(_iai(tmp_path / "room"), out, "--split", "0,0,1") == 0
    assert main(["preview", str(out), "-o", str(tmp_path), "-q"]) == 0
    sheet = cv2.imread(str(tmp_path / "contact_sheet.png"))
    assert sheet.shape[1] == 600  # noisy and infrared
    assert sheet[100:300, 300:].std() > 20
    assert "no clean maps" in (tmp_path / "summary.md").read_text()
    capsys.readouterr()
    assert main(["eval", str(out), "-d", "noisy", "-o", str(tmp_path / "r"), "-q"]) == 1
    assert "has no layer 'clean'" in capsys.readouterr().err
    config = tmp_path / "recorded.toml"
    config.write_text('[source]\nkind = "kinect2"\nroot = "room"\n')
    assert main(["generate", "--config", str(config), "-o", str(tmp_path / "g"), "-q"]) == 2
    assert "glsim import kinect2" in capsys.readouterr().err
