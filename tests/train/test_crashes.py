"""Trainings that are killed, cut, or run twice at once."""

import csv
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from glsim.core.errors import TrainError
from glsim.core.files import flush
from glsim.networks import checkpoint
from glsim.train.logs import RunLogs
from glsim.train.loop import StepStatus, fit
from tests.support.power_cuts import PowerCuts
from tests.support.train_fakes import batch_source, recipe

SETTINGS = recipe()


def run(folder: Path, **options: Any) -> dict[str, Any]:
    return fit(SETTINGS, batch_source(SETTINGS), folder, **options)


def test_a_second_training_is_refused_while_the_first_goes_on(tmp_path: Path) -> None:
    refused = []

    def try_again(_: StepStatus) -> None:
        with pytest.raises(TrainError, match="another training is writing here: wait") as caught:
            run(tmp_path, resume=True)
        refused.append(caught)

    run(tmp_path, on_step=try_again)
    assert refused
    assert run(tmp_path, resume=True)["state"] == "finished"


def test_files_of_a_run_are_whole_after_any_power_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    monkeypatch.setattr(flush, "_syncfs", lambda: lambda descriptor: 0)
    seen: dict[str, int] = {}

    def cut(disk: PowerCuts, step: int) -> None:
        state = tmp_path / "state"
        disk.write_state(state, names=step % 2 == 0)
        for name in ("recipe.json", "run.json", "metrics.csv", "best.pt", "last.pt"):
            if (state / name).exists():
                seen[name] = seen.get(name, 0) + 1
                assert (state / name).stat().st_size > 0, f"{name} is empty at step {step}"
                if name.endswith(".pt"):
                    checkpoint.load(state / name)
        shutil.rmtree(state)

    (tmp_path / "kept").mkdir()
    (tmp_path / "run").mkdir()
    PowerCuts(monkeypatch, tmp_path / "run", tmp_path / "kept", cut)
    run(tmp_path / "run")
    assert all(count > 3 for count in seen.values())
    assert len(seen) == 5


def test_metrics_are_whole_at_any_moment_of_a_resume(tmp_path: Path) -> None:
    """Lightning's logger deleted the file and wrote its rows again."""
    logs = RunLogs(tmp_path, 0)
    logs.write({"loss": 1.0}, 1)
    logs.write({"loss": 2.0, "mse": 3.0}, 2)
    logs.close()
    before = (tmp_path / "metrics.csv").read_bytes()
    RunLogs(tmp_path, 2)
    assert (tmp_path / "metrics.csv").read_bytes() == before
    RunLogs(tmp_path, 1)
    with (tmp_path / "metrics.csv").open() as file:
        assert list(csv.DictReader(file)) == [{"loss": "1.0", "mse": "", "step": "1"}]
