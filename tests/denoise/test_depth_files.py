"""The depth files of ``glsim denoise``: their steps, formats and the names of outputs."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.core.files.png import encode_png, read_image, stated_unit_mm
from glsim.data.map_writer import MapWriter
from glsim.data.maps import open_maps
from glsim.data.recordings.files import read_map_mm

DEPTH_MM = 900 + np.random.default_rng(0).normal(0, 2, (40, 48)).astype(np.float32)


def write(path: Path, unit: float, stated: bool = False, depth_mm: object = DEPTH_MM) -> Path:
    units = np.rint(np.asarray(depth_mm) / unit).astype(np.uint16)
    path.write_bytes(encode_png(units, unit if stated else None))
    return path


def denoise(*arguments: str) -> int:
    return main(["denoise", *arguments, "-d", "masked_gaussian"])


def test_a_png_states_its_step_and_is_a_plain_png_to_others(tmp_path: Path) -> None:
    plain, stated = write(tmp_path / "a.png", 0.1), write(tmp_path / "b.png", 0.1, stated=True)
    assert (stated_unit_mm(plain), stated_unit_mm(stated)) == (None, 0.1)
    np.testing.assert_array_equal(read_image(plain), read_image(stated))
    assert open_maps([stated]).step_mm == open_maps([stated], unit_mm=0.1).step_mm == 0.1
    assert open_maps([plain]).step_mm == 1.0
    assert "taken for mm, which puts the middle at 9" in open_maps([plain]).notes[0]
    marked = np.where(DEPTH_MM > 0, 65535, 0).astype(np.uint16)  # the largest integer: no depth
    marked[:2] = 600
    cv2.imwrite(str(tmp_path / "marked.png"), marked)
    assert "puts the middle at 0.6 m" in open_maps([tmp_path / "marked.png"]).notes[0]
    for given, words in ((1.0, r"b\.png states steps of 0\.1 mm"), (None, "some state none")):
        with pytest.raises(ConfigError, match=words):
            open_maps([stated] if given else [plain, stated], unit_mm=given)
    plain = plain.rename(tmp_path / "a_rgb.png")
    assert "as named: 1 *_rgb.png" in open_maps(plain).notes[0]
    plain.write_bytes(encode_png(np.full((8, 8), 900, np.uint16), layer="clean"))
    assert "states the layer clean, taken for noisy" in open_maps(plain).notes
    with pytest.raises(ConfigError, match=r"named as infrared, not depth: 1 \*_ir\.png"):
        open_maps(plain.rename(tmp_path / "a_ir.png"))
    np.testing.assert_allclose(read_map_mm(stated, 0.1), DEPTH_MM, atol=0.051)


def test_the_step_of_the_output(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(Path("plain.png"), 1.0)
    expected = {
        ("plain.png", "b.png"): 0.1,
        ("plain.png", "a.png", "--out-unit-mm", "1"): 1.0,
        ("plain.png", "e.tiff"): 1.0,  # a TIFF states no step
        ("a.png", "c.png"): 0.1,
        ("a.png", "d.png", "--out-unit-mm", "0.5"): 0.5,
    }
    for (source, target, *options), step in expected.items():
        assert denoise(source, "-o", target, *options) == 0
        assert f"in steps of {step:g} mm" in capsys.readouterr().err
        assert stated_unit_mm(Path(target)) == (step if target.endswith("png") else None)
    fine, coarse = (len(np.unique(read_image(Path(name)))) for name in ("b.png", "a.png"))
    assert fine > 2 * coarse


def test_depth_beyond_the_step_is_refused_or_keeps_the_step_of_the_input(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for depth_mm, unit_mm, step_mm in ((13_400, 1.0, 1.0), (6540, 0.1, 0.2), (6900, 1.0, 0.2)):
        write(Path("far.png"), unit_mm, stated=True, depth_mm=DEPTH_MM - 900 + depth_mm)
        assert denoise("far.png", "-o", "a.png") == 0
        assert stated_unit_mm(Path("a.png")) == step_mm
        assert f"a.png, in steps of {step_mm:g} mm" in capsys.readouterr().err
    assert denoise("far.png", "-o", "b.png", "--out-unit-mm", "0.1") == 2
    assert "far.png: a depth of" in capsys.readouterr().err
    assert not Path("b.png").exists()
    moved = open_maps(write(Path("c.png"), 0.1, stated=True, depth_mm=DEPTH_MM + 5640))
    moved_frames = moved.frames.changed(lambda f: f.changed({"noisy_mm": f.noisy_mm + 10}))
    writer = MapWriter(moved, ["c.png"], Path("c.tiff"))  # a TIFF states no step
    writer.write(moved_frames, skipped=print)
    lost = (moved_frames[0].noisy_mm > 6553.5) & (moved.frames[0].noisy_mm > 0)
    assert 0 < lost.sum() == (read_image(Path("c.tiff")) == 0).sum() < lost.size / 2
    assert f"in steps of 0.1 mm without {lost.sum()} px beyond" in writer.sentence("denoised")


@pytest.mark.parametrize("denoiser", ["masked_gaussian", "temporal_median"])
def test_each_file_is_decoded_once_but_for_those_that_vote(
    here: Path, monkeypatch: pytest.MonkeyPatch, denoiser: str
) -> None:
    Path("in").mkdir()
    for number in range(20):
        write(Path(f"in/{number}.png"), 1.0)
    decoded: list[Path] = []

    def record(path: Path, **options: object) -> object:
        decoded.append(path)
        return read_image(path, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("glsim.data.map_files.read_image", record)
    assert main(["denoise", "in", "-o", "out", "-d", denoiser, "-q"]) == 0
    assert len(decoded) == 20 + 16


def test_a_deep_map_that_does_not_vote_keeps_its_depth(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """16 of the 40 maps decide on steps of 0.1 mm; the second has a wall at 7 m."""
    Path("in").mkdir()
    for number in range(40):
        write(Path(f"in/{number}.png"), 1.0, depth_mm=DEPTH_MM + 6000 * (number == 1))
    assert 0.0 < open_maps("in").votes.deepest_mm < 6500
    assert denoise("in", "-o", "out", "-q") == 0
    assert [stated_unit_mm(Path(f"out/{number}.png")) for number in range(3)] == [0.1, 0.2, 0.1]
    again = open_maps("out")  # each file says how deep it is
    assert [frame.step_mm for frame in again.frames][:3] == [0.1, 0.2, 0.1]
    np.testing.assert_allclose(np.median(again.frames[1].noisy_mm), 6900, atol=5)
    cv2.imwrite("in/2.png", np.zeros((40, 48), np.uint16))
    assert denoise("in", "-o", "out") == 0
    said = "out, in steps of 0.1 mm; out/1.png in steps of 0.2 mm; out/2.png without depth"
    said += "; 40 files of the same name replaced\n"
    assert said in capsys.readouterr().err
    Path("mine.py").write_text("def nan(depth, valid):\n    return depth * float('nan'), valid\n")
    assert main(["denoise", "in", "-o", "bad", "-d", "mine.py:nan"]) == 1
    refused = "mine.py:nan: returned 1920 depths that are negative or no number for in/0.png\n"
    assert capsys.readouterr().err.endswith(refused)


def test_formats_of_floats_are_metres(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("in").mkdir()
    write(Path("in/x.png"), 1.0)
    assert denoise("in", "-o", "o", "--format", "npy") == 0
    assert "in float32 metres" in capsys.readouterr().err
    depth_m = np.load("o/x.npy")
    assert depth_m.dtype == np.float32
    assert np.median(depth_m) == pytest.approx(0.9, abs=0.01)
    for arguments, words in (
        (("in/x.png", "-o", "x.png", "--format", "npy"), "ends in .npy"),
        (("in/x.png", "-o", "x.npy", "--out-unit-mm", "0.1"), "floats are metres"),
    ):
        assert denoise(*arguments) == 2
        assert words in capsys.readouterr().err


def test_maps_of_the_same_name_keep_their_folders(here: Path) -> None:
    for name in ("day/a/x.png", "day/b/x.png", "day/b/c/y.png"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(name, np.full((4, 4), 900, np.uint16))
    out = Path("out")

    def targets(inputs: list[str]) -> dict[str, Path]:
        maps = open_maps(inputs)
        written = MapWriter(maps, inputs, out).targets
        return {str(source): target for source, target in zip(maps.sources, written, strict=True)}

    apart = {"day/a/x.png": out / "x.png", "day/b/c/y.png": out / "y.png"}
    assert targets(["day/a", "day/b/c"]) == apart
    for inputs in (["day/a", "day/b"], ["day/*/x.png", "day/b/c/y.png"]):
        assert targets(inputs) == {
            "day/a/x.png": out / "a/x.png",
            "day/b/x.png": out / "b/x.png",
            "day/b/c/y.png": out / "b/c/y.png",
        }
    with pytest.raises(ConfigError, match=r"day/a/x.png: is given twice"):
        targets(["day/a", "day/a/x.png"])
