"""``glsim generate --plan`` and ``--part`` on the command line, as a job of an array too."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.cli.generate import _print_empty_splits
from glsim.data import chunks
from glsim.data.progress import GenerateSummary
from glsim.data.verification import verify
from glsim.settings.schema import load_settings
from tests.support.dataset_fakes import contents
from tests.support.imports import ROOT

FEW = ["--subjects", "3", "--frames-per-subject", "4", "--sensor", "ideal", "-q"]
FEW += ["--set", "output.crop=32", "--workers", "1"]


def test_a_large_plan_is_a_summary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    few = ["--subjects", "1000", "--frames-per-subject", "3600", "--workers", "10"]
    assert main(["generate", *few, "--plan"]) == 0
    text = capsys.readouterr().out
    assert "3600000 images" in text
    assert "with 10 workers" in text
    assert "p0000" not in text
    assert len(text.splitlines()) < 20
    (tmp_path / "generic_neutral_mesh.obj").touch()
    assert main(["generate", "--plan", "--source", "folder", "--root", str(tmp_path)]) == 0
    assert "--source ict-facekit" in capsys.readouterr().err


@pytest.mark.parametrize(("people", "why"), [(3, "all frames of"), (1, "people in all: 1")])
def test_a_split_without_people_has_its_true_reason(
    capsys: pytest.CaptureFixture[str], people: int, why: str
) -> None:
    settings = load_settings(source={"subjects": people, "frames_per_subject": 1})
    counts = {"train": 1, "val": 0, "test": 0}
    _print_empty_splits(settings, GenerateSummary(counts, counts, {}, 1, 0, 1, 1.0, 1.0))
    assert capsys.readouterr().err.startswith(f"nobody is in val and test: {why}")


def test_the_last_part_merges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "png", 3)
    out = ["generate", "-o", str(tmp_path / "parts"), *[w for w in FEW if w != "-q"]]
    assert main([*out, "--part", "1/2"]) == 0
    assert "not complete yet: part 2 (or 0) of 2; the last part" in capsys.readouterr().err
    assert main([*out, "--part", "0/2"]) == 0
    assert "12 frames (train 4, val 4, test 4)" in capsys.readouterr().err
    assert verify(tmp_path / "parts", deep=True) == []
    assert main(["generate", "-o", str(tmp_path / "whole"), *FEW]) == 0
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")


@pytest.mark.long
def test_the_recipe_for_slurm_makes_a_data_set(tmp_path: Path) -> None:
    """The page's script as two jobs of its array, with a small set and the variables of Slurm."""
    page = (ROOT / "docs/howto/many_machines.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```sh\n(#!/bin/bash\n#SBATCH.*?)```", page, re.DOTALL)
    small = "-o out " + " ".join(FEW[:-2])
    script = re.sub(r"-o \S+ --subjects \d+ --frames-per-subject \d+", small, script)
    script = script.replace("/64", "/2").replace("srun glsim", f"{sys.executable} -m glsim")
    for number in ("0", "1"):
        slurm = {"SLURM_ARRAY_TASK_ID": number, "SLURM_CPUS_PER_TASK": "1"}
        environment = os.environ | slurm | {"PYTHONPATH": str(ROOT)}
        subprocess.run(["bash", "-c", script], cwd=tmp_path, check=True, env=environment)
    assert verify(tmp_path / "out", deep=True) == []
