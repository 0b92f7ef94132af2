"""``glsim paper reproduce`` in miniature: from nothing to the tables, resumed where it stopped."""

import json
import re
from itertools import product
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.eval.paper.ours_beside_printed import read_case
from glsim.eval.paper.printed_values import PRINTED_NETWORKS
from glsim.eval.paper.reproduce import load_plan
from glsim.simulation.plan.split import PAPER_IMAGES
from tests.support.face_sets import write_tree

TINY = """
title = "tiny"
seeds = [4]
protocols = ["depth", "paper"]
subjects = 3
frames_per_subject = 1
report = false
[settings]
sensor = "kinect-v2-paper"
split = [0.4, 0.3, 0.3]
output.crop = 64
[[train]]
recipes = ["paper-d7-small", "RECIPE"]
steps = 1
set = ["training.batch=1", "data.crop=64", "model.backbone.width=4", "model.backbone.depth=3"]
[filters]
seeds = [1]
subjects = 1
frames_per_subject = 1
"""


def tiny(tmp_path: Path, second: str = "paper-d20-small", text: str = TINY) -> list[str]:
    (tmp_path / "tiny.toml").write_text(text.replace("RECIPE", second))
    size = ["--size", str(tmp_path / "tiny.toml"), "--workers", "1"]
    return ["paper", "reproduce", "-o", str(tmp_path / "o"), *size]


@pytest.mark.long
def test_from_nothing_and_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "o"
    assert main([*tiny(tmp_path, "no-such-recipe"), "-q"]) == 2
    assert "no such recipe 'no-such-recipe'" in capsys.readouterr().err
    assert not out.exists()
    assert main(tiny(tmp_path)) == 0
    assert "complete" not in capsys.readouterr().err.replace("is complete already", "")
    two = (out / "paper_table_2.md").read_text()
    assert "| D7 | DnCNN D7, small, seeds: 1" in two
    assert "Protocol depth" in two
    assert "Protocol paper" in (out / "protocol_paper" / "paper_table_2.md").read_text()
    for folder, protocol in ((out, "depth"), (out / "protocol_paper", "paper")):
        record = json.loads((folder / "runs" / "paper-d7-small-4" / "run.json").read_text())
        assert record["data"].get("protocol", "depth") == protocol
    for protocol in ("depth", "paper"):
        rows = {"Median", "zero image", "D7", "AR D7", "D20"}
        assert rows <= {*read_case(out, protocol, "dense").seeds}
    for text in (two, (out / "paper_values.md").read_text()):
        assert text.splitlines()[0].endswith(", tiny")
        assert "2 trainings (seeds 4) of 1 steps" in text
        assert "train: 1 image of 1 person" in text

    # The same command trains nothing again; a step without its output or record is done again.
    run = out / "runs" / "paper-d7-small-4"
    page, before = (out / "paper_values.md").read_bytes(), (run / "last.pt").stat().st_mtime_ns
    assert main(tiny(tmp_path)) == 0
    said = capsys.readouterr().err
    assert "train runs/paper-d7-small-4: complete" in said
    assert "generate filters/dense/1/data: complete" in said
    assert (run / "last.pt").stat().st_mtime_ns == before
    assert (out / "paper_values.md").read_bytes() == page
    (out / "steps" / "train-runs-paper-d7-small-4.json").unlink()  # as after a kill
    assert main(tiny(tmp_path)) == 0
    assert "train runs/paper-d7-small-4: complete" not in capsys.readouterr().err
    assert json.loads((run / "run.json").read_text())["steps"] == 1


@pytest.mark.parametrize("size", ["tiny", "quick", "small", "full"])
def test_shipped_plans_train_every_row_in_every_case(
    size: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.train.step_cost.step_seconds", lambda recipe: 0.5)
    monkeypatch.setattr("glsim.train.step_cost.step_flop", lambda recipe: 1e12)
    assert main(["paper", "reproduce", "-o", "x", "--size", size, "--plan"]) == 0
    printed = capsys.readouterr().out
    total = printed.splitlines()[-1].split(" | ")
    if size == "full":  # an epoch has 8,007 batches (32,029 // 4), and there are 50 of them
        d7 = next(line for line in printed.splitlines() if "DnCNN D7" in line).split(" | ")
        assert (d7[1:4], total[1]) == (["12", "400,350", "0.5"], "72")
    trained = sum(map(int, re.findall(r"^train .*\((\d+)\): ", printed, re.MULTILINE)))
    plan = load_plan(size)
    rows = {row for row in PRINTED_NETWORKS if not row.startswith("AR ")}
    for protocol, mask in product(plan.protocols, plan.masks):
        recipes = plan.trainings(protocol, mask).values()
        trained -= len(recipes)
        assert {recipe.row for recipe in recipes if recipe.row} == rows
        assert {r.size for r in recipes if r.row} == {"full" if size == "full" else "small"}
        assert {recipe.data.protocol for recipe in recipes} == {protocol}
    assert trained == 0
    assert plan.data_settings("as-noisy", {}).output.clean_mask == "as-noisy"
    if size == "full":
        assert plan.subjects * plan.frames_per_subject == plan.images == sum(PAPER_IMAGES)


def test_face_sets_enter_the_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = write_tree("d3dfacs_alignments", tmp_path)
    sources = load_plan("small").data_settings("dense", {"d3dfacs": root}).source
    assert "d3dfacs" in {source.kind for source in sources}
    assert sum(source.count or 0 for source in sources) == 600
    command = ["paper", "reproduce", "-o", "x", "--plan", "--biwi", str(tmp_path / "none")]
    assert main(command) == 2
    assert "none" in capsys.readouterr().err
    assert main([*tiny(tmp_path), "--d3dfacs", str(root), "--plan"]) == 2
    assert "needs images = N" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("title = 'x'\nsubjects = 1\nframes_per_subject = 1\ntrain = []", "train"),
        (TINY + "option = 1", "no such setting 'filters.option'"),
    ],
)
def test_wrong_plans(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str
) -> None:
    assert main(tiny(tmp_path, text=text)) == 2
    assert words in capsys.readouterr().err
    assert main(["paper", "reproduce", "-o", "x", "--size", "p.toml"]) == 2
    assert "no such plan" in capsys.readouterr().err
