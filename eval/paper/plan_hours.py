"""Hours of a plan's trainings: timed on this machine, and estimated for GPUs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from glsim.eval.report.document import TextTable
from glsim.eval.report.score_tables import format_number
from glsim.settings.toml_tables import read_toml
from glsim.simulation.plan.split import PAPER_IMAGES
from glsim.train.recipe import Recipe

#: GPU -> 1e12 operations per second by its data sheet.
_GPUS: Final = read_toml(Path(__file__).with_name("gpu_rates.toml"))
#: Share of that rate that a training reaches. Chosen: small convolutions wait for memory.
_REACHED: Final = 0.3


def plan_hours(recipes: Iterable[Recipe], split: object, images: int) -> TextTable:
    """Return a row per network with its steps and hours at most, and the sums."""
    from glsim.train.step_cost import step_flop, step_seconds

    share = split[0] if isinstance(split, tuple) else PAPER_IMAGES[0] / sum(PAPER_IMAGES)
    trainings = Counter(recipe.title for recipe in recipes)
    rows: list[tuple[list[str], list[float]]] = []
    for title, recipe in {recipe.title: recipe for recipe in recipes}.items():
        limits, of_epochs = recipe.training, float("inf")
        if limits.max_epochs:
            of_epochs = limits.max_epochs * (images * share // limits.batch)
        steps = min(limits.max_steps or of_epochs, of_epochs)
        times = trainings[title] * steps / 3600
        seconds, flop = step_seconds(recipe), step_flop(recipe)
        hours = [times * seconds]
        hours += [times * flop / (_REACHED * 1e12 * rate) for rate in _GPUS.values()]
        rows.append(([title, str(trainings[title]), f"{steps:,.0f}", f"{seconds:.3g}"], hours))
    total = [sum(hours[place] for _, hours in rows) for place in range(1 + len(_GPUS))]
    rows.append((["all", str(trainings.total()), "", ""], total))
    head = ["training", "runs", "steps at most", "s a step here", "hours here, as busy as now"]
    texts = [[format_number(h) if h >= 0.005 else "<0.01" for h in hours] for _, hours in rows]
    cells = [[*names, *text] for (names, _), text in zip(rows, texts, strict=True)]
    return TextTable([*head, *(f"hours on a {gpu}" for gpu in _GPUS)], cells)
