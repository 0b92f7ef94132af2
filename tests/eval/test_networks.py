"""Tables 2 and 3: found checkpoints, their rows and notes, and missing or refused ones."""

from __future__ import annotations

import csv
import math
import re
import statistics
import sys
from pathlib import Path

import cv2
import pytest

from glsim.cli import main
from glsim.denoise import COMPOSITES
from glsim.eval.metrics.prediction import psnr_db
from glsim.eval.paper.network_tables import PAPER_ROWS, network_table
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS
from glsim.eval.paper.runs import find_trained_runs, group_by_network
from glsim.eval.report.html_report import write_report
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.run import evaluate
from glsim.eval.scoring.statistics import student_t_test
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
    write_run(folder / "d20", 0.1, row="D20")
    write_run(folder / "ar-d20", 0.9, row="AR D20")
    write_run(folder / "d64", 0.1, row="D64")
    write_run(folder / "d64-1", 0.2, row="D64", seed=1)
    write_run(folder / "ar-d64", 0.1, row="AR D64")
    write_run(folder / "unet", 0.2, row="UNet", size="full", state="interrupted")
    write_run(folder / "ours", 0.3, row=None, title="ours", size="own", soft=True)
    return folder


def command(pairs: Path, out: Path, *more: str) -> list[str]:
    head = ("paper", "tables") if "--table" in more else ("eval",)
    return [*head, str(pairs), "-o", str(out), "--workers", "1", "-q", *more]


def row_of(text: str, *cells: str) -> list[str]:
    """The first line of a table that begins with these cells."""
    start = f"| {' | '.join(cells)} |"
    line = next(line for line in text.splitlines() if line.startswith(start))
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_printed_values_agree_with_each_other() -> None:
    """A mean of PSNRs is above the PSNR of the mean, here by 1.3 dB at most: typing errors show."""
    for row in (*PRINTED_FILTERS.values(), *PRINTED_NETWORKS.values()):
        assert 0 < row.psnr_db - psnr_db(row.mse_mm2) < 1.3, row.title
        assert 0.77 <= row.ssim <= 0.9986
    assert PRINTED_FILTERS["nlm"].mse_mm2 / PRINTED_FILTERS["noisy"].mse_mm2 == pytest.approx(
        0.813, abs=5e-4
    )
    assert set(PRINTED_NETWORKS) == {row for rows in PAPER_ROWS.values() for row in rows}


def test_both_tables_from_one_scoring(runs: Path, tmp_path: Path) -> None:
    pairs, out = write_pairs(tmp_path / "pairs"), tmp_path / "o"
    tables = ("--table", "2", "--table", "3", "--runs", str(runs))
    assert main(command(pairs, out, *tables, "-d", "masked_gaussian", "--no-figures")) == 0
    two, three = ((out / f"paper_table_{n}.md").read_text() for n in (2, 3))

    mse = {}
    for label in ("d7-0", "d7-1", "d7-2", "noisy", "ours [hard]"):
        found = [float(row["mse_mm2"]) for row in rows(out) if row["method"] == label]
        mse[label] = statistics.fmean(found)
    seeds = [mse[f"d7-{seed}"] for seed in range(3)]
    line = row_of(two, "D7", "DnCNN D7")
    assert line[2:5] == ["small; **not run at full size**", "3", "1.5"]
    assert float(line[5]) == pytest.approx(36_238, abs=1)
    mean, spread = (float(part) for part in line[6].split(" ± "))
    assert mean == pytest.approx(statistics.fmean(seeds), rel=1e-3)
    assert spread == pytest.approx(statistics.stdev(seeds), rel=2e-2, abs=0.01)

    assert row_of(two, "UNet", "UNet")[2] == "full"
    assert "UNet: training was interrupted, scored as far as it came: unet" in two
    assert row_of(two, "Restormer")[1] == "**missing**"
    assert "Restormer: missing" in two
    assert "AR D7" not in two
    assert "DnCNN D7, small: narrower" in two
    assert "Restormer" not in three
    for part in COMPOSITES:
        assert row_of(three, "-", f"ours [{part}]")[2] == "own"
    assert float(row_of(two, "Baseline", "filter")[5]) == round(PRINTED_FILTERS["noisy"][1])
    trivial = {
        line["method"]: float(line["mean"])
        for line in csv.DictReader((out / "baselines.csv").read_text().splitlines())
        if line["metric"] == "mse_mm2"
    }
    for name in ("zero image", "mean face"):  # rows of their own, with nothing printed beside them
        zeros = row_of(two, f"**{name}**", "no method may lose to it")
        assert zeros[5::2] == ["-", "-", "-", zeros[11]]
        assert float(zeros[6]) == pytest.approx(trivial[name], rel=1e-3)
    cleans = [cv2.imread(str(p), -1).astype(float) for p in sorted(pairs.rglob("*_clean.png"))]
    mean_square = statistics.fmean(float((clean**2).mean()) for clean in cleans)
    assert trivial["zero image"] == pytest.approx(mean_square)

    assert row_of(two, "`masked_gaussian`", "filter")
    best = row_of(two, "ours [hard]", "interior RMSE [mm]")
    means = {
        name: statistics.fmean(
            float(row["both_interior_rmse_mm"]) for row in rows(out) if row["method"] == name
        )
        for name in ("masked_gaussian", "ours [hard]")
    }
    assert best[3] == "`masked_gaussian`"
    assert float(best[4]) == pytest.approx(means["masked_gaussian"], abs=0.006)
    assert float(best[5]) == pytest.approx(
        means["ours [hard]"] / means["masked_gaussian"], abs=0.006
    )

    same = row_of(three, "D7", "small")
    assert same[-1] == "yes"
    assert float(same[3]) == pytest.approx(
        statistics.fmean(mse_of(out, "ar-", range(3))) - statistics.fmean(seeds), abs=0.06
    )
    relations = three[three.index("## Relations") :]
    assert row_of(relations, "D20", "small")[-1] == "one seed: unknown"
    equal = row_of(relations, "D64", "small")
    assert [*equal[3:5], equal[-1]] == ["+0.0", "1", "equal, seed by seed"]
    ratio = row_of(two[two.index("## Relations") :], "DnCNN D7", "small")
    assert float(ratio[3]) == pytest.approx(statistics.fmean(seeds) / mse["noisy"], abs=0.006)


