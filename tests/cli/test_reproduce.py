"""``glsim reproduce`` in miniature: from nothing to the tables, and on from where it stopped."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.cli.reproduce import load_plan
from glsim.plan.paper_split import PAPER_IMAGES, split_as_paper
from glsim.settings.schema import load_settings
from glsim.train.recipe import load_recipe

TINY = """
title = "tiny"
seeds = [4]
protocols = ["depth", "paper"]
generate = \"\"\"--subjects 3 --frames-per-subject 1 --split 0.4,0.3,0.3 --crop 64 --workers 1
    --sensor kinect-v2-paper\"\"\"
eval = "--workers 1 --no-probes --no-figures"
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
    return ["reproduce", "-o", str(tmp_path / "o"), "--size", str(tmp_path / "tiny.toml")]


def test_from_nothing_and_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = tmp_path / "o" / "runs"
    assert main([*tiny(tmp_path, "no-such-recipe"), "-q"]) == 1
    error = capsys.readouterr().err
    assert "no such recipe 'no-such-recipe'" in error
    assert "stopped in command 12 of 17: glsim train no-such-recipe" in error
    first = runs / "paper-d7-small-4" / "last.pt"
    before = first.stat().st_mtime_ns

    command = tiny(tmp_path)
    assert main(command) == 0
    said = capsys.readouterr().err
    assert "11/17, " in said
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


def _check_protocols(out: Path) -> None:
    """The paper's protocol has networks and tables of its own; table 1 is under all cases."""
    two = (out / "protocol_paper" / "paper_table_2.md").read_text()
    assert "Protocol paper: the nearest point of each frame at 1 mm." in two
    assert "| D20 | DnCNN D20 | small; **not run at full size** | 1 |" in two
    for run, protocol in ((out / "runs", None), (out / "protocol_paper" / "runs", "paper")):
        record = json.loads((run / "paper-d7-small-4" / "run.json").read_text())
        assert record["data"].get("protocol") == protocol
    page = (out / "protocols.md").read_text()
    for case in ("depth, dense clean maps", "depth, BlenSor's mask", "paper, dense clean maps"):
        assert f"| protocol {case} |" in page
    assert "| printed | 1.000 | 1.000 | 0.965 | 0.813 | 0.956 |" in page
    assert "Bilateral is below Median" in page
    for mask in ("dense", "as-noisy"):
        text = (out / "filters" / mask / "1" / "ssim_readings.md").read_text()
        assert "hypothesis" in text


def test_one_protocol_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*tiny(tmp_path), "--protocol", "paper", "--plan"]) == 0
    lines = [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()]
    given = [line[line.index("--protocol") + 1] for line in lines if "--protocol" in line]
    assert set(given) == {"paper"}
    assert len([line for line in lines if line[0] == "train"]) == 3
    assert main([*tiny(tmp_path), "--protocol", "both", "--plan"]) == 2
    assert "--protocol both" in capsys.readouterr().err


@pytest.mark.parametrize("size", ["small", "full"])
def test_shipped_plans_fit_the_commands(size: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every row of tables 2 and 3, three seeds each, and options that the commands know."""
    assert main(["reproduce", "-o", "x", "--size", size, "--plan"]) == 0
    lines = [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()]
    scored = {"small": 27 + 21, "full": 27 + 27}[size]
    assert [line[0] for line in lines].count("train") == scored
    assert lines[-1][0] == "eval"
    recipes = [load_recipe(line[1]) for line in lines if line[0] == "train"]
    rows = {"D7", "AR D7", "D20", "AR D20", "D64", "AR D64", "UNet", "Restormer"}
    assert {recipe.row for recipe in recipes} == rows | {None}
    assert {recipe.size for recipe in recipes if recipe.row} == {size}
    folders = [line[-1] for line in lines if line[0] == "train"]
    assert len(set(folders)) == scored
    for line in lines:
        if line[0] == "generate":
            assert main([*line, "--plan"]) == 0


def test_the_full_plan_has_the_papers_numbers() -> None:
    words = shlex.split(load_plan("full").generate)
    options = dict(zip(words[::2], words[1::2], strict=True))
    people, each = int(options["--subjects"]), int(options["--frames-per-subject"])
    assert people * each == sum(PAPER_IMAGES)
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
    assert main(["reproduce", "-o", str(tmp_path), "--size", size]) == 2
    assert words in capsys.readouterr().err
