"""The training loop: steps, validation, early stopping, checkpoints; resumed bit for bit."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

import torch
from torch import Tensor
from torch.utils.data import DataLoader

from glsim.errors import ConfigError, TrainError
from glsim.stable import stable_seed
from glsim.train import checkpoint
from glsim.train.feed import VALIDATION_BATCH, Feed
from glsim.train.logs import RUN, Logs, write_json, write_samples
from glsim.train.models.calibration import calibrate
from glsim.train.models.mask_aware import MaskAware
from glsim.train.models.registry import parameter_count
from glsim.train.recipe import Recipe
from glsim.train.start import RECIPE, check_unused, last_checkpoint, make_fabric
from glsim.train.state import State
from glsim.train.validation import validate

NAN_BATCH: Final = "nan_batch.pt"
#: Frames in a picture of samples.
_SAMPLES: Final = 4


class Shown(NamedTuple):
    """For a progress bar. total: steps of the whole training, if something limits them.

    loss: of the last step. seconds: over all resumes. validation: figures, if it has just been.
    """

    epoch: int
    steps: int
    total: int | None
    share: float
    seconds: float
    loss: float
    validation: dict[str, float] | None


def fit(
    recipe: Recipe,
    feed: Feed,
    folder: Path,
    *,
    resume: bool = False,
    show: Callable[[Shown], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Train until a limit or early stopping ends it, or ``stop()`` is true after a step.

    Returns what RUN/run.json holds; its ``state`` is "finished" or "interrupted". An interrupted
    training that is resumed gives the bits of one that was not, on the CPU and without a limit of
    time. resume: go on from ``folder``'s last checkpoint, or start there if it has none.

    Raises TrainError (nan, a folder in use, a checkpoint of another recipe or other data, a full
    disk), ConfigError and DatasetError.
    """
    return Training(recipe, feed, folder, resume).run(show, stop)


