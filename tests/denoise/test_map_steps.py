"""The step of denoised maps: what files state, 0.1 mm where a reader can know it, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.denoise.map_steps import unit_mm
from glsim.errors import ConfigError, DatasetError
from glsim.files.png import encode_png, read_depth_png, stated_unit_mm
from glsim.map_files import read_map_mm
from tests.support.dataset_fakes import make, make_settings, make_tasks

DEPTH_MM = 900 + np.random.default_rng(0).normal(0, 2, (40, 48)).astype(np.float32)


def write(path: Path, unit: float, stated: bool = False, depth_mm: object = DEPTH_MM) -> Path:
    units = np.rint(np.asarray(depth_mm) / unit).astype(np.uint16)
    path.write_bytes(encode_png(units, unit if stated else None))
    return path


def denoise(*arguments: str) -> int:
    return main(["denoise", *arguments, "-d", "masked_gaussian"])


def test_a_png_states_its_step_and_is_a_plain_png_to_others(tmp_path: Path) -> None:
    plain, stated = write(tmp_path / "a.png", 0.1), write(tmp_path / "b.png", 0.1, stated=True)
    assert stated_unit_mm(plain) is None
    assert stated_unit_mm(stated) == 0.1
    np.testing.assert_array_equal(read_depth_png(plain), read_depth_png(stated))
    assert unit_mm([stated], None) == unit_mm([stated], 0.1) == 0.1
    assert unit_mm([plain], None) == 1.0
    for given, words in ((1.0, "steps of 0.1 mm"), (None, "different steps")):
        files = [stated] if given else [plain, stated]
        with pytest.raises(ConfigError, match=words):
            unit_mm(files, given)
    with pytest.raises(DatasetError, match=r"b.png: states steps of 0.1 mm, not 1: give --depth-u"):
        read_map_mm(stated, 1.0)
    np.testing.assert_allclose(read_map_mm(stated, 0.1), DEPTH_MM, atol=0.051)


@pytest.mark.parametrize("text", ["x", "0", "nan", "1e9", ""])
def test_a_step_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    data = encode_png(np.ones((2, 2), np.uint16), 0.1)
    (tmp_path / "a.png").write_bytes(data.replace(b"\x000.1", b"\x00" + text.ljust(3).encode()))
    with pytest.raises(DatasetError, match="is no step from"):
        stated_unit_mm(tmp_path / "a.png")


def test_the_step_of_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("plain.png"), 1.0)
    expected = {
        ("plain.png", "a.png"): 1.0,
        ("plain.png", "b.png", "--out-unit-mm", "0.1"): 0.1,
        ("a.png", "c.png"): 0.1,  # it states its step
        ("a.png", "d.png", "--out-unit-mm", "0.5"): 0.5,
        ("b.png", "e.png"): 0.1,
    }
    for (source, target, *options), step in expected.items():
        assert denoise(source, "-o", target, *options) == 0
        assert f"in steps of {step:g} mm" in capsys.readouterr().err
        assert stated_unit_mm(Path(target)) == step
    assert len(np.unique(read_depth_png(Path("b.png")))) > 2 * len(
        np.unique(read_depth_png(Path("a.png")))
    )
    np.testing.assert_allclose(read_map_mm(Path("b.png"), 0.1), read_map_mm(Path("d.png"), 0.5),
                               atol=1.0)  # fmt: skip


def test_depth_beyond_the_step_is_refused_or_keeps_the_step_of_the_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("far.png"), 1.0, stated=True, depth_mm=DEPTH_MM + 6000)
    assert denoise("far.png", "-o", "a.png") == 0
    assert stated_unit_mm(Path("a.png")) == 1.0
    capsys.readouterr()
    assert denoise("far.png", "-o", "b.png", "--out-unit-mm", "0.1") == 2
    message = capsys.readouterr().err
    assert "far.png: a depth of" in message
    assert "choose a larger --out-unit-mm" in message
    assert not Path("b.png").exists()


def test_maps_of_a_data_set_are_written_in_steps_of_a_tenth(tmp_path: Path) -> None:
    make(tmp_path / "data", make_settings(), make_tasks(2, 2))
    assert denoise(str(tmp_path / "data"), "-o", str(tmp_path / "out")) == 0
    written = sorted((tmp_path / "out").rglob("*.png"))
    assert len(written) == 4
    assert {stated_unit_mm(path) for path in written} == {0.1}


def test_formats_of_floats_are_metres(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in").mkdir()
    for name in ("x.png", "y.png"):
        write(Path("in") / name, 1.0)
    for form, suffix in (("npy", ".npy"), ("tiff-float", ".tiff"), ("exr", ".exr")):
        if form == "exr":
            pytest.importorskip("OpenEXR")
        assert denoise("in", "-o", form, "--format", form) == 0
        assert "float32 metres" in capsys.readouterr().err
        assert sorted(path.name for path in Path(form).iterdir()) == [f"x{suffix}", f"y{suffix}"]
        first = read_map_mm(Path(form) / f"x{suffix}", 1.0)
        assert len(np.unique(first)) > 1000  # unrounded
        np.testing.assert_allclose(first, read_map_mm(Path("npy/x.npy"), 1.0), atol=1e-3)
    for arguments, words in (
        (("in", "-o", "o", "--format", "jpg"), "--format jpg"),
        (("in/x.png", "-o", "x.png", "--format", "npy"), "ends in .npy"),
        (("in/x.png", "-o", "x.npy", "--out-unit-mm", "0.1"), "floats are metres"),
        (("--watch", "in", "-o", "o", "--format", "npy"), "writes PNG"),
    ):
        assert denoise(*arguments) == 2
        assert words in capsys.readouterr().err
