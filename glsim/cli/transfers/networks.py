"""The networks of ``glsim transfer``, given or trained, with their steps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from glsim.cli.transfers.steps import Step, StudyNetwork, StudyRun
from glsim.denoise import load_denoiser
from glsim.errors import CPU_TORCH, ConfigError, TrainError
from glsim.eval.transfer.cases import TrainingSet
from glsim.eval.transfer.study import TransferStudy

if TYPE_CHECKING:
    from glsim.train import Recipe


class Work(NamedTuple):
    """Groups of steps, each of which ends with new results; the networks, and notes on them."""

    groups: list[list[Step]]
    networks: list[StudyNetwork]
    notes: list[str]


def steps_of_given(run: StudyRun, specs: Sequence[str], composite: str) -> Work:
    """Return the work for given networks. Raises ConfigError, DenoiserError."""
    named: dict[str, str] = {}
    for spec in specs:
        load_denoiser(spec)  # raises its error before any work starts
        label, at, file = spec.rpartition("@")
        path = Path(file)
        name = label if at else path.parent.name if path.name == "best.pt" else path.stem
        name = re.sub(r"[^A-Za-z0-9._-]", "-", name) or "network"
        if name in (*named, "filters"):
            raise ConfigError(f"--network {spec}: name it another than {name}: LABEL@{file}")
        named[name] = file
    networks = [
        StudyNetwork(name, file, replace(case, title="-"), composite)
        for name, file in named.items()
        for case in run.cases
    ]
    groups = [list(run.test_steps()), *(list(run.network_steps(item)) for item in networks)]
    notes = [f"`{name}` is the network `{Path(file).name}`, given" for name, file in named.items()]
    return Work(groups, networks, notes)


def steps_of_trainings(run: StudyRun, composite: str) -> Work:
    """Return the work with a training for each training set.

    Raises ConfigError for a wrong recipe, TrainError without PyTorch.
    """
    recipe = _recipe(run.study)
    groups, networks, notes = [list(run.test_steps())], [], []
    for case in run.cases:
        training = case.training
        assert training is not None  # find_cases was asked for trainings
        network = StudyNetwork(training.name, str(run.checkpoint(training)), case, composite)
        networks.append(network)
        groups.append([*run.training_steps(training, recipe), *run.network_steps(network)])
        notes.append(_training_note(training, recipe))
    return Work(_once(groups), networks, list(dict.fromkeys(notes)))


def _once(groups: list[list[Step]]) -> list[list[Step]]:
    """Drop repeated steps from the groups: cases share data and runs."""
    seen: set[tuple[str, str]] = set()
    result = []
    for group in groups:
        fresh = [step for step in group if (step.kind, step.title) not in seen]
        seen |= {(step.kind, step.title) for step in fresh}
        result.append(fresh)
    return result


def _recipe(study: TransferStudy) -> Recipe:
    try:
        import glsim.train.loop  # noqa: F401 (is there PyTorch?)
    except ImportError as error:
        raise TrainError(
            "training needs PyTorch and Lightning Fabric: pip install 'glsim[train]' "
            f"({CPU_TORCH}) ({error})"
        ) from None
    from glsim.train import load_recipe

    train = study.train
    limits = {
        "training": {"max_steps": train.steps},
        "data": {"crop": train.crop, "target": study.truth},
    }
    return load_recipe(train.recipe, train.set, limits)


def _training_note(training: TrainingSet, recipe: Recipe) -> str:
    sensors = ", ".join(sensor.name for sensor in training.sensors)
    faces = ", ".join(source.name for source in training.sources)
    return (
        f"`{training.name}`: {recipe.title}, {recipe.training.max_steps} steps on sensors "
        f"{sensors}; faces {faces}"
    )
