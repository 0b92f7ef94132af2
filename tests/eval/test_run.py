"""Scoring a set: bad input is named and counted, runs resume, tables agree."""

import csv
import math
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError, DatasetError
from glsim.denoise.registry import GRIDS
from glsim.eval.metrics.frame_score import score
from glsim.eval.metrics.scored_map import Truth
from glsim.eval.report.results import example_frame
from glsim.eval.report.score_tables import format_number, in_order, worse_inside
from glsim.eval.scoring.baselines import mean_face
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import Evaluation, evaluate
from glsim.eval.scoring.grid_search import tune_filters
from tests.support.eval_scenes import dome, rows, write_pairs


@pytest.fixture
def pairs(tmp_path: Path) -> Path:
    return write_pairs(tmp_path / "pairs")


def run(pairs: Path, out: Path, *specs: str, workers: int = 1, **more: Any) -> Evaluation:
    return evaluate(ScoringJob(pairs, "test", specs), out, workers=workers, **more)


def test_rows_are_the_metrics_of_each_frame(pairs: Path, tmp_path: Path) -> None:
    found = run(pairs, tmp_path / "o", "noisy", "masked_gaussian")
    table = rows(tmp_path / "o")
    assert found.frames == 12
    assert len(table) == 24
    first = table[0]
    assert (first["subject"], first["sequence"], first["frame"]) == ("p0", "s", "0")
    clean, seen = (image.astype(np.float32) for image in _pair(pairs, first))
    height, width = clean.shape
    x = (np.arange(width) + 0.5 - width / 2) / 365.456
    y = (np.arange(height) + 0.5 - height / 2) / 365.456
    rays = np.stack(np.meshgrid(x, y), -1).astype(np.float32)
    for name, value in score(seen, Truth(clean, seen, rays)).items():
        written = float(first[name])
        assert math.isclose(written, value, rel_tol=1e-5) or (
            math.isnan(written) and math.isnan(value)
        )
    mean = np.mean([float(row["mse_mm2"]) for row in table if row["method"] == "noisy"])
    assert found.summary.mean("noisy", "mse_mm2") == pytest.approx(mean, rel=1e-8)


def _pair(pairs: Path, row: dict[str, str]) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    stem = f"{row['subject']}/s_{int(row['frame']):03d}"
    first, second = (
        cv2.imread(str(pairs / f"{stem}_{layer}.png"), cv2.IMREAD_UNCHANGED)
        for layer in ("clean", "noisy")
    )
    return first, second


