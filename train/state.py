"""State of a training between two steps, as saved in a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, cast

import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.optim import Optimizer
from torch.optim.swa_utils import AveragedModel

from glsim.core.errors import ConfigError, TrainError
from glsim.train.losses import Loss, build_loss
from glsim.train.models.base import DepthModel, channels_last
from glsim.train.models.registry import build_model
from glsim.train.recipe import Recipe

_Tensors = list[Tensor] | tuple[Tensor, ...]


class WeightsOf(NamedTuple):
    """Weights of a network by name, and the name of their file."""

    file: str
    values: Mapping[str, Tensor]


@dataclass
class TrainingProgress:
    """Counters of a training: ``step`` of the epoch, ``steps`` and ``seconds`` over all resumes.

    ``stale`` counts validations since the best; ``loss_sum`` is over ``loss_count`` steps since the
    last. A limit in minutes bounds ``validation_batches``.
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
    validation_batches: int | None = None


class TrainingState:
    """Network, weight average, optimiser, loss and progress, built from a recipe and its seed.

    ``network`` is without the wrappers of devices and compilation, ``average`` of its weights.
    """

    def __init__(self, recipe: Recipe, fabric: Fabric, weights: WeightsOf | None = None) -> None:
        """Build the state before the first step, with ``weights`` or random weights."""
        torch.manual_seed(recipe.seed)
        self._fabric = fabric
        self.progress = TrainingProgress()
        self.loss: Loss = build_loss(recipe.loss)
        self.network: DepthModel = channels_last(build_model(recipe.model))
        if weights is not None:
            copy_weights(weights.values, self.network, weights.file)
        self.average = _weight_average(self.network, recipe.training.ema_decay)
        settings = recipe.optimiser
        kind = torch.optim.Adam if settings.kind == "adam" else torch.optim.AdamW
        self._plain_optimiser = kind(
            self.network.parameters(), lr=settings.lr, weight_decay=settings.weight_decay
        )
        self._compile = recipe.training.compile

    @property
    def evaluated(self) -> DepthModel:
        """Network to validate and save: the weight average if there is one."""
        return self.network if self.average is None else cast(DepthModel, self.average.module)

    def set_up(self) -> tuple[nn.Module, Optimizer]:
        """Move model and optimiser to their device and precision; call it after ``restore``."""
        module: nn.Module = self.network
        if self._compile:
            module = cast(nn.Module, torch.compile(module))
        if self.average is not None:
            self.average.to(self._fabric.device)
        model, optimiser = self._fabric.setup(module, self._plain_optimiser)
        return model, optimiser

    def dump(self) -> dict[str, Any]:
        """Return the state that a resumed training needs besides recipe and data."""
        return {
            "model": self.network.state_dict(),
            "average": None if self.average is None else self.average.state_dict(),
            "optimiser": self._plain_optimiser.state_dict(),
            "scaler": self._fabric.strategy.precision.state_dict(),
            "rng": {"cpu": torch.get_rng_state(), "cuda": torch.cuda.get_rng_state_all()},
            "progress": asdict(self.progress),
        }

    def restore(self, content: dict[str, Any]) -> None:
        """Load a state from ``dump``. Raises TrainError if it belongs to another network."""
        try:
            self.network.load_state_dict(content["model"])
            if self.average is not None:
                self.average.load_state_dict(content["average"])
            self._plain_optimiser.load_state_dict(content["optimiser"])
            self._fabric.strategy.precision.load_state_dict(content["scaler"])
            torch.set_rng_state(content["rng"]["cpu"])
            if len(content["rng"]["cuda"]) == torch.cuda.device_count():
                torch.cuda.set_rng_state_all(content["rng"]["cuda"])
            self.progress = TrainingProgress(**content["progress"])
        except (RuntimeError, KeyError, TypeError, ValueError) as error:
            reason = " ".join(str(error).split())[:200]
            raise TrainError(f"the checkpoint does not fit its recipe: {reason}") from None


def _weight_average(network: nn.Module, decay: float | None) -> AveragedModel | None:
    """Create an exponential average of the weights (buffers are copied); None without a decay."""
    if decay is None:
        return None

    def update(averages: _Tensors, weights: _Tensors, count: Tensor | int) -> None:
        # The decay grows to its value, so that the first weights do not dominate a short training.
        present_decay = min(decay, (1 + int(count)) / (10 + int(count)))
        torch._foreach_lerp_(averages, weights, 1 - present_decay)

    return AveragedModel(network, multi_avg_fn=update)


#: Buffers that describe a trained network; a new training does not copy them.
NOT_COPIED = ("sigma_scale",)


def copy_weights(weights: Mapping[str, Tensor], network: nn.Module, where: str) -> None:
    """Copy weights, by name and shape, into a network that has additional inputs.

    The weights of further input channels become 0, so that both networks give the same depth.
    Raises ConfigError, which names the file ``where``, if they differ in more than their inputs.
    """
    targets = network.state_dict()  # detached, and in the same memory as the parameters
    if odd := sorted((targets.keys() ^ weights.keys()) - set(NOT_COPIED)):
        raise ConfigError(
            f"{where}: is another architecture (it {'has' if odd[0] in weights else 'lacks'} "
            f"{odd[0]}): start from a network with the same [model], or without --from"
        )
    extended = []
    for name, target in targets.items():
        weight = weights.get(name)
        if name in NOT_COPIED or weight is None:
            continue
        inputs = weight.shape[1] if min(weight.dim(), target.dim()) > 1 else 0
        if weight.shape == target.shape:
            target.copy_(weight)
        elif inputs and target[:, :inputs].shape == weight.shape:
            target.zero_()
            target[:, :inputs].copy_(weight)
            extended.append(name)
        else:
            raise ConfigError(
                f"{where}: {name} is {tuple(weight.shape)}, this network needs "
                f"{tuple(target.shape)}: start from a network with the same [model.backbone]"
            )
    if len(extended) > 1:
        raise ConfigError(
            f"{where}: {', '.join(extended)} have fewer inputs than in this network: only its "
            "first layer may; start from a network with the same [model.backbone]"
        )