def mse_of(out: Path, prefix: str, seeds: range) -> list[float]:
    labels = [f"{prefix}{seed}" for seed in seeds]
    every = rows(out)
    return [
        statistics.fmean(float(r["mse_mm2"]) for r in every if r["method"] == label)
        for label in labels
    ]


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
    tables = ("--table", "3", "--runs", str(runs), "--no-figures")
    assert main(command(pairs, out, *tables)) == 1
    assert "4 of the checkpoints" in capsys.readouterr().err
    text = (out / "paper_table_3.md").read_text()
    for words in ("d7-0/best.pt: is no checkpoint", "ar-0: recipe.json or run.json is of no run"):
        assert words in text
    assert "foreign/recipe.json: cannot be read" in text
    assert "ar-1/best.pt: is the same recipe and seed as" in text
    assert row_of(text, "D7", "DnCNN D7")[3] == "2"


def test_a_seed_that_finds_no_depth_has_no_spread(runs: Path, tmp_path: Path) -> None:
    for seed in (1, 2):
        write_run(runs / f"d20-{seed}", 0.1, row="D20", seed=seed, blind=True)
    pairs, out = write_pairs(tmp_path / "pairs", 2, 1), tmp_path / "o"
    tables = ("--table", "2", "--runs", str(runs), "--no-figures")
    assert main(command(pairs, out, *tables)) == 0
    text = (out / "paper_table_2.md").read_text()
    assert "±" in row_of(text, "D20", "D20")[6], "its mean squared error is known"
    hidden = text[text.index("## What all-pixel metrics hide") :]
    assert row_of(hidden, "D20", "small")[2] == "n/a"


def test_runs_alone_are_scored_beside_the_filters(runs: Path, tmp_path: Path) -> None:
    pairs, out = write_pairs(tmp_path / "pairs", 2, 1), tmp_path / "o"
    assert main(command(pairs, out, "--runs", str(runs), "--no-figures")) == 0
    assert {row["method"] for row in rows(out)} >= {"nlm", "d7-0", "unet", "ours [soft]"}
    assert not (out / "paper_table_2.md").exists()


@pytest.mark.long
def test_figures_are_of_the_methods_that_are_asked_for(runs: Path, tmp_path: Path) -> None:
    ours = f"ours@{runs / 'ours' / 'best.pt'}"
    job = ScoringJob(write_pairs(tmp_path / "pairs", 2, 2), "test", ("noisy", "median", ours))
    found = evaluate(job, tmp_path / "o", workers=1, baselines=False)
    summary = found.summary
    parts = [f"ours [{composite}]" for composite in COMPOSITES]
    some = summary.only(["noisy", "ours"])
    assert some.methods == list(some.sampled) == list(some.histograms) == ["noisy", *parts]
    assert some.mean("noisy", "mse_mm2") == summary.mean("noisy", "mse_mm2")
    assert summary.methods == ["noisy", "median", *parts]

    table = summary.compared()
    document = network_table(
        2, found, table, [one for one in find_trained_runs(runs)[0] if not one.row]
    )
    report = write_report(found, table, job, tmp_path, "x", [document], ["noisy"]).read_text()
    assert report.count("<h2>Table 2 of Kendrick") == 1
    assert "<td>ours [hard]</td>" in report
    assert "<b>missing</b>" in report
    assert not re.search(r"(src|href)=\"http", report)


def test_seeds_are_grouped_by_network(runs: Path) -> None:
    trained, refused = find_trained_runs(runs)
    assert not refused
    groups = {
        group.title: [one.seed for one in group.members] for group in group_by_network(trained)
    }
    assert groups["DnCNN D7"] == groups["AR D7"] == [0, 1, 2]
    assert len(groups) == 8


@pytest.mark.parametrize(
    ("values", "offset", "is_chance"),
    [
        ((0.0, 1.0, 2.0), 3.7, True),  # t = 4.53, and chance exceeds 4.604 in 1 % of cases
        ((0.0, 1.0, 2.0), 3.8, False),  # t = 4.65
        ((0.0, 1.0), 14.0, False),  # t = 19.8, chance 9.925
        ((0.0, 1.0), 7.0, True),  # t = 9.9
    ],
)
def test_student_t_has_the_critical_values_of_printed_tables(
    values: tuple[float, ...], offset: float, is_chance: bool
) -> None:
    t, p = student_t_test([value + offset for value in values], values)
    spread = math.sqrt(statistics.variance(values) * 2 / len(values))
    assert t == pytest.approx(offset / spread)
    assert (p > 0.01) is is_chance


def test_student_t_of_groups_without_variance() -> None:
    assert student_t_test([2.0, 2.0], [2.0, 2.0]) == (0.0, 1.0)
    assert student_t_test([3.0, 3.0], [2.0, 2.0]) == (math.inf, 0.0)
    assert all(math.isnan(value) for value in student_t_test([3.0], [2.0]))
