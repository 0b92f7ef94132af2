"""``glsim paper reproduce`` in miniature: from nothing to the tables, resumed where it stopped."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.cli.paper.plan import load_plan
from glsim.cli.paper.plan_hours import _Training
from glsim.eval.paper.cases import read_cases
from glsim.eval.paper.printed_values import PRINTED_NETWORKS
from glsim.plan.paper_split import PAPER_IMAGES, split_as_paper
from glsim.settings.schema import load_settings
from glsim.train.recipe import load_recipe
from tests.support.face_set_trees import write_tree

TINY = """
title = "tiny"
seeds = [4]
protocols = ["depth", "paper"]
generate = \"\"\"--subjects 3 --frames-per-subject 1 --split 0.4,0.3,0.3 --crop 64 --workers 1
    --sensor kinect-v2-paper\"\"\"
eval = "--workers 1 --no-baselines --no-figures"
figures = false
[[train]]
recipes = ["paper-d7-small", "RECIPE"]
options = \"\"\"--steps 1 --set training.batch=1 --set data.crop=64 --set model.backbone.width=4
    --set model.backbone.depth=3\"\"\"
[[train]]
recipes = ["paper-d20-small"]
protocols = ["paper"]
seeds = [7]
options = \"\"\"--steps 1 --set training.batch=1 --set data.crop=64 --set model.backbone.width=4
    --set model.backbone.depth=3\"\"\"
[filters]
seeds = [1]
generate = \"\"\"--subjects 1 --frames-per-subject 1 --split 0,0,1 --crop 64 --workers 1
    --sensor kinect-v2-paper\"\"\"
"""


def tiny(tmp_path: Path, second: str = "mask-aware-small") -> list[str]:
    (tmp_path / "tiny.toml").write_text(TINY.replace("RECIPE", second))
    return ["paper", "reproduce", "-o", str(tmp_path / "o"), "--size", str(tmp_path / "tiny.toml")]


@pytest.mark.long
def test_from_nothing_and_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = tmp_path / "o" / "runs"
    assert main([*tiny(tmp_path, "no-such-recipe"), "-q"]) == 1
    error = capsys.readouterr().err
    assert "no such recipe 'no-such-recipe'" in error
    assert "stopped in command 9 of 14: glsim train no-such-recipe" in error
    first = runs / "paper-d7-small-4" / "last.pt"
    before = first.stat().st_mtime_ns

    command = tiny(tmp_path)
    assert main(command) == 0
    said = capsys.readouterr().err
    assert "8/14, " in said
    assert "finished before: glsim train paper-d7-small --steps 1" in said
    assert "3 of them were complete already" in said
    assert first.stat().st_mtime_ns == before
    two = (tmp_path / "o" / "paper_table_2.md").read_text()
    assert "| D7 | DnCNN D7 | small; **not run at full size** | 1 |" in two
    assert "| - | mask-aware DnCNN, 7 layers [hard] | small | 1 |" in two
    assert (tmp_path / "o" / "paper_table_1.md").is_file()
    assert "Protocol depth" in two
    _check_protocols(tmp_path / "o")

    # An interrupted training goes on; this one has nothing left to do but to say so.
    run = json.loads((runs / "mask-aware-small-4" / "run.json").read_text())
    (runs / "mask-aware-small-4" / "run.json").write_text(
        json.dumps(run | {"state": "interrupted"})
    )
    assert main([*command, "-q"]) == 0
    again = json.loads((runs / "mask-aware-small-4" / "run.json").read_text())
    assert (again["state"], again["steps"]) == ("finished", 1)


def test_the_tiny_plan_from_nothing_to_the_verdicts(tmp_path: Path) -> None:
    """Every step of a reproduction: no value is left without scores, in any of the four cases."""
    out = tmp_path / "o"
    assert main(["paper", "reproduce", "-o", str(out), "--size", "tiny", "-q"]) == 0
    page = (out / "verdicts.md").read_text()
    assert "| not trained yet | 0 |" in page
    assert page.count(" | **") == 39
    assert (out / "verdicts.html").is_file()
    cases = {case.title: case for case in read_cases(out)}
    assert len(cases) == 4
    for case in cases.values():
        assert {*case.networks} == {*PRINTED_NETWORKS}
        assert len(case.others) == 3  # the mask-aware one, and two without clean frames
        assert case.networks["AR D20"].values == case.networks["D20"].values
        zeros, noisy = (case.values[name]["mse_mm2"] for name in ("zero image", "noisy"))
        assert all(zero > 0 for zero in zeros)
        assert len(zeros) == len(noisy) == 2
    for name in ("paper_figures.html",):
        assert list(out.rglob(name)), name
    # Nothing was trained for the rows with artefact removal.
    assert not list(out.rglob("paper-ar-*"))
    # The commands beside the values score them again, and leave all others as they are.
    commands = set(re.findall(r"`glsim (paper tables [^`]*)`", page))
    assert len(commands) > 3
    for command in commands:
        assert main([*shlex.split(command), "-q"]) == 0
    assert main(["paper", "page", str(out), "-q"]) == 0
    assert (out / "verdicts.md").read_text() == page


def _check_protocols(out: Path) -> None:
    """The paper's protocol has networks and tables of its own; table 1 is under all cases."""
    two = (out / "protocol_paper" / "paper_table_2.md").read_text()
    assert "Protocol paper: the nearest point of each frame at 1 mm." in two
    assert "| D20 | DnCNN D20 | small; **not run at full size** | 1 |" in two
    for run, protocol in ((out / "runs", None), (out / "protocol_paper" / "runs", "paper")):
        record = json.loads((run / "paper-d7-small-4" / "run.json").read_text())
        assert record["data"].get("protocol") == protocol