def test_workers_and_resuming_change_nothing(
    pairs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.eval.scoring.evaluate._BLOCK", 3)
    one, two = tmp_path / "one", tmp_path / "two"
    specs = ("noisy", "temporal_median", "quadric:cleanup=5")
    run(pairs, one, *specs)
    run(pairs, two, *specs, workers=2)

    def but_time(out: Path) -> list[dict[str, str]]:
        return [{k: v for k, v in row.items() if k != "time_ms"} for row in rows(out)]

    assert but_time(one) == but_time(two)
    blocks = sorted((one / ".blocks").rglob("*.json"))
    assert len(blocks) == 4
    before = rows(one)
    blocks[1].unlink()
    blocks[2].write_text("{damaged")
    stamp = blocks[0].stat().st_mtime_ns
    reports: list[int] = []
    evaluate(
        ScoringJob(pairs, "test", specs), one, workers=1, progress=lambda p: reports.append(p.done)
    )
    assert reports == [6, 9, 12]
    assert blocks[0].stat().st_mtime_ns == stamp
    assert but_time(one) == [{k: v for k, v in row.items() if k != "time_ms"} for row in before]


def test_bad_frames_are_named_counted_and_left_out(
    pairs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = dome().astype(np.uint16)
    cv2.imwrite(str(pairs / "p0/s_001_noisy.png"), good[:-2])
    cv2.imwrite(str(pairs / "p0/s_002_noisy.png"), (good // 8).astype(np.uint8))
    cv2.imwrite(str(pairs / "p1/s_000_clean.png"), (good / 1000).round().astype(np.uint16))
    (pairs / "p1/s_001_clean.png").unlink()
    (pairs / "p2/s_003_noisy.png").write_bytes((pairs / "p2/s_003_noisy.png").read_bytes()[:60])
    out = tmp_path / "o"
    command = ["eval", str(pairs), "-d", "noisy", "-d", "temporal_median", "-o", str(out)]
    command += ["--workers", "1", "--no-figures", "-q"]
    assert main(command) == 1
    error = capsys.readouterr().err
    assert "5 of 12 frames could not be scored" in error
    with (out / "bad.csv").open() as file:
        bad = {row["frame"]: row["why"] for row in csv.DictReader(file)}
    assert len(bad) == 5
    for frame, words in {
        "p0/s_00001": "48 x 38",
        "p0/s_00002": "uint8",
        "p1/s_00000": "metres instead of millimetres",
        "p1/s_00001": "is missing",
        "p2/s_00003": "no readable image",
    }.items():
        assert words in bad[frame]
    assert len(rows(out)) == 14
    assert "5 frames could not be scored" in (out / "table.md").read_text()
    write_pairs(pairs)
    assert main(command) == 0, "what was repaired is scored again"
    assert len(rows(out)) == 24
    assert not (out / "bad.csv").exists()


def test_a_denoiser_that_fails_costs_its_own_rows(pairs: Path, here: Path) -> None:
    (here / "moody.py").write_text(
        "import numpy as np\n"
        "def moody(noisy, valid):\n"
        "    if noisy[20, 8] > 0: raise ValueError('not today')\n"
        "    return noisy * np.nan if noisy[20, 9] > 0 else noisy, valid\n"
    )
    found = run(pairs, here / "o", "noisy", "moody:moody")
    assert 0 < found.bad < 12
    assert sum("ValueError: not today" in text for text in found.first_bad) == 1, "a line a cause"
    assert "moody:moody: moody:moody" not in "".join(found.first_bad)
    methods = [row["method"] for row in rows(here / "o")]
    assert methods.count("noisy") == 12
    assert methods.count("moody:moody") == 12 - found.bad
    (here / "idle.py").write_text("def idle(noisy, valid):\n    raise RuntimeError\n")
    example = example_frame(ScoringJob(pairs, "test", ("noisy", "idle:idle")))
    assert example[2].endswith("; idle:idle fails")
    assert [*example[1]] == ["noisy"]


def test_figures_begin_with_the_input_the_best_and_the_best_filter(pairs: Path) -> None:
    summary = run(pairs, pairs / "o", "nlm", "noisy", "median", "plane").summary
    means = {m: summary.mean(m, "input_interior_rmse_mm") for m in ("nlm", "median", "plane")}
    best, second, last = sorted(means, key=means.__getitem__)
    assert in_order(summary, ["noisy", last, second, best]) == ["noisy", best, last, second]
    tuned = in_order(summary, ["noisy", last, second, best], [best, last])
    assert tuned == ["noisy", best, second, last]


def test_what_cannot_be_scored_at_all(pairs: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="given twice"):
        run(pairs, tmp_path / "o", "noisy", "noisy")
    first, *others = sorted(pairs.rglob("*_noisy.png"))
    for file in others:
        file.unlink()
    first.rename(first.with_name("alone_noisy.png"))
    with pytest.raises(DatasetError, match=r"no frame could be scored: .* is missing"):
        run(pairs, tmp_path / "o", "noisy")
    first.with_name("alone_noisy.png").unlink()
    with pytest.raises(DatasetError, match="frames of a camera: glsim eval-real"):
        run(pairs, tmp_path / "o", "noisy")


def test_trivial_baselines_stand_beside_the_table(pairs: Path, tmp_path: Path) -> None:
    found = run(pairs, tmp_path / "o", "noisy")
    baselines = found.baselines
    assert baselines.methods[0] == "zero image"
    cleans = [
        cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.float64)
        for file in sorted(pairs.rglob("*_clean.png"))
    ]
    power = np.mean([np.mean(clean**2) for clean in cleans])
    assert baselines.mean("zero image", "mse_mm2") == pytest.approx(power)
    assert math.isnan(baselines.mean("zero image", "precision"))
    mean = mean_face(ScoringJob(pairs, "test", ()).frames())
    assert 880 < mean[mean > 0].mean() < 960


def test_tuning_uses_the_validation_split_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pairs = write_pairs(tmp_path / "set" / "val", 2, 2).parent
    write_pairs(pairs / "test", 2, 1)
    job = ScoringJob(pairs, "val", ())
    (tuned,) = tune_filters(job, ["plane"], tmp_path / "o", workers=1)
    assert tuned.plain.endswith("cleanup=0")
    with (tmp_path / "o" / "tuning.csv").open() as file:
        trials = list(csv.DictReader(file))
    best = min(trials[:5], key=lambda row: float(row["input_interior_rmse_mm"]))
    assert best["denoiser"] == tuned.plain
    assert {row["denoiser"] for row in trials if row["chosen"] == "1"} == {
        tuned.plain,
        tuned.cleaned,
    }
    command = ["eval", str(pairs / "test"), "--tune-filters", "-o", str(tmp_path / "p"), "-q"]
    assert main(command) == 2, "a folder without splits has nothing to tune on"
    (hint,) = re.findall(r"--set \S+", capsys.readouterr().err)
    data = str(tmp_path / "data")
    few = ["-q", "--subjects", "3", "--frames-per-subject", "1", "--set", "output.crop=64"]
    assert main(["generate", *few, "-o", data, *hint.split()]) == 0
    monkeypatch.setattr("glsim.denoise.registry.GRIDS", {"plane": GRIDS["plane"]})
    assert main(["eval", data, *command[2:], "--workers", "1", "--no-figures"]) == 0


@pytest.mark.long
def test_tables_say_the_same(pairs: Path, tmp_path: Path) -> None:
    out = tmp_path / "o"
    command = ["paper", "tables", str(pairs), "-o", str(out), "--workers", "1", "-q"]
    assert main(command) == 0
    with (out / "table.csv").open() as file:
        table = {(row["method"], row["metric"]): row for row in csv.DictReader(file)}
    mse = table["median", "mse_mm2"]
    assert float(mse["low_95"]) <= float(mse["mean"]) <= float(mse["high_95"])
    assert table["adaptive", "mse_mm2"]["mean"] == table["noisy", "mse_mm2"]["mean"]
    assert int(table["noisy", "filled_rmse_mm"]["undefined"]) == 12
    text = (out / "table.md").read_text()
    assert format_number(float(mse["mean"])) in text
    assert re.search(r"Undefined in 12 frames, .* filled_rmse_mm.*: .*`noisy`", text)
    assert "too few for intervals" in text
    assert "In brackets" not in text
    assert "0.9986" in (out / "paper_table_1.md").read_text()
    report = (out / "report.html").read_text()
    assert "http" not in report.replace("http-equiv", "")
    assert "data:image/png;base64," in report
    assert cv2.imread(str(out / "figures" / "gallery_1.png")).shape[1] > 600


def test_a_ruined_method_is_marked_though_the_papers_metrics_praise_it(
    pairs: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It removes the flipped pixels, of which all-pixel MSE consists, and bends the surface."""
    code = "import numpy as np\ndef bend(noisy_mm, valid):\n    "
    (here / "ruin.py").write_text(code + "return np.where(valid, noisy_mm + 30, 0), valid\n")
    monkeypatch.syspath_prepend(str(here))
    command = ["eval", str(pairs), "-d", "ruin:bend", "-d", "masked_gaussian", "-o", "out"]
    assert main([*command, "--no-figures"]) == 0
    said = capsys.readouterr().err
    assert "left out" not in said, "clean maps are read, too"
    (last,) = [line for line in said.splitlines() if "worse" in line]
    assert re.fullmatch(r"ruin:bend is worse inside than its input: 30\.\d against \S+ mm", last)
    text = (here / "out" / "table.md").read_text()
    assert not worse_inside(1.944, 1.938), "both print as 1.94"
    assert text.index("### Surface") < text.index("### The paper's metrics")
    assert "- `ruin:bend` is worse inside than its input: 30" in text
    best = re.search(
        r"`masked_gaussian` is best inside surfaces: (\S+) mm .* in 3 of 3 people", text
    )
    assert re.search(r"best inside surfaces: \S+ mm better than `ruin:bend` .* 3 of 3 people", text)
    assert "made of the truth of very few people" in text, "why the mean face beats every method"
    assert f"| {best[1]} |" in next(line for line in text.splitlines() if "| `noisy`" in line)
