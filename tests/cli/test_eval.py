"""``glsim denoise`` and ``glsim eval`` as a user meets them."""

import csv
import importlib.util
import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import pip_install
from glsim.networks.composites import COMPOSITES
from tests.support import checkpoint_stand_in
from tests.support.checkpoint_stand_in import write_run
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.eval_scenes import dome, noisy, write_pairs


@pytest.fixture
def maps(here: Path) -> Path:
    folder = here / "maps" / "a"
    folder.mkdir(parents=True)
    for number in range(3):
        write(folder / f"m{number}_noisy.png", noisy(dome(), number))
    return here / "maps"


def write(path: Path, depth: np.ndarray) -> None:  # type: ignore[type-arg]
    cv2.imwrite(str(path), depth.astype(np.uint16))


def read(path: Path) -> np.ndarray:  # type: ignore[type-arg]
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image.dtype == np.uint16
    return np.asarray(image)


def test_denoise_a_file_a_folder_and_a_pattern(maps: Path, tmp_path: Path) -> None:
    source = maps / "a" / "m0_noisy.png"
    assert main(["denoise", str(source), "-o", "one.png", "-d", "quadric", "-q"]) == 0
    before, after = read(source), read(tmp_path / "one.png")
    np.testing.assert_array_equal(after > 0, before > 0)
    assert (before != after).any()
    assert main(["denoise", str(maps), "-o", "all", "-d", "quadric", "-q"]) == 0
    np.testing.assert_array_equal(read(tmp_path / "all" / "a" / "m0_noisy.png"), after)
    assert main(["denoise", "maps/*/*_noisy.png", "-o", "some", "-d", "quadric", "-q"]) == 0
    assert len(list((tmp_path / "some").iterdir())) == 3


def test_denoise_knows_sequences_and_units(maps: Path, tmp_path: Path) -> None:
    whole = ["-q", "--out-unit-mm", "1"]
    assert main(["denoise", str(maps), "-o", "t", "-d", "temporal_median", *whole]) == 0
    stack = np.stack([read(file) for file in sorted((maps / "a").iterdir())])
    middle = read(tmp_path / "t" / "a" / "m1_noisy.png")
    pixel = (20, 24)
    found = stack[:, *pixel][stack[:, *pixel] > 0]
    assert middle[pixel] == np.rint(np.median(found))


