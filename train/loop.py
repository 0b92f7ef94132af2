"""Training loop: steps, validation, early stopping and checkpoints; resumes bit for bit."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

import torch
from lightning_fabric import Fabric
from torch import Tensor
from torch.utils.data import DataLoader

from glsim.core.depth_map import interior, jumps
from glsim.core.errors import ConfigError, TrainError
from glsim.core.files.atomic import json_text, write_atomic
from glsim.networks import checkpoint
from glsim.networks.interface import MIN_DEPTH_MM
from glsim.train.batches import VALIDATION_BATCH, BatchSource, on_device, spread
from glsim.train.data.stored import Batch
from glsim.train.logs import RUN_FILE, RunLogs, write_samples
from glsim.train.losses import Loss, to_float32
from glsim.train.models.base import Prediction
from glsim.train.models.mask_aware import MaskAware, calibrate
from glsim.train.models.registry import parameter_count
from glsim.train.recipe import RECIPE_FILE, Recipe
from glsim.train.run_setup import (
    arithmetic,
    continue_arithmetic,
    last_checkpoint,
    locked_run,
    make_fabric,
    read_start,
    with_precision,
)
from glsim.train.state import TrainingState

NAN_BATCH_FILE: Final = "nan_batch.pt"
#: Number of frames in each picture in samples/.
_SAMPLES: Final = 4
#: Largest share of a limit in minutes that one validation may take. Chosen, not measured.
_VALIDATION_SHARE: Final = 0.1


class StepStatus(NamedTuple):
    """Status of a training after a step, for a progress bar.

    ``total_steps``: None without a limit. ``fraction_done``: of the whole training; 0 if only
    patience limits it. ``seconds``: over all resumes. ``validation``: metrics, if it followed.
    """

    epoch: int
    steps: int
    total_steps: int | None
    fraction_done: float
    seconds: float
    loss: float
    validation: dict[str, float] | None


def fit(
    recipe: Recipe, source: BatchSource, folder: Path, *, resume: bool = False,
    on_step: Callable[[StepStatus], None] | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    announce: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:  # fmt: skip
    """Train a network until a limit, early stopping or ``should_stop`` ends the training.

    On the CPU and without a time limit, a resumed training gives the same bits as an uninterrupted
    one: it continues with the number of threads of its beginning.

    Args:
        should_stop: called after each step; True interrupts the training.
        announce: called with a line before a slow part: the first step, the first validation.

    Returns the content of FOLDER/run.json; its ``state`` is "finished" or "interrupted".

    Raises:
        TrainError: a loss or weight is not finite, the folder is in use, its checkpoint is of
            another recipe or other data, the disk is full.
        ConfigError: for a recipe that cannot be trained.
    """
    recipe = with_precision(recipe, folder / RECIPE_FILE if resume else None)
    fabric = make_fabric(recipe.training)
    with locked_run(folder):
        run = TrainingRun(recipe, source, folder, resume, fabric, announce)
        return run.train(on_step, should_stop)


class TrainingRun:
    """One call of ``fit``, with its device, state, data and run folder."""

    def __init__(
        self, recipe: Recipe, source: BatchSource, folder: Path, resume: bool, fabric: Fabric,
        announce: Callable[[str], None] = lambda _: None,
    ) -> None:  # fmt: skip
        self.recipe, self.source, self.folder, self.fabric = recipe, source, folder, fabric
        self._announce = announce
        if not resume and (folder / RECIPE_FILE).exists():
            other = "continue it with --resume, or name another folder (-o)"
            raise TrainError(f"{folder}: holds a training: {other}")
        last = last_checkpoint(folder, recipe, source.fingerprint) if resume else None
        if resume and last is None:
            announce(f"{folder}: holds no training to go on with: begins anew")
        weights, self.start = None, last and last.get("start")
        if last is None and (start := recipe.training.start) is not None:
            weights, self.start = read_start(start, recipe.model)
        self.state = TrainingState(recipe, fabric, weights)
        self.figures: dict[str, float] = {}
        if last is not None:
            self.state.restore(last)
            self.figures = dict(last["validation"])
            continue_arithmetic(last["arithmetic"], fabric, folder / checkpoint.LAST)
        self.arithmetic = arithmetic(fabric)
        self.progress = self.state.progress
        self.model, self.optimiser = self.state.set_up()
        self.epoch_steps = source.prepare(self.fabric)
        limits = recipe.training
        frames = spread(source.validation) if limits.max_minutes else source.validation
        held_out = DataLoader(frames, VALIDATION_BATCH, generator=torch.Generator())
        self.held_out = on_device(self.fabric, held_out)
        steps = [limits.max_steps, limits.max_epochs and limits.max_epochs * self.epoch_steps]
        self.total_steps = min((count for count in steps if count), default=None)
        if recipe.schedule.kind != "constant" and not (self.total_steps or limits.max_minutes):
            raise ConfigError(
                f"schedule.kind = {recipe.schedule.kind!r} must know the end: set "
                "training.max_epochs, or give --steps or --minutes"
            )
        self._since: float | None = None  # None: set-up and the first batch take no training time
        announce(
            f"{self.epoch_steps} batches of {limits.batch} in an epoch, {len(frames)} frames to "
            f"validate, {limits.precision} on {self.arithmetic['device']}"
        )

    def train(
        self, on_step: Callable[[StepStatus], None] | None, should_stop: Callable[[], bool]
    ) -> dict[str, Any]:
        """Run steps until the training ends; return the content of run.json."""
        write_atomic(json_text(self.recipe.model_dump(mode="json")), self.folder / RECIPE_FILE)
        logs = RunLogs(self.folder, self.progress.steps)
        show = on_step or (lambda _: None)
        ended_by, stopped, loss = self.ended_by(), False, math.nan
        while not (ended_by or stopped):
            for noisy_mm, clean_mm in self.source.batches(self.progress.epoch, self.progress.step):
                loss = self.step(noisy_mm, clean_mm)
                every, progress = self.recipe.training.validate_every, self.progress
                if self.recipe.training.validate_unit == "steps":
                    validated = not progress.steps % every
                else:
                    validated = not (progress.step or progress.epoch % every)
                if validated:
                    self.validate(logs)
                show(self.status(loss, validated))
                ended_by, stopped = self.ended_by(), should_stop()
                if ended_by or stopped:
                    break
                if validated or self.progress.step == 0:
                    self.save("interrupted")
        if ended_by and self.progress.loss_count:  # some steps were not validated yet
            self.validate(logs)
            show(self.status(loss, True))
        logs.close()
        return self.save("finished" if ended_by else "interrupted", ended_by)

    def step(self, noisy_mm: Tensor, clean_mm: Tensor) -> float:
        """Run one optimiser step; return the loss before the step."""
        if self._since is None:
            self._since = time.monotonic()
        progress, settings = self.progress, self.recipe.optimiser
        for group in self.optimiser.param_groups:
            factor = self.recipe.schedule.factor(progress.steps, self._fraction_done())
            group["lr"] = settings.lr * factor
        self.model.train()
        noisy_mm, clean_mm = (
            depth_mm.contiguous(memory_format=torch.channels_last)
            for depth_mm in (noisy_mm, clean_mm)
        )
        noisy_mm, clean_mm = self.state.loss.batch(noisy_mm, clean_mm)
        total, _ = self.state.loss(to_float32(self.model(noisy_mm)), noisy_mm[:, :1], clean_mm)
        loss = float(total.detach())
        if not math.isfinite(loss):
            self._fail(noisy_mm, clean_mm, f"the loss is {loss}")
        self.optimiser.zero_grad()
        self.fabric.backward(total)
        if settings.clip_norm is not None:
            self.fabric.clip_gradients(
                self.model, self.optimiser, max_norm=settings.clip_norm, error_if_nonfinite=False
            )
        self.optimiser.step()
        if self.state.average is not None:
            self.state.average.update_parameters(self.state.network)
        progress.steps += 1
        progress.step += 1
        progress.loss_sum += loss
        progress.loss_count += 1
        if progress.step == self.epoch_steps:
            progress.epoch, progress.step = progress.epoch + 1, 0
            weights = self.state.network.state_dict().values()
            if not all(bool(weight.isfinite().all()) for weight in weights):
                self._fail(noisy_mm, clean_mm, "a weight is nan or infinite")
        return loss

    def validate(self, logs: RunLogs) -> None:
        """Compute the validation metrics; save the best weights; log metrics and samples.

        Raises TrainError if the monitored metric is not finite.
        """
        progress, network = self.progress, self.state.evaluated
        if progress.best is None:
            self._announce(f"step {progress.steps}: first validation")
        network.eval()
        with self.fabric.autocast():
            batches = self._validation_batches()
            self.figures = validation_figures(network, batches, self.state.loss)
        value = self.figures[self.recipe.training.monitor]
        if not math.isfinite(value):
            raise TrainError(
                f"{self.folder}: {self.recipe.training.monitor} of the validation is {value} after "
                f"step {progress.steps}: {self._checkpoint_note()}; monitor another figure, or "
                "lower the learning rate (optimiser.lr)"
            )
        mean_loss = progress.loss_sum / max(progress.loss_count, 1)
        progress.loss_sum, progress.loss_count = 0.0, 0
        progress.stale += 1
        if progress.best is None or value < progress.best:
            progress.best, progress.best_step, progress.stale = value, progress.steps, 0
            self._save_best()
        figures = {f"validation_{name}": number for name, number in self.figures.items()}
        lr = self.optimiser.param_groups[0]["lr"]
        row = {"epoch": progress.epoch, "loss": mean_loss, "lr": lr, "seconds": self._seconds()}
        logs.write(row | figures, progress.steps)
        self._draw_samples()

    def _validation_batches(self) -> Iterator[Batch]:
        """Yield the batches for a validation, the same each time.

        With a limit in minutes, the first validation counts the batches that fit its share of time.
        """
        progress, minutes = self.progress, self.recipe.training.max_minutes
        until = time.monotonic() + _VALIDATION_SHARE * 60 * minutes if minutes else math.inf
        wanted = progress.validation_batches
        for done, batch in enumerate(islice(self.held_out, wanted), 1):
            yield batch
            if wanted is None and (time.monotonic() > until or done == len(self.held_out)):
                if minutes:
                    progress.validation_batches = done
                return

    def ended_by(self) -> str | None:
        """Name the limit that ended the training (patience, steps, epochs, minutes), if any."""
        limits, progress = self.recipe.training, self.progress
        reached = {
            "patience": (progress.stale, limits.patience),
            "steps": (progress.steps, limits.max_steps),
            "epochs": (progress.epoch, limits.max_epochs),
            "minutes": (self._seconds() / 60, limits.max_minutes),
        }
        ends = (name for name, (now, end) in reached.items() if end is not None and now >= end)
        return next(ends, None)

    def save(self, state: str, ended_by: str | None = None) -> dict[str, Any]:
        """Write last.pt and run.json; return the content of run.json."""
        progress = self.progress
        progress.seconds = self._seconds()
        self._since = None if self._since is None else time.monotonic()
        report = {
            "state": state,
            "ended": ended_by,
            "epochs": progress.epoch,
            "steps": progress.steps,
            "seconds": round(progress.seconds, 3),
            "best": {"monitor": self.recipe.training.monitor, "value": progress.best}
            | {"step": progress.best_step},
            "validation": self.figures,
            "parameters": parameter_count(self.state.network),
            **self.recipe.model_dump(mode="json", include={"title", "row", "size", "seed"}),
            "data": self.source.fingerprint,
            "start": self.start,
        }
        checkpoint.save(self.folder / checkpoint.LAST, self._header() | self.state.dump())
        write_atomic(json_text(report), self.folder / RUN_FILE)
        return report

    def status(self, loss: float, validated: bool) -> StepStatus:
        """Return the status of the training after a step with this loss."""
        return StepStatus(
            epoch=self.progress.epoch, steps=self.progress.steps, total_steps=self.total_steps,
            fraction_done=self._fraction_done(), seconds=self._seconds(), loss=loss,
            validation=self.figures if validated else None,
        )  # fmt: skip

    def _fraction_done(self) -> float:
        """Fraction of the training that is done; 0 if only patience limits it."""
        minutes = self.recipe.training.max_minutes
        of_steps = self.progress.steps / self.total_steps if self.total_steps else 0.0
        return max(of_steps, self._seconds() / (minutes * 60) if minutes else 0.0)

    def _seconds(self) -> float:
        running = 0.0 if self._since is None else time.monotonic() - self._since
        return float(self.progress.seconds + running)

    def _header(self) -> dict[str, Any]:
        return {
            "recipe": self.recipe.model_dump(mode="json"),
            "data": self.source.fingerprint,
            "validation": self.figures,
            "start": self.start,
            "arithmetic": self.arithmetic,
        }

    def _save_best(self) -> None:
        """Write best.pt; calibrate sigma on the validation frames first, if it is predicted."""
        network = self.state.evaluated
        if isinstance(network, MaskAware) and network.uncertainty:
            with suppress(ConfigError):  # early in training no pixel may have predicted depth
                calibrate(network, self._validation_batches())
        content = self._header() | {
            "model": {name: value.cpu() for name, value in network.state_dict().items()},
            "progress": {"epoch": self.progress.epoch, "steps": self.progress.steps},
        }
        checkpoint.save(self.folder / checkpoint.BEST, content)
        if isinstance(network, MaskAware) and network.uncertainty:
            network.sigma_scale.fill_(1.0)  # training continues uncalibrated

    def _draw_samples(self) -> None:
        progress, frames = self.progress, self.source.validation
        indices = [len(frames) * n // _SAMPLES for n in range(min(_SAMPLES, len(frames)))]
        pairs = [frames[n] for n in indices]
        noisy_mm, clean_mm = (torch.stack(depths) for depths in zip(*pairs, strict=True))
        with torch.no_grad(), self.fabric.autocast():
            denoised_mm = self.state.evaluated(self.fabric.to_device(noisy_mm)).hard_mm()
        name = f"epoch_{progress.epoch:04d}" if progress.step == 0 else f"step_{progress.steps:06d}"
        path = self.folder / "samples" / f"{name}.png"
        write_samples(path, list(zip(noisy_mm[:, :1], denoised_mm, clean_mm, strict=True)))

    def _fail(self, noisy_mm: Tensor, clean_mm: Tensor, reason: str) -> NoReturn:
        """Write the failing batch to nan_batch.pt and raise TrainError."""
        progress, path = self.progress, self.folder / NAN_BATCH_FILE
        batch = {"noisy_mm": noisy_mm.cpu(), "clean_mm": clean_mm.cpu()}
        checkpoint.write(path, batch | {"epoch": progress.epoch, "steps": progress.steps})
        raise TrainError(
            f"{reason} at step {progress.steps + 1}: the batch is in {path}, "
            f"{self._checkpoint_note()}; inspect it, or lower the learning rate (optimiser.lr), or "
            "clip gradients (optimiser.clip_norm)"
        )

    def _checkpoint_note(self) -> str:
        last = self.folder / checkpoint.LAST
        return f"the last good checkpoint is {last}" if last.exists() else "there is no checkpoint"


@torch.no_grad()
def validation_figures(
    model: Callable[[Tensor], Prediction], batches: Iterable[tuple[Tensor, Tensor]], loss: Loss
) -> dict[str, float]:
    """Compute the validation metrics of a network (lower is better); NaN for undefined metrics.

    Args:
        model: the network, in evaluation mode.
        batches: (noisy_mm, clean_mm), (B, C, H, W) and (B, 1, H, W).

    Returns:
        loss: mean of the training loss.
        mse_mm2: mean squared error of all pixels; pixels predicted invalid count as 0.
        interior_rmse_mm: RMSE where both have depth, more than 3 px from an edge of the truth.
        flips: number of pixels per frame with wrong validity.
        input_interior_rmse_mm, input_flips: the two metrics above for the noisy input.
    """

    def surface(depth_mm: Tensor, clean_mm: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        inside = interior(clean_mm > 0, jumps(clean_mm)) & (depth_mm > 0)
        square_mm2 = (depth_mm - clean_mm).double().square()[inside].sum()
        flips = ((depth_mm > 0) != (clean_mm > 0)).sum().double()
        return square_mm2, inside.sum().double(), flips

    sums = []
    for noisy_mm, clean_mm in batches:
        prediction = to_float32(model(noisy_mm))
        hard_mm = prediction.hard_mm()
        hard_mm = torch.where(hard_mm >= MIN_DEPTH_MM, hard_mm, 0.0)
        frames = hard_mm.new_tensor(len(clean_mm), dtype=torch.float64)
        parts = (
            loss(prediction, noisy_mm[:, :1], clean_mm)[0].double() * frames,
            (hard_mm - clean_mm).double().square().sum(), frames * clean_mm[0].numel(), frames,
            *surface(hard_mm, clean_mm), *surface(noisy_mm[:, :1], clean_mm),
        )  # fmt: skip
        sums.append(torch.stack(parts))
    total, squares, pixels, frames, *surfaces = torch.stack(sums).sum(0)
    figures = {"loss": total / frames, "mse_mm2": squares / pixels}
    for of, (inner, inner_pixels, flips) in (("", surfaces[:3]), ("input_", surfaces[3:])):
        figures[f"{of}interior_rmse_mm"] = (inner / inner_pixels).sqrt()
        figures[f"{of}flips"] = flips / frames
    return {name: float(value) for name, value in figures.items()}