def test_one_protocol_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*tiny(tmp_path), "--protocol", "paper", "--plan", "--no-hours"]) == 0
    lines = [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()]
    given = [line[line.index("--protocol") + 1] for line in lines if "--protocol" in line]
    assert set(given) == {"paper"}
    assert len([line for line in lines if line[0] == "train"]) == 3
    assert main([*tiny(tmp_path), "--protocol", "both", "--plan"]) == 2
    assert "--protocol both" in capsys.readouterr().err


def test_a_plan_without_a_number_of_images_takes_no_face_sets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_tree("hpdb", tmp_path)
    assert main([*tiny(tmp_path), "--biwi", str(root), "--plan"]) == 2
    assert "needs images = N" in capsys.readouterr().err


def test_a_plan_prints_the_hours_of_its_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps times the measured time of one; limits are those of the options and of the recipe."""
    seconds = {"D7": 36.0, "D20": 720.0, None: 3600.0}
    step_time = pytest.importorskip("glsim.train.step_time")
    monkeypatch.setattr(step_time, "seconds_per_step", lambda recipe: seconds[recipe.row])
    command = tiny(tmp_path)
    plan = tmp_path / "tiny.toml"
    text = plan.read_text().replace("--steps 1", "--steps 50", 1)
    plan.write_text(text.replace("seeds = [4]", "seeds = [4, 5]", 1))
    assert main([*command, "--plan"]) == 0
    printed = capsys.readouterr()
    assert all(line.startswith("glsim ") for line in printed.out.splitlines())
    said = printed.err
    # D7: 2 seeds under 2 protocols of 50 steps of 36 s; D20 once, one step of 720 s.
    assert "D7 (paper-d7-small): 4 trainings, 0.0278 steps a second, at most 50 steps" in said
    assert "50 steps each: 2.0 h" in said
    assert "D20 (paper-d20-small): 1 trainings" in said
    assert "at most 1 steps each: 12 min" in said
    assert "all trainings: at most 202.2 h" in said


def test_epochs_are_capped_by_the_images_of_the_plan() -> None:
    """8,008 batches of 4 in an epoch of the full plan's 32,029 images, at most 50 epochs."""
    plan = load_plan("full")
    assert plan.training_images() == PAPER_IMAGES[0]
    recipe = load_recipe("paper-d7")
    assert (recipe.training.patience, recipe.training.max_epochs) == (10, 50)
    assert _Training(recipe, "D7").steps(plan.training_images()) == 50 * 8008
    assert _Training(recipe, "D7").steps(None) is None
    assert _Training(load_recipe("paper-d7-small"), "").steps(400) == 500


def test_the_full_plan_has_the_papers_numbers() -> None:
    plan = load_plan("full")
    words = shlex.split(f"{plan.faces} {plan.generate}")
    options = dict(zip(words[::2], words[1::2], strict=True))
    people, each = int(options["--subjects"]), int(options["--frames-per-subject"])
    assert people * each == plan.images == sum(PAPER_IMAGES)
    assert load_settings(overrides={"split": options["--split"]}).split == "paper"
    split = list(split_as_paper({f"{n:04d}": each for n in range(people)}, 1).values())
    for name, wanted in zip(("train", "val", "test"), PAPER_IMAGES, strict=True):
        assert split.count(name) * each == pytest.approx(wanted, abs=each / 2)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "no such plan"),
        ("title = 'x'\ngenerate = ''\ntrain = []", "train"),
        (TINY + "option = 1", "no such setting 'filters.option'"),
    ],
)
def test_wrong_plans(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None, words: str
) -> None:
    if text is not None:
        (tmp_path / "p.toml").write_text(text)
    size = str(tmp_path / "p.toml")
    assert main(["paper", "reproduce", "-o", str(tmp_path), "--size", size]) == 2
    assert words in capsys.readouterr().err
