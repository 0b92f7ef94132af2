"""``glsim paper reproduce`` in miniature: from nothing to the tables, resumed where it stopped."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.cli.paper.reproduce import load_plan
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
    assert "stopped in command 12 of 18: glsim train no-such-recipe" in error
    first = runs / "paper-d7-small-4" / "last.pt"
    before = first.stat().st_mtime_ns

    command = tiny(tmp_path)
    assert main(command) == 0
    said = capsys.readouterr().err
    assert "11/18, " in said
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
    findings = (out / "findings.md").read_text()
    assert "| relation | printed | protocol depth | protocol paper |" in findings
    assert (
        "| deeper DnCNNs have a smaller MSE: D64 < D20 < D7 | yes "
        "| not scored: D20, D64 not trained | not scored: D64 not trained |" in findings
    )
    assert "3 of 3 rows were trained smaller than printed" in findings
    assert (out / "findings.html").is_file()
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
    """Every row of tables 2 and 3 under both protocols, and options that the commands know."""
    assert main(["paper", "reproduce", "-o", "x", "--size", size, "--plan"]) == 0
    lines = [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()]
    scored = {"small": 17 + 9, "full": 27 + 27}[size]
    kinds = [line[0] for line in lines]
    assert kinds[-3:] == ["paper", "paper", "paper"]
    assert lines[-3][-4:] == ["--photo-runs", "x/photo_runs", "-o", "x"]
    assert lines[-2] == ["paper", "figures", "x"]
    assert lines[-1] == ["paper", "findings", "x"]
    photographs = [line for line in lines if "--photos" in line]
    lines = [line for line in lines if line not in photographs]
    assert [line[0] for line in lines].count("train") == scored
    check_photographs([line for line in lines if line[0] == "train"], photographs)
    recipes = [load_recipe(line[1]) for line in lines if line[0] == "train"]
    rows = {"D7", "AR D7", "D20", "AR D20", "D64", "AR D64", "UNet", "Restormer"}
    assert {recipe.row for recipe in recipes} == rows | {None}
    for protocol in ("depth", "paper"):
        under = [
            load_recipe(line[1]).row for line in lines if line[2:4] == ["--protocol", protocol]
        ]
        assert {*under} == rows | {None}, protocol
    assert {recipe.size for recipe in recipes if recipe.row} == {size}
    folders = [line[-1] for line in lines if line[0] == "train"]
    assert len(set(folders)) == scored
    generated = [line for line in lines if line[0] == "generate"]
    for line in generated[:2]:  # the data of networks, and one set of table 1
        assert main([*line, "--plan"]) == 0


def check_photographs(on_pairs: list[list[str]], on_photographs: list[list[str]]) -> None:
    """Each is the training of a recipe and seed on our pairs, but for the photographs."""
    for line in on_photographs:
        at = line.index("--photos")
        assert line[at + 1] == "scikit-image"
        assert line[at + 2] == "--photo-sigma"
        same = [word for word in line if word not in line[at : at + 4]]
        assert same[:-1] in [other[:-1] for other in on_pairs]
    seeds = [line[line.index("--seed") + 1] for line in on_photographs]
    assert set(seeds) == {"0", "1", "2"}


def test_face_sets_and_photographs_enter_the_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a set, the whole data set is its mixture; the commands can be run by hand."""
    photos = tmp_path / "photos"
    photos.mkdir()
    root = write_tree("d3dfacs_alignments", tmp_path)
    command = [
        "paper",
        "reproduce",
        "-o",
        "x",
        "--plan",
        "--d3dfacs",
        str(root),
        "--photos",
        str(photos),
    ]
    assert main(command) == 2
    assert f"--photos {photos}: holds 0 images" in capsys.readouterr().err
    for number in range(2):
        cv2.imwrite(str(photos / f"{number}.png"), np.zeros((8, 8), np.uint8))
    assert main(command) == 0
    lines = [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()]
    assert {line[line.index("--photos") + 1] for line in lines if "--photos" in line} == {
        str(photos)
    }
    assert "--subjects" not in lines[0]
    assert main([*lines[0], "--plan"]) == 0
    plan = capsys.readouterr().out
    assert "d3dfacs" in plan
    assert "600 images" in plan
    assert main(["paper", "reproduce", "-o", "x", "--plan", "--biwi", str(tmp_path / "none")]) == 2
    assert "none" in capsys.readouterr().err


def test_a_plan_without_a_number_of_images_takes_no_face_sets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_tree("hpdb", tmp_path)
    assert main([*tiny(tmp_path), "--biwi", str(root), "--plan"]) == 2
    assert "needs images = N" in capsys.readouterr().err


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
