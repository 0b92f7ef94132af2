"""The start of a training: what is said at once, the precision, and what ``--minutes`` counts."""

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from glsim.train import loop, run_setup
from glsim.train.batches import StoredBatches
from glsim.train.loop import StepStatus, fit
from glsim.train.recipe import load_recipe
from glsim.train.run_setup import computes_bfloat16, with_precision
from tests.support.train_fakes import Domes, batch_source, recipe


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("flags\t\t: fpu sse avx2 avx512f avx512_bf16", True),
        ("flags\t\t: fpu avx512f amx_tile amx_bf16 amx_int8", True),
        ("Features\t: fp asimd bf16 i8mm", True),
        ("flags\t\t: fpu sse avx2 f16c avx512f", False),
    ],
)
def test_the_processor_decides_the_precision(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, expected: bool
) -> None:
    (tmp_path / "cpuinfo").write_text(f"processor\t: 0\n{line}\nbugs\t: none\n")
    monkeypatch.setattr(run_setup, "_CPU_INFO", tmp_path / "cpuinfo")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert computes_bfloat16() is expected
    face = load_recipe("face")
    assert face.training.precision == "auto"
    chosen = with_precision(face, None).training.precision
    assert chosen == ("bf16-mixed" if expected else "32-true")


def test_a_resumed_training_keeps_its_precision(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also on a processor that would have chosen another one."""
    settings = recipe(training={"precision": "auto", "max_steps": 2})
    for here in (True, False):
        monkeypatch.setattr(run_setup, "computes_bfloat16", lambda here=here: here)
        more = settings.training.model_copy(update={"max_steps": 4 if not here else 2})
        longer = settings.model_copy(update={"training": more})
        fit(longer, batch_source(longer), tmp_path, resume=True)
        written = json.loads((tmp_path / "recipe.json").read_text())
        assert written["training"]["precision"] == "bf16-mixed"


class SlowToLoad(StoredBatches):
    """Batches whose first one takes an hour of the stand-in clock."""

    clock = 0.0

    def batches(self, epoch: int, skip: int) -> Iterator[tuple[Tensor, Tensor]]:
        type(self).clock += 3600.0
        return super().batches(epoch, skip)


def test_minutes_count_from_the_first_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SlowToLoad, "clock", 0.0)
    monkeypatch.setattr(loop, "time", SimpleNamespace(monotonic=lambda: SlowToLoad.clock))
    settings = recipe(training={"max_epochs": None, "max_minutes": 61.0})
    held_out = batch_source(settings).validation
    source = SlowToLoad(Domes(8), held_out, {"name": "slow"}, settings)
    seen: list[StepStatus] = []
    report = fit(settings, source, tmp_path, on_step=seen.append)
    # The hour before the first epoch is not counted; those before the second and third are.
    assert report["ended"] == "minutes"
    assert seen[0].seconds == 0.0
    assert report["epochs"] == 2
    assert report["seconds"] == 7200.0


def test_each_validation_takes_a_share_of_the_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first one decides how many frames are validated; without a limit it is all of them."""
    clock = itertools.count()  # each look at it is a second later
    monkeypatch.setattr(loop, "time", SimpleNamespace(monotonic=lambda: float(next(clock))))
    monkeypatch.setattr(loop, "VALIDATION_BATCH", 1)
    counted: list[int] = []

    def figures(_network: object, batches: Iterator[Any], _loss: object) -> dict[str, float]:
        counted.append(len(list(batches)))
        return {"loss": 1.0, "mse_mm2": 1.0, "interior_rmse_mm": 1.0, "flips": 1.0}

    monkeypatch.setattr(loop, "validation_figures", figures)
    for minutes, expected in ((0.3, [2, 2]), (None, [3, 3])):  # 0.3 min: 1.8 s for a validation
        counted.clear()
        training = {"max_epochs": 2, "patience": None, "max_minutes": minutes}
        settings = recipe(training=training)
        fit(settings, batch_source(settings, count=4), tmp_path / str(minutes))
        assert counted == expected