def test_denoise_takes_the_step_of_the_data_set(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fine = (dome(whole=False) * 10).astype(np.uint16)
    for name, unit in (("d", 0.1), ("e", 1.0)):
        make(here / name, make_settings(depth_unit_mm=unit), make_tasks(4, 1))
        write(here / name / "test" / "s001" / f"{name}.png", fine)
    assert main(["denoise", "e", "-d", "quadric", "-o", "whole"]) == 0
    assert "wrote 4 denoised depth maps to whole, in steps of 0.1 mm" in capsys.readouterr().err
    command = ["denoise", "d/test/s001/d.png", "-d", "quadric", "-q", "-o"]
    assert main([*command, "known.png"]) == 0
    write(here / "alone.png", fine)
    alone = ["denoise", "alone.png", "-d", "quadric", "-q", "-o", "told.png"]
    assert main([*alone, "--depth-unit-mm", "0.1"]) == 0
    np.testing.assert_array_equal(read(here / "known.png"), read(here / "told.png"))
    assert main([*command, "x.png", "--depth-unit-mm", "1"]) == 2
    assert "steps of 0.1 mm" in capsys.readouterr().err
    pair = ["d/test/s001/d.png", "e/test/s001/e.png"]
    assert main(["denoise", *pair, "-d", "quadric", "-q", "-o", "x"]) == 2
    assert "different steps" in capsys.readouterr().err
    for text in ("somebody's", '{"format": "of another program"}'):
        (here / "d" / "dataset.json").write_text(text)
        assert main([*command, "y.png", "--depth-unit-mm", "0.1"]) == 0


def test_denoise_believes_only_the_data_set_of_the_file(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """NaN in a dataset.json of any folder above wrote an empty map with exit status 0."""
    make(here, make_settings(depth_unit_mm=0.1), make_tasks(4, 1))
    mine = here / "mine" / "deep" / "map.png"
    mine.parent.mkdir(parents=True)
    write(mine, dome(whole=False).astype(np.uint16))
    assert main(["denoise", str(mine), "-d", "noisy", "-q", "-o", "out.png"]) == 0
    np.testing.assert_array_equal(read(here / "out.png"), 10 * read(mine))  # of 0.1 mm
    header = (here / "dataset.json").read_text()
    own = next((here / "test" / "s001").glob("*noisy.png"))
    for unit in ("NaN", "0", "-1", "1e300"):
        changed = header.replace('"depth_unit_mm": 0.1', f'"depth_unit_mm": {unit}')
        (here / "dataset.json").write_text(changed)
        assert main(["denoise", str(own), "-d", "noisy", "-q", "-o", "other.png"]) == 1
        assert "dataset.json: is damaged: depth_unit_mm" in capsys.readouterr().err
    assert not (here / "other.png").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["denoise", "none.png", "-o", "o.png", "-d", "median"], "no such file"),
        (["denoise", "maps", "-o", "maps", "-d", "median"], "would overwrite"),
        (["denoise", "maps", "-o", "o", "-d", "medan"], "did you mean 'median'"),
        (["denoise", "maps", "-o", "o", "-d", "median", "--composite", "x"], "composite x"),
        (["eval", "none"], "no such folder"),
        (["eval"], "Missing argument"),
        (["paper", "tables", "maps", "--table", "4"], "--table 4"),
        (["paper", "tables", "maps", "--table", "2"], "give --runs"),
        (["paper", "tables", "maps", "--table", "3", "--runs", "nowhere"], "no such folder"),
        (["paper", "tables", "maps", "--table", "3", "--runs", "maps"], "no */best.pt"),
        (["eval", "maps", "--workers", "0"], "--workers 0"),
    ],
)
def test_wrong_usage(
    maps: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert main(arguments) in (1, 2)
    assert words in capsys.readouterr().err.replace("\n", "")


def test_checkpoints_need_the_training_part(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", None)
    (here / "best.pt").write_bytes(b"")
    write(here / "a.png", dome())
    assert main(["denoise", "a.png", "-o", "b.png", "-d", "best.pt"]) == 1
    assert pip_install("train") in capsys.readouterr().err


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the stand-in of a network that knows its uncertainty."""
    package = tmp_path / "shipped_stand_in"
    write_run(package, 0.2, row=None, sigma_mm=1.234)
    (package / "best.pt").rename(package / "face.onnx")
    monkeypatch.setattr("glsim.denoise.registry.load_onnx", checkpoint_stand_in.load_network)
    monkeypatch.setattr("glsim.denoise.registry._SHIPPED_FOLDER", package)
    return package / "face.onnx"


def test_without_a_denoiser_the_shipped_network_is_taken(
    maps: Path, tmp_path: Path, shipped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = maps / "a" / "m0_noisy.png"
    assert main(["denoise", str(source), "-o", "one.png", "-q"]) == 0
    seen = read(source).astype(np.float32)
    wanted = np.rint(10 * np.where(seen > 0, seen + 0.2 * (900 - seen), 0))  # steps of 0.1 mm
    np.testing.assert_array_equal(read(tmp_path / "one.png"), wanted)
    command = ["denoise", str(source), "-o", "two.png", "-d", "face", "-q"]
    assert main(command) == 0
    assert (tmp_path / "two.png").read_bytes() == (tmp_path / "one.png").read_bytes()
    pairs = write_pairs(tmp_path / "pairs", 1, 1)
    scoring = ["eval", str(pairs), "-d", "face", "-o", "s", "--workers", "1", "--no-figures", "-q"]
    assert main(scoring) == 0
    assert "`face`" in (tmp_path / "s" / "table.md").read_text()

    for asked, kept in (("face:min_probability=0.6", True), ("face:min_probability=0.95", False)):
        assert main([*command[:-2], asked, "-q"]) == 0
        assert read(tmp_path / "two.png").any() == kept
        assert main([*command[:-2], asked.replace("face", str(shipped)), "-q"]) == 0
        assert read(tmp_path / "two.png").any() == kept
    assert main([*command[:-2], "face:size=3"]) == 2
    assert "no such parameter 'size'" in capsys.readouterr().err


def test_uncertainty_is_a_map_beside_the_depth(
    maps: Path, tmp_path: Path, shipped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = maps / "a" / "m0_noisy.png"
    command = ["denoise", str(source), "-o", "depth.png", "-q", "--uncertainty"]
    assert main([*command, "sigma.png"]) == 0
    depth, sigma = read(tmp_path / "depth.png"), read(tmp_path / "sigma.png")
    np.testing.assert_array_equal(sigma, np.where(depth > 0, 123, 0))  # 1.234 mm, in 0.01 mm
    assert main(["denoise", str(maps), "-o", "d", "--uncertainty", "s"]) == 0
    assert "uncertainties in steps of 0.01 mm to s" in " ".join(capsys.readouterr().err.split())
    assert len(list((tmp_path / "s" / "a").iterdir())) == 3

    assert main([*command, "depth.png"]) == 2
    assert "is the output of the depth" in capsys.readouterr().err
    assert main([*command, "sigma.png", "-d", "quadric"]) == 2
    assert "quadric does not estimate its uncertainty" in capsys.readouterr().err


def test_a_sigma_that_is_none_is_refused(maps: Path, shipped: Path) -> None:
    text = shipped.read_text()
    shipped.write_text(text.replace("1.234", "-1"))
    command = ["denoise", str(maps / "a" / "m0_noisy.png"), "-o", "depth.png", "-q"]
    assert main([*command, "--uncertainty", "sigma.png"]) == 1


def test_scores_without_matplotlib_are_tables_and_say_so_first(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They failed after the scoring, with status 1."""
    write_pairs(here / "pairs", 4)
    found = importlib.util.find_spec
    monkeypatch.setattr(
        "glsim.cli.eval.find_spec", lambda name: None if name == "matplotlib" else found(name)
    )
    command = ["eval", "pairs", "-d", "median", "-o", "s", "--workers", "1"]
    assert main(command) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("no figures and no report.html, tables alone: they need Matplotlib:")
    assert pip_install("eval") in lines[0]
    assert "few people for an interval: 5 are needed" in (here / "s" / "table.md").read_text()
    assert not (here / "s" / "report.html").exists()
    assert main([*command, "--no-figures"]) == 0
    assert "no figures" not in capsys.readouterr().err
    (here / "s" / "tuning.csv").write_text("of the table before")
    assert main(["eval", "pairs", "-d", "nlm", "-o", "s", "--no-figures"]) == 0
    assert not (here / "s" / "tuning.csv").exists()
    assert "s/table.md: replaced one with median: next time give -o NEW" in capsys.readouterr().err


@pytest.mark.long
def test_tables_have_the_input_first_and_one_row_per_network(here: Path) -> None:
    write_pairs(here / "pairs", 2)
    (here / "soft_net.py").write_text("def net(noisy, valid): return noisy, valid * 0.8\n")
    command = ["eval", "pairs", "-d", "net@soft_net:net", "--workers", "1"]

    def methods() -> tuple[list[str], list[str]]:
        assert main([*command, "-o", "s", "--no-figures", "-q"]) == 0
        first_table = (here / "s" / "table.md").read_text().split("### ")[1]
        with (here / "s" / "table.csv").open(newline="") as file:
            in_csv = list(dict.fromkeys(row["method"] for row in csv.DictReader(file)))
        return re.findall(r"(?m)^\| `([^`]+)`", first_table), in_csv

    every = [f"net [{composite}]" for composite in COMPOSITES]
    assert methods() == (["noisy", "net [measured]"], ["noisy", *every])
    assert main([*command, "-o", "f", "-q"]) == 0
    report = (here / "f" / "report.html").read_text()
    assert "<b>[measured]</b> behind a network: depth where the input has depth" in report
    assert "net [hard]" not in report
