"""Depth maps as PNG, TIFF, NPY and OpenEXR: the same depth in, the same depth out."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.cli import main
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.exr import encode_exr
from glsim.data.map_files import SUFFIXES, encode_map, format_of
from glsim.data.recordings.files import FramePlace, MapFiles, read_map_mm

UNITS = (900 + np.random.default_rng(0).normal(0, 3, (24, 32))).astype(np.uint16)
UNITS[:4] = 0
METRES = (UNITS / 1000).astype(np.float32)


def write(path: Path, values: NDArray[Any]) -> Path:
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".exr":
        path.write_bytes(encode_exr(values.astype(np.float32)))
    else:
        assert cv2.imwrite(str(path), values)
    return path


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("a.png", UNITS), ("a.tif", UNITS), ("a.tiff", METRES), ("a.npy", UNITS), ("b.npy", METRES),
        ("c.npy", METRES.astype(np.float64)), ("a.exr", METRES),
    ],
)  # fmt: skip
def test_each_format_is_read_as_millimetres(
    tmp_path: Path, name: str, values: NDArray[np.generic]
) -> None:
    if name.endswith(".exr"):
        pytest.importorskip("OpenEXR")
    found = read_map_mm(write(tmp_path / name, values), 1.0)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, UNITS, atol=1e-4)
    assert not found[:4].any()
    if values.dtype == np.uint16:
        place = FramePlace("", tmp_path / name, offset_mm=10.0)
        finer, _ = MapFiles([place], 0.25).depth(0)
        np.testing.assert_array_equal(finer[4:], UNITS[4:] * np.float32(0.25) + 10)
        assert not finer[:4].any()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_is_read_again(tmp_path: Path, suffix: str) -> None:
    if suffix == ".exr":
        pytest.importorskip("OpenEXR")
    data = encode_map(METRES, format_of(Path(f"x{suffix}")), 0.5)
    (tmp_path / f"x{suffix}").write_bytes(data)
    np.testing.assert_allclose(read_map_mm(tmp_path / f"x{suffix}", 0.5), UNITS, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "values", "reason"),
    [
        ("a.npy", UNITS.astype(np.float32) / 10, "neither metres"),
        ("a.npy", np.stack([METRES] * 5), "is a stack of 5 maps"),
        ("a.npy", np.dstack([METRES, METRES, 2 * METRES]), r"is \(24, 32, 3\) float32"),
        ("a.npy", METRES.ravel(), r"is \(768,\) float32"),
        ("a.npy", UNITS > 0, r"is \(24, 32\) bool: a depth map is \(H, W\).* float metres$"),
        ("a.tiff", np.zeros((4, 4), np.uint8), "16-bit whole numbers or float metres"),
    ],
)
def test_other_arrays_are_refused(
    tmp_path: Path, name: str, values: NDArray[np.generic], reason: str
) -> None:
    with pytest.raises(DatasetError, match=rf"{name}: .*{reason}"):
        read_map_mm(write(tmp_path / name, values), 1.0)


def test_openexr_that_is_not_installed_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.core.errors.find_spec", lambda name: None)
    (tmp_path / "a.exr").write_bytes(b"any")
    asked = pytest.raises(ConfigError, match=r"needs OpenEXR, .*: pip install .*\[formats\]'")
    with asked:
        read_map_mm(tmp_path / "a.exr", 1.0)
    with asked:
        encode_map(METRES, "exr", 1.0)
    write(tmp_path / "noisy.png", UNITS)
    out = tmp_path / "out.exr"
    assert main(["denoise", str(tmp_path / "noisy.png"), "-o", str(out), "-d", "median"]) == 2
    assert not out.exists()


def test_denoise_and_corrupt_take_all_formats(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(Path("noisy.png"), UNITS)
    write(Path("noisy.npy"), METRES)
    for name in ("noisy.png", "noisy.npy"):
        for suffix in (".png", ".npy", ".tiff", ".exr"):
            step = ["--out-unit-mm", "1"] if suffix == ".png" else []
            out = ["-o", f"{name[-3:]}{suffix}", *step]
            assert main(["denoise", name, *out, "-d", "median", "-q"]) == 0
    assert Path("png.npy").read_bytes() == Path("npy.npy").read_bytes()
    for suffix in (".png", ".tiff"):
        found = cv2.imread(f"npy{suffix}", cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(found, np.rint(np.load("png.npy") * 1000).astype(np.uint16))
    assert main(["corrupt", "noisy.npy", "-o", "more.npy", "--backend", "numpy", "-q"]) == 0
    more = np.load("more.npy")
    assert (more.dtype, more.shape) == (np.float32, METRES.shape)
    assert 0.1 < 1000 * np.abs(more - METRES)[(more > 0) & (METRES > 0)].mean() < 20
    Path("folder").mkdir()
    write(Path("folder/a.npy"), METRES)
    write(Path("folder/b.tiff"), UNITS)
    for command in (["denoise", "-d", "median"], ["corrupt", "--backend", "numpy"]):
        assert main([command[0], "folder", "-o", f"out_{command[0]}", *command[1:], "-q"]) == 0
        names = sorted(path.name for path in Path(f"out_{command[0]}").iterdir())
        assert names == ["a.npy", "b.tiff", "camera.toml"]
        assert main([*command[:1], "noisy.png", "-o", "x.jpg", *command[1:]]) == 2
        assert "ends in .png, .tif, .tiff, .npy, .exr" in capsys.readouterr().err
