"""Estimate the hours that a plan trains, from steps that are timed on this machine."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from glsim.cli.common import overrides, print_message
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.train.recipe import Recipe


@dataclass(frozen=True)
class _Training:
    """A recipe with the limits of the plan, and its title in messages."""

    recipe: Recipe
    title: str

    def steps(self, images: int | None) -> int | None:
        """Return how many steps it can take at most.

        Args:
            images: images to train on; None if unknown.

        Returns:
            None if only patience or a time limits it.
        """
        limits = self.recipe.training
        epochs = images and limits.max_epochs and limits.max_epochs * -(-images // limits.batch)
        return min((count for count in (limits.max_steps, epochs) if count), default=None)


def print_hours(commands: Sequence[Sequence[str]], glsim: Any, images: int | None) -> None:
    """Measure the steps of each recipe and print the hours of its trainings, at most.

    Patience may end a training earlier. Data, validations and scoring are not counted.

    Args:
        commands: of the plan; those that train are looked at.
        glsim: the root command, whose parser reads the options.
        images: images to train on; None if unknown.
    """
    counts = Counter(
        _without_place(command) for command in commands if command and command[0] == "train"
    )
    try:
        from glsim.train.step_time import device_name, seconds_per_step
    except ImportError:
        print_message("hours: need PyTorch: pip install 'glsim[train]'")
        return
    kinds = f"{len(counts)} kinds of training on {device_name()}"
    print_message(f"measuring {kinds} (--no-hours: not)")
    total = 0.0
    for words, count in counts.items():
        training = _parse(words, glsim)
        steps = training.steps(images)
        seconds = seconds_per_step(training.recipe)
        line = f"{training.title}: {count} trainings, {1 / seconds:.3g} steps a second"
        if steps is None:
            print_message(f"{line}, no limit of steps")
            continue
        hours = count * steps * seconds / 3600
        total += hours
        print_message(f"{line}, at most {steps:,} steps each: {_hours(hours)}")
    print_message(f"all trainings: at most {_hours(total)}, without data, validation and scoring")


def _hours(hours: float) -> str:
    return f"{hours:.1f} h" if hours >= 1 else f"{math.ceil(60 * hours)} min"


def _without_place(command: Sequence[str]) -> tuple[str, ...]:
    """Return the arguments of a training that decide its time: no seed, folder or data."""
    words, kept = iter(command[1:]), []
    for word in words:
        if word in ("--seed", "--data", "-o", "--protocol"):
            next(words)
        elif word != "--resume":
            kept.append(word)
    return tuple(kept)


def _parse(words: Sequence[str], glsim: Any) -> _Training:
    """Read the recipe and its limits as ``glsim train`` does. Raises ConfigError."""
    from glsim.train.recipe import load_recipe

    command = glsim.get_command(typer.Context(glsim), "train")
    given = command.make_context("train", list(words)).params
    if given["recipe"] is None:
        raise ConfigError("a training of the plan has no recipe")
    limits = overrides(
        training__max_minutes=given["minutes"],
        training__max_epochs=given["epochs"],
        training__max_steps=given["steps"],
    )
    recipe = load_recipe(given["recipe"], given["assignment"] or (), limits)
    return _Training(recipe, f"{recipe.row or recipe.title} ({given['recipe']})")
