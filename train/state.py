"""What a training is made of between two steps, and how it goes into a checkpoint and out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.optim import Optimizer
from torch.optim.swa_utils import AveragedModel

from glsim.errors import ConfigError, TrainError
from glsim.train.losses import Loss, build_loss
from glsim.train.models.base import DepthModel
from glsim.train.recipe import OptimiserSettings, Recipe


@dataclass
class Progress:
    """How far a training is.

    epoch: whole epochs done. step: steps done of the next. steps: of all. seconds: of training and
    validation, over all resumes. best, best_step: of the monitored figure, and when. stale:
    validations since. loss_sum, loss_count: of the steps since the last validation.
    """

    epoch: int = 0
    step: int = 0
    steps: int = 0
    seconds: float = 0.0
    best: float | None = None
    best_step: int = 0
    stale: int = 0
    loss_sum: float = 0.0
    loss_count: int = 0


class State:
    """Network, its average over time, optimiser, loss and progress of a recipe from its seed.

    network: the plain module. model: what a training step calls, on its device, with mixed
    precision. judged: the module that is validated and kept.
    """

    def __init__(self, recipe: Recipe, fabric: Fabric) -> None:
        """Raises ConfigError for a model or loss that there is not, or that cannot be monitored."""
        from glsim.train.models.registry import build_model

        torch.manual_seed(recipe.seed)
        self._fabric = fabric
        self.progress = Progress()
        self.loss: Loss = build_loss(recipe.loss)
        if recipe.training.monitor == "loss" and not self.loss.judges:
            raise ConfigError(
                f"training.monitor = 'loss': {recipe.loss['kind']} compares with the noisy depth, "
                "and returning that would be best: set training.monitor = 'interior_rmse_mm'"
            )
        self.network: DepthModel = build_model(recipe.model).to(memory_format=torch.channels_last)
        self.average = _average(self.network, recipe.training.ema_decay)
        self._plain_optimiser = _optimiser(self.network, recipe.optimiser)
        self._compile = recipe.training.compile

    @property
    def judged(self) -> nn.Module:
        """The average, if one is kept."""
        return self.network if self.average is None else self.average.module

    def set_up(self) -> tuple[nn.Module, Optimizer]:
        """Model and optimiser as a training step uses them. Call it after ``restore``."""
        module = torch.compile(self.network) if self._compile else self.network
        if self.average is not None:
            self.average.to(self._fabric.device)
        model, optimiser = self._fabric.setup(module, self._plain_optimiser)
        return model, optimiser

    def stepped(self) -> None:
        """After each step of the optimiser."""
        if self.average is not None:
            self.average.update_parameters(self.network)

    def finite(self) -> bool:
        """No weight is nan or infinite."""
        return all(bool(p.isfinite().all()) for p in self.network.state_dict().values())

    def weights(self) -> dict[str, Tensor]:
        """Those that are validated and kept, on the CPU."""
        return {name: value.cpu() for name, value in self.judged.state_dict().items()}

    def dump(self) -> dict[str, Any]:
        """All that a resumed training needs besides recipe and data."""
        return {
            "model": self.network.state_dict(),
            "average": None if self.average is None else self.average.state_dict(),
            "optimiser": self._plain_optimiser.state_dict(),
            "scaler": self._fabric.strategy.precision.state_dict(),
            "rng": {"cpu": torch.get_rng_state(), "cuda": torch.cuda.get_rng_state_all()},
            "progress": asdict(self.progress),
        }

    def restore(self, content: dict[str, Any]) -> None:
        """From ``dump``. Raises TrainError if the weights are those of another network."""
        try:
            self.network.load_state_dict(content["model"])
            if self.average is not None:
                self.average.load_state_dict(content["average"])
            self._plain_optimiser.load_state_dict(content["optimiser"])
            self._fabric.strategy.precision.load_state_dict(content["scaler"])
            torch.set_rng_state(content["rng"]["cpu"])
            if len(content["rng"]["cuda"]) == torch.cuda.device_count():
                torch.cuda.set_rng_state_all(content["rng"]["cuda"])
            self.progress = Progress(**content["progress"])
        except (RuntimeError, KeyError, TypeError, ValueError) as error:
            reason = " ".join(str(error).split())[:200]
            raise TrainError(f"the checkpoint does not fit its recipe: {reason}") from None


def _optimiser(network: nn.Module, settings: OptimiserSettings) -> Optimizer:
    kind = {"adam": torch.optim.Adam, "adamw": torch.optim.AdamW}[settings.kind]
    return kind(network.parameters(), lr=settings.lr, weight_decay=settings.weight_decay)


def _average(network: nn.Module, decay: float | None) -> AveragedModel | None:
    """Exponential, with buffers as they are in the network itself."""
    if decay is None:
        return None

    def move(averages: Sequence[Tensor], weights: Sequence[Tensor], count: Tensor) -> None:
        # The first weights would dominate a short training: the average grows with its age.
        share = min(decay, (1 + int(count)) / (10 + int(count)))
        torch._foreach_lerp_(averages, weights, 1 - share)

    return AveragedModel(network, multi_avg_fn=move)
