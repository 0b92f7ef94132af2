"""Settings of the classical filters, chosen on the validation split alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from .blocks import Scoring
from .denoisers import GRIDS
from .denoisers.registry import CLEANUPS, grid
from .run import Evaluation, Progress, evaluate, write_csv

#: Frames that a filter is tuned on, evenly spread over the split.
MOST_FRAMES: Final = 150
#: What the settings minimise: the error of the surface on pixels that no method can choose and off
#: the silhouettes, whose errors are larger than all others and which no smoothing mends ...
SURFACE: Final = "input_interior_rmse_mm"
#: ... and then the window of the mask clean-up, with those settings.
SILHOUETTE: Final = "flips_px"


@dataclass(frozen=True)
class Tuned:
    """A filter's best settings, without and with mask clean-up, as on the command line."""

    name: str
    plain: str
    cleaned: str


def tune(
    job: Scoring,
    names: Sequence[str],
    out: Path,
    *,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> list[Tuned]:
    """Try the grid of each filter on ``job.split``; tuning.csv in ``out`` lists every trial.

    First the filter's own parameters by SURFACE with the input's mask, then the clean-up by
    SILHOUETTE. Raises what ``evaluate`` raises.
    """
    names = [name for name in names if name in GRIDS]
    if not names:
        return []
    stride = max(1, len(job.frames()) // MOST_FRAMES)

    def run(specs: list[str], stage: str) -> Evaluation:
        trial = replace(job, denoisers=tuple(specs), stride=stride)
        folder = out / "tuning" / stage
        return evaluate(trial, folder, workers=workers, probes=False, progress=progress)

    by_name = {name: grid(name, (0,)) for name in names}
    first = run([spec for specs in by_name.values() for spec in specs], "parameters")

    def mean(found: Evaluation, metric: str) -> Callable[[str], float]:
        return lambda spec: found.summary.mean(spec, metric)

    plain = {name: min(specs, key=mean(first, SURFACE)) for name, specs in by_name.items()}
    with_window = {
        name: [spec.replace("cleanup=0", f"cleanup={window}") for window in CLEANUPS]
        for name, spec in plain.items()
    }
    second = run([spec for specs in with_window.values() for spec in specs], "cleanup")
    tuned = [
        Tuned(name, plain[name], min(specs, key=mean(second, SILHOUETTE)))
        for name, specs in with_window.items()
    ]
    chosen = {spec for item in tuned for spec in (item.plain, item.cleaned)}
    rows = [
        {
            "denoiser": spec,
            "chosen": int(spec in chosen),
            SURFACE: mean(found, SURFACE)(spec),
            SILHOUETTE: mean(found, SILHOUETTE)(spec),
        }
        for found in (first, second)
        for spec in found.summary.methods
    ]
    write_csv(out / "tuning.csv", ("denoiser", "chosen", SURFACE, SILHOUETTE), rows)
    return tuned
