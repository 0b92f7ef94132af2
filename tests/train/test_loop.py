"""The training loop: resumed without a difference, stopped early, stopped by nan."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from glsim.core.errors import ConfigError, TrainError
from glsim.eval.metrics.frame_score import score
from glsim.eval.metrics.scored_map import Truth
from glsim.networks import checkpoint
from glsim.train.batches import EpochSampler, StoredBatches
from glsim.train.loop import fit, validation_figures
from glsim.train.losses import AllPixels, Masked
from glsim.train.models.base import Prediction
from glsim.train.recipe import Recipe
from tests.support.eval_scenes import ADVERSARIAL, CAMERA, dome, noisy
from tests.support.train_fakes import Domes, batch_source, recipe


def after(steps: int) -> Callable[[], bool]:
    """A ``should_stop`` that is true from this call on."""
    calls = iter(range(steps - 1))
    return lambda: next(calls, None) is None


def run(settings: Recipe, folder: Path, name: str = "domes", **options: Any) -> dict[str, Any]:
    return fit(settings, batch_source(settings, name=name), folder, **options)


def rows(folder: Path) -> list[dict[str, str]]:
    """Rows of metrics.csv without the column of seconds."""
    with (folder / "metrics.csv").open() as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def same(first: Path, second: Path, name: str) -> None:
    ours, theirs = (checkpoint.load(folder / name)["model"] for folder in (first, second))
    assert ours.keys() == theirs.keys()
    assert all(torch.equal(ours[key], theirs[key]) for key in ours)


@pytest.mark.parametrize(
    "training",
    [
        {},
        {"ema_decay": 0.9},
        {"precision": "bf16-mixed", "validate_every": 3},
        {"validate_every": 2, "validate_unit": "steps"},
    ],
    ids=["plain", "average", "bf16", "by steps"],
)
def test_interrupted_anywhere_equals_uninterrupted(
    tmp_path: Path, training: dict[str, Any]
) -> None:
    settings = recipe(training=training, schedule={"kind": "cosine", "warmup_steps": 2})
    whole = run(settings, tmp_path / "whole")
    assert (whole["state"], whole["ended"], whole["steps"]) == ("finished", "epochs", 6)
    parts = tmp_path / "parts"
    for steps in (1, 1, 2, 1):  # in the middle of an epoch, at its end, ...
        torch.manual_seed(123)  # earlier draws of the process must not matter
        report = run(settings, parts, resume=True, should_stop=after(steps))
        assert report["state"] == "interrupted"
    assert run(settings, parts, resume=True)["state"] == "finished"
    for name in ("best.pt", "last.pt"):
        same(tmp_path / "whole", parts, name)
    figures = [checkpoint.load(f / "best.pt")["validation"] for f in (tmp_path / "whole", parts)]
    assert figures[0] == figures[1]
    assert rows(tmp_path / "whole") == rows(parts)


@pytest.mark.long
def test_a_resumed_training_keeps_its_number_of_threads(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings = recipe(training={"max_steps": 4, "validate_every": 1, "validate_unit": "steps"})
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        run(settings, tmp_path / "whole")
        run(settings, tmp_path / "parts", should_stop=after(2))
        torch.set_num_threads(1)
        run(settings, tmp_path / "parts", resume=True)
        assert torch.get_num_threads() == 2
        last = checkpoint.load(tmp_path / "parts" / "last.pt")
        assert last["arithmetic"]["threads"] == 2
    finally:
        torch.set_num_threads(before)
    same(tmp_path / "whole", tmp_path / "parts", "last.pt")
    assert not caplog.records


def test_it_learns_and_leaves_what_it_promises(tmp_path: Path) -> None:
    training = {"max_epochs": 12}
    report = run(recipe(training=training), tmp_path)
    losses = [float(row["validation_loss"]) for row in rows(tmp_path)]
    assert len(losses) == 12
    assert losses[-1] < 0.7 * losses[0]
    assert report["best"]["value"] == pytest.approx(min(losses))
    assert json.loads((tmp_path / "run.json").read_text()) == report
    assert report["data"] == {"name": "domes"}
    assert json.loads((tmp_path / "recipe.json").read_text())["training"]["max_epochs"] == 12
    picture = cv2.imread(str(tmp_path / "samples" / "epoch_0012.png"))
    assert picture.shape == (3 * 28, 4 * 28, 3)
    assert any((tmp_path / "tensorboard").iterdir())


def test_early_stopping_keeps_the_best(tmp_path: Path) -> None:
    """A learning rate far too large makes the first validation, or one soon after, the best."""
    settings = recipe(optimiser={"lr": 0.9}, training={"max_epochs": None, "patience": 2})
    report = run(settings, tmp_path)
    assert report["ended"] == "patience"
    assert report["steps"] == report["best"]["step"] + 2 * 2
    best, last = (checkpoint.load(tmp_path / name) for name in ("best.pt", "last.pt"))
    assert best["validation"]["loss"] == report["best"]["value"] <= last["validation"]["loss"]
    assert best["progress"]["steps"] == report["best"]["step"]


def test_an_average_is_what_is_judged_and_kept(tmp_path: Path) -> None:
    run(recipe(training={"ema_decay": 0.99}), tmp_path)
    best, last = (checkpoint.load(tmp_path / name) for name in ("best.pt", "last.pt"))
    for name, weight in best["model"].items():
        assert torch.equal(weight, last["average"][f"module.{name}"])
    assert any(not torch.equal(w, last["model"][name]) for name, w in best["model"].items())


def test_a_network_that_calls_no_pixel_depth_goes_on(tmp_path: Path) -> None:
    settings = recipe(model={"uncertainty": True}, training={"max_steps": 1})
    blank: Any = [(torch.zeros(1, 24, 24), torch.zeros(1, 24, 24))]
    report = fit(settings, StoredBatches(Domes(4), blank, {}, settings), tmp_path / "r")
    assert report["state"] == "finished"
    assert checkpoint.load(tmp_path / "r" / "best.pt")["model"]["sigma_scale"] == 1


def test_minutes_end_it_and_count_over_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = iter(range(0, 100_000, 5))  # each call of the clock advances it by 5 s
    clock = SimpleNamespace(monotonic=lambda: float(next(now)))
    monkeypatch.setattr("glsim.train.loop.time", clock)
    limits = {"max_epochs": None, "max_minutes": 2.0}
    first = run(recipe(training=limits), tmp_path, should_stop=after(3))
    assert first["state"] == "interrupted"
    done = run(recipe(training=limits), tmp_path, resume=True)
    assert done["ended"] == "minutes"
    assert 120 <= done["seconds"] < 180
    assert done["best"]["step"] > 0, "validated at the end"
    again = run(recipe(training=limits), tmp_path, resume=True)
    assert again["steps"] == done["steps"]


def poisoned(settings: Recipe) -> StoredBatches:
    domes, held_out = Domes(10), Domes(3)
    domes.noisy[7] = torch.full_like(domes.noisy[7], torch.nan)
    return StoredBatches(domes, held_out, {"name": "domes"}, settings)  # type: ignore[arg-type]


def test_nan_stops_it_and_the_checkpoint_before_survives(tmp_path: Path) -> None:
    settings = recipe(
        model={"kind": "paper_input"}, loss={"kind": "all_pixels"}, training={"max_epochs": 9}
    )
    run(settings, tmp_path, should_stop=after(2))
    with pytest.raises(TrainError, match=r"the loss is nan at step .*nan_batch.pt.*last.pt"):
        fit(settings, poisoned(settings), tmp_path, resume=True)
    last = checkpoint.load(tmp_path / "last.pt")
    assert all(weight.isfinite().all() for weight in last["model"].values())
    batch = torch.load(tmp_path / "nan_batch.pt", weights_only=True)
    assert batch["noisy_mm"].isnan().any(dim=(1, 2, 3)).sum() == 1


def test_folders_and_checkpoints_that_do_not_belong(tmp_path: Path) -> None:
    run(recipe(training={"max_epochs": 1}), tmp_path)
    with pytest.raises(TrainError, match="--resume"):
        run(recipe(), tmp_path)
    with pytest.raises(TrainError, match=r"another recipe: its loss.beta_mm is None, not 1.5"):
        run(recipe(loss={"beta_mm": 1.5}), tmp_path, resume=True)
    with pytest.raises(TrainError, match=r"other data \(name differ\)"):
        run(recipe(), tmp_path, "others", resume=True)
    last = tmp_path / "last.pt"
    last.write_bytes(last.read_bytes()[:500])
    with pytest.raises(TrainError, match="cut short"):
        run(recipe(), tmp_path, resume=True)


def test_settings_that_cannot_be(tmp_path: Path) -> None:
    limits = {"max_epochs": None}
    with pytest.raises(ConfigError, match="must know the end"):
        run(recipe(schedule={"kind": "cosine"}, training=limits), tmp_path / "a")
    with pytest.raises(ConfigError, match="the data set has 10 pairs"):
        run(recipe(training={"batch": 11}), tmp_path / "b")


def test_batches_are_a_function_of_seed_and_epoch() -> None:
    def batches(seed: int, epoch: int, skip: int = 0) -> list[list[int]]:
        sampler = EpochSampler(11, 2, seed)
        sampler.set_epoch(epoch, skip)
        return list(sampler)

    assert batches(0, 0) == batches(0, 0)
    assert batches(0, 0) not in (batches(0, 1), batches(1, 0))
    assert batches(0, 3, skip=1) == batches(0, 3)[1:]
    seen = [n for batch in batches(0, 0) for n in batch]
    assert len(seen) == len(set(seen)) == 10


@pytest.mark.parametrize("case", ADVERSARIAL)
def test_figures_are_the_evaluations(case: str) -> None:
    prediction, clean, given = (np.abs(image) for image in ADVERSARIAL[case])
    noisy_mm, clean_mm = (torch.from_numpy(image)[None, None] for image in (given, clean))
    model = lambda _: Prediction(torch.from_numpy(prediction)[None, None])  # noqa: E731
    ours = validation_figures(model, [(noisy_mm, clean_mm)], AllPixels())
    truth = Truth(clean, given, CAMERA.rays())
    theirs = score(np.where(prediction >= 0.5, prediction, 0), truth)
    assert ours["mse_mm2"] == pytest.approx(theirs["mse_mm2"])
    before = score(given, truth)
    for of, scores in (("", theirs), ("input_", before)):
        wanted = scores["both_interior_rmse_mm"]
        assert ours[f"{of}interior_rmse_mm"] == pytest.approx(wanted, nan_ok=True)
        assert ours[f"{of}flips"] == scores["flips_px"]


def test_figures_do_not_depend_on_batches() -> None:
    pairs = Domes(5)
    model = lambda noisy_mm: Prediction(noisy_mm)  # noqa: E731
    all_figures = [
        validation_figures(model, DataLoader(pairs, size), AllPixels()) for size in (1, 2, 5)
    ]
    for figures in all_figures[1:]:
        assert figures == pytest.approx(all_figures[0])


def test_the_masked_loss_looks_where_depth_can_be_known() -> None:
    clean = torch.from_numpy(dome())[None, None]
    given = torch.from_numpy(noisy(dome()))[None, None]
    logit = torch.where(clean > 0, 20.0, -20.0)
    loss = Masked(reach_px=2)
    nothing, parts = loss(Prediction(clean, logit), given, clean)
    assert nothing < 1e-6
    assert parts.keys() == {"depth", "valid", "slope"}
    behind = torch.where(clean > 0, clean, torch.full_like(clean, 5000.0))
    assert loss(Prediction(behind, logit), given, clean)[0] < 1e-6, "outside, depth is free"
    far = given.clone()
    far[..., :20, :] = 0
    off = clean.clone()
    off[..., :10, :] += 50
    assert loss(Prediction(off, logit), far, clean)[0] < 1e-6, "so it is beyond the fill's reach"
    assert loss(Prediction(off, logit), given, clean)[0] > 1
    _, parts = loss(Prediction(clean + 30, logit), given, clean)
    assert parts["depth"] == pytest.approx(30 - 2 / 2)
    assert parts["slope"] < 1e-6, "a shift has no slope"
    assert loss(Prediction(clean, -logit), given, clean)[0] > 50


def test_relative_errors_do_not_depend_on_the_camera_s_noise() -> None:
    """A frame with six times the noise and six times the error counts the same."""
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn((1, 1, 60, 60), generator=generator)
    error = torch.randn(noise.shape, generator=generator)
    clean = torch.full_like(noise, 900.0)
    logit = torch.full_like(noise, 20.0)
    parts = {
        (relative, size): Masked(relative=relative)(
            Prediction(clean + 0.5 * size * error, logit), clean + size * noise, clean
        )[1]
        for relative in (False, True)
        for size in (1.0, 6.0)
    }
    for part in ("depth", "slope"):
        assert parts[True, 6.0][part] == pytest.approx(float(parts[True, 1.0][part]), rel=1e-3)
        assert parts[False, 6.0][part] > 5 * parts[False, 1.0][part]