class Training:
    """One run of ``fit``."""

    def __init__(self, recipe: Recipe, feed: Feed, folder: Path, resume: bool) -> None:
        self.recipe, self.feed, self.folder = recipe, feed, folder
        self.fabric = make_fabric(recipe.training)
        self.fabric.launch()
        if not resume and self.fabric.is_global_zero:
            check_unused(folder)
        last = last_checkpoint(folder, recipe, feed.fingerprint) if resume else None
        self.state = State(recipe, self.fabric)
        self.figures: dict[str, float] = {}
        if last is not None:
            self.state.restore(last)
            self.figures = dict(last["validation"])
        self.progress = self.state.progress
        self.model, self.optimiser = self.state.set_up()
        self.epoch_steps = feed.connect(self.fabric)
        held_out = DataLoader(feed.validation, VALIDATION_BATCH, generator=torch.Generator())
        self.held_out = self.fabric.setup_dataloaders(held_out, use_distributed_sampler=False)
        limits = recipe.training
        steps = [limits.max_steps, limits.max_epochs and limits.max_epochs * self.epoch_steps]
        self.total = min((count for count in steps if count), default=None)
        if recipe.schedule.kind != "constant" and not (self.total or limits.max_minutes):
            raise ConfigError(
                f"schedule.kind = {recipe.schedule.kind!r} must know the end: set "
                "training.max_epochs, or give --epochs, --steps or --minutes"
            )
        self._since = time.monotonic()

    def run(self, show: Callable[[Shown], None] | None, stop: Callable[[], bool]) -> dict[str, Any]:
        """To the end, or until ``stop()``."""
        logs = self._open_logs() if self.fabric.is_global_zero else None
        ended, stopped, loss = self.ended(), False, math.nan
        while not (ended or stopped):
            batches = self.feed.batches(self.progress.epoch, self.progress.step)
            for noisy_mm, clean_mm in batches:
                loss = self.step(noisy_mm, clean_mm)
                due = self._validation_is_due()
                if due:
                    self.validate(logs)
                if show is not None:
                    show(self._shown(loss, due))
                ended, stopped = self.fabric.broadcast((self.ended(), stop()))
                if ended or stopped:
                    break
                if due or self.progress.step == 0:
                    self.save("interrupted")
        if ended and self.progress.loss_count:  # a limit in the middle of an epoch
            self.validate(logs)
            if show is not None:
                show(self._shown(loss, True))
        if logs is not None:
            logs.close()
        return self.save("finished" if ended else "interrupted", ended)

    def step(self, noisy_mm: Tensor, clean_mm: Tensor) -> float:
        """One step of the optimiser; the loss before it."""
        progress, settings = self.progress, self.recipe.optimiser
        for group in self.optimiser.param_groups:
            group["lr"] = settings.lr * self.recipe.schedule.factor(progress.steps, self._share())
        self.model.train()
        draw = torch.Generator().manual_seed(
            stable_seed("step", self.recipe.seed, progress.steps, self.fabric.global_rank) >> 1
        )
        noisy_mm, clean_mm = (
            part.contiguous(memory_format=torch.channels_last) for part in (noisy_mm, clean_mm)
        )
        total, _ = self.state.loss.of_batch(self.model, noisy_mm, clean_mm, draw)
        loss = float(total.detach())
        if not math.isfinite(loss):
            self._give_up(noisy_mm, clean_mm, f"the loss is {loss}")
        self.optimiser.zero_grad()
        self.fabric.backward(total)
        if settings.clip_norm is not None:
            self.fabric.clip_gradients(
                self.model, self.optimiser, max_norm=settings.clip_norm, error_if_nonfinite=False
            )
        self.optimiser.step()
        self.state.stepped()
        progress.steps += 1
        progress.step += 1
        progress.loss_sum += loss
        progress.loss_count += 1
        if progress.step == self.epoch_steps:
            progress.epoch, progress.step = progress.epoch + 1, 0
            if not self.state.finite():
                self._give_up(noisy_mm, clean_mm, "a weight is nan or infinite")
        return loss

    def validate(self, logs: Logs | None) -> None:
        """Judge the weights, keep them if they are the best so far, leave figures and pictures."""
        progress, judged = self.progress, self.state.judged
        judged.eval()
        with self.fabric.autocast():
            self.figures = self.fabric.broadcast(validate(judged, self.held_out, self.state.loss))
        value = self.figures[self.recipe.training.monitor]
        if not math.isfinite(value):
            raise TrainError(
                f"{self.folder}: {self.recipe.training.monitor} of the validation is {value} after "
                f"step {progress.steps}: {self._kept()}; monitor another figure, or train slower "
                "(optimiser.lr)"
            )
        mean_loss = progress.loss_sum / max(progress.loss_count, 1)
        progress.loss_sum, progress.loss_count = 0.0, 0
        progress.stale += 1
        if progress.best is None or value < progress.best:
            progress.best, progress.best_step, progress.stale = value, progress.steps, 0
            if logs is not None:
                self._keep_best()
        if logs is not None:
            figures = {f"validation_{name}": number for name, number in self.figures.items()}
            lr = self.optimiser.param_groups[0]["lr"]
            row = {"epoch": progress.epoch, "loss": mean_loss, "lr": lr, "seconds": self._seconds()}
            logs.write(row | figures, progress.steps)
            self._draw_samples()

    def save(self, state: str, ended: str | None = None) -> dict[str, Any]:
        """last.pt and run.json, whose content is returned."""
        progress = self.progress
        progress.seconds, self._since = self._seconds(), time.monotonic()
        report = {
            "state": state,
            "ended": ended,
            "epochs": progress.epoch,
            "steps": progress.steps,
            "seconds": round(progress.seconds, 3),
            "best": {"monitor": self.recipe.training.monitor, "value": progress.best}
            | {"step": progress.best_step},
            "parameters": parameter_count(self.state.network),
            **self.recipe.model_dump(mode="json", include={"title", "row", "size", "seed"}),
            "data": self.feed.fingerprint,
        }
        if self.fabric.is_global_zero:
            checkpoint.save(self.folder / checkpoint.LAST, self._common() | self.state.dump())
            write_json(self.folder / RUN, report)
        return report

    def ended(self) -> str | None:
        """What has ended the training, if anything has."""
        limits, progress = self.recipe.training, self.progress
        if limits.patience is not None and progress.stale >= limits.patience:
            return "patience"
        if limits.max_steps is not None and progress.steps >= limits.max_steps:
            return "steps"
        if limits.max_epochs is not None and progress.epoch >= limits.max_epochs:
            return "epochs"
        if limits.max_minutes is not None and self._seconds() >= limits.max_minutes * 60:
            return "minutes"
        return None

    def _share(self) -> float:
        """Of the whole training; 0 if nothing but patience limits it."""
        minutes = self.recipe.training.max_minutes
        of_steps = self.progress.steps / self.total if self.total else 0.0
        return max(of_steps, self._seconds() / (minutes * 60) if minutes else 0.0)

    def _seconds(self) -> float:
        return float(self.progress.seconds + time.monotonic() - self._since)

    def _validation_is_due(self) -> bool:
        every, progress = self.recipe.training.validate_every, self.progress
        if self.recipe.training.validate_unit == "steps":
            return not progress.steps % every
        return not (progress.step or progress.epoch % every)

    def _common(self) -> dict[str, Any]:
        return {
            "recipe": self.recipe.model_dump(mode="json"),
            "data": self.feed.fingerprint,
            "validation": self.figures,
        }

    def _keep_best(self) -> None:
        judged = self.state.judged
        uncertain = isinstance(judged, MaskAware) and judged.uncertainty
        if uncertain:
            with suppress(ConfigError):  # an early network may call no pixel depth: no errors yet
                calibrate(judged, self.held_out, "median")
        content = self._common() | {
            "model": self.state.weights(),
            "progress": {"epoch": self.progress.epoch, "steps": self.progress.steps},
        }
        checkpoint.save(self.folder / checkpoint.BEST, content)
        if uncertain:
            judged.sigma_scale.fill_(1.0)  # training goes on without it

    def _give_up(self, noisy_mm: Tensor, clean_mm: Tensor, why: str) -> NoReturn:
        progress, path = self.progress, self.folder / NAN_BATCH
        batch = {"noisy_mm": noisy_mm.cpu(), "clean_mm": clean_mm.cpu()}
        checkpoint.write(path, batch | {"epoch": progress.epoch, "steps": progress.steps})
        raise TrainError(
            f"{why} at step {progress.steps + 1}: the batch is in {path}, {self._kept()}; look at "
            "it, or train slower (optimiser.lr), or clip (optimiser.clip_norm)"
        )

    def _kept(self) -> str:
        last = self.folder / checkpoint.LAST
        return f"the last good checkpoint is {last}" if last.exists() else "there is no checkpoint"

    def _open_logs(self) -> Logs:
        write_json(self.folder / RECIPE, self.recipe.model_dump(mode="json"))
        return Logs(self.folder, self.progress.steps)

    def _shown(self, loss: float, validated: bool) -> Shown:
        progress = self.progress
        how_far = progress.epoch, progress.steps, self.total, self._share(), self._seconds()
        return Shown(*how_far, loss, self.figures if validated else None)

    def _draw_samples(self) -> None:
        progress, frames = self.progress, self.held_out.dataset
        places = [len(frames) * n // _SAMPLES for n in range(min(_SAMPLES, len(frames)))]
        pairs = [frames[n] for n in places]
        noisy_mm, clean_mm = (torch.stack(part) for part in zip(*pairs, strict=True))
        with torch.no_grad(), self.fabric.autocast():
            denoised_mm = self.state.judged(self.fabric.to_device(noisy_mm)).hard_mm()
        name = f"epoch_{progress.epoch:04d}" if progress.step == 0 else f"step_{progress.steps:06d}"
        path = self.folder / "samples" / f"{name}.png"
        write_samples(path, list(zip(noisy_mm, denoised_mm, clean_mm, strict=True)))
