"""The paper's tables: found checkpoints, their rows and notes, and missing or refused ones."""

import csv
import statistics
import sys
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.networks.composites import COMPOSITES
from tests.support import checkpoint_stand_in
from tests.support.checkpoint_stand_in import write_run
from tests.support.eval_scenes import rows, write_pairs


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    for seed in range(3):
        write_run(folder / f"d7-{seed}", 0.1 + 0.02 * seed, row="D7", title="DnCNN D7", seed=seed)
        write_run(folder / f"ar-{seed}", 0.11 + 0.02 * seed, row="AR D7", seed=seed)
    write_run(folder / "d64", 0.1, row="D64", blind=True)
    write_run(folder / "unet", 0.2, row="UNet", size="full", state="interrupted", ended="steps")
    write_run(folder / "face", 0.3, row=None, title="ours", size="own", soft=True)
    return folder


def command(pairs: Path, out: Path, *more: str) -> list[str]:
    head = ("paper", "tables") if "--table" in more else ("eval",)
    return [*head, str(pairs), "-o", str(out), "--workers", "1", "-q", "--no-figures", *more]


def row_of(text: str, *cells: str) -> list[str]:
    """The first line of a table that begins with these cells."""
    start = f"| {' | '.join(cells)}"
    line = next(line for line in text.splitlines() if line.startswith(start))
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_all_tables_from_one_scoring(runs: Path, tmp_path: Path) -> None:
    pairs, out = write_pairs(tmp_path / "pairs"), tmp_path / "o"
    tables = ["--table", "1", "--table", "2", "--table", "3", "--table", "4", "--runs", str(runs)]
    assert main(command(pairs, out, *tables, "-d", "masked_gaussian")) == 0
    assert "runs/face [soft]" in (out / "table.csv").read_text(), "apart from the shipped face"
    one, two, three = ((out / f"paper_table_{n}.md").read_text() for n in (1, 2, 3))
    means = {
        label: statistics.fmean(
            float(row["mse_mm2"]) for row in rows(out) if row["method"] == label
        )
        for label in ("d7-0", "d7-1", "d7-2", "noisy", "median")
    }
    seeds = [means[f"d7-{seed}"] for seed in range(3)]
    line = row_of(two, "D7", "DnCNN D7, small, seeds: 3, 10 steps, 1.5 min each")
    assert line[2] == "36238"
    mean, spread = (float(part) for part in line[3].split(" ± "))
    assert mean == pytest.approx(statistics.fmean(seeds), rel=1e-3)
    assert spread == pytest.approx(statistics.stdev(seeds), rel=2e-2, abs=0.01)
    assert line[8] == "25.686"
    assert float(line[9]) == pytest.approx(statistics.fmean(seeds) / means["noisy"], abs=6e-4)

    assert row_of(two, "UNet", "UNet, full")
    assert "UNet, full: interrupted, scored as far as it came: unet" in two
    assert row_of(two, "Restormer")[1:4] == ["**missing**", "80018", "-"]
    assert "DnCNN D7, small: narrower" in two
    assert "AR D7" not in two
    assert "Restormer" not in three
    assert row_of(three, "AR D64")[3] == row_of(three, "D64")[3], "the same network"
    hidden = three[three.index("## What all-pixel metrics hide") :]
    assert row_of(hidden, "D64")[2] == "n/a", "it finds no depth"
    for part in COMPOSITES:
        assert row_of(three, "-", f"ours [{part}], own")
    assert row_of(two, "-", "`masked_gaussian`")
    assert row_of(one, "Adaptive", "filter")[3] == row_of(one, "Baseline", "filter")[3]
    assert float(row_of(one, "Median", "filter")[3]) == pytest.approx(means["median"], rel=1e-3)
    assert "DnCNN" not in one
    four = (out / "paper_table_4.md").read_text()
    assert row_of(four, "-", "ours [hard], own")
    assert "DnCNN" not in four
    assert r"& 36238 & " in (out / "paper_table_2.tex").read_text()
    with (out / "baselines.csv").open() as file:
        trivial = {row["method"]: row for row in csv.DictReader(file) if row["metric"] == "mse_mm2"}
    for name in ("zero image", "mean face"):  # rows of their own, with nothing printed beside them
        cells = row_of(three, f"**{name}**", "a scale")
        assert cells[2] == "-"
        assert float(cells[3]) == pytest.approx(float(trivial[name]["mean"]), rel=1e-3)


def test_what_is_no_run_is_named_and_left_out(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pairs, out = write_pairs(tmp_path / "pairs", 2, 1), tmp_path / "o"
    truncated = runs / "d7-0" / "best.pt"
    truncated.write_bytes(truncated.read_bytes()[:5])
    (runs / "ar-0" / "recipe.json").write_text('{"title": 1}')
    (runs / "foreign").mkdir()
    (runs / "foreign" / "best.pt").write_bytes(b"")
    write_run(runs / "again", 0.5, row="AR D7", seed=1)
    assert main(command(pairs, out, "--table", "3", "--runs", str(runs))) == 1
    assert "4 of the checkpoints" in capsys.readouterr().err
    text = (out / "paper_table_3.md").read_text()
    for words in ("d7-0/best.pt: is no checkpoint", "ar-0: recipe.json or run.json is of no run"):
        assert words in text
    assert "foreign/recipe.json: cannot be read" in text
    assert "ar-1/best.pt: is the same recipe and seed as" in text
    assert "seeds: 2," in row_of(text, "D7", "DnCNN D7")[1]
