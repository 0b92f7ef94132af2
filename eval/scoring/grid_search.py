"""Grid search for the settings of classical filters on the validation split alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from glsim.data.progress import FrameProgress
from glsim.denoise.registry import CLEANUPS, GRIDS, tuning_specs
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import Evaluation, evaluate, write_csv

#: Target number of tuning frames, evenly spread over the split.
TUNING_FRAMES: Final = 150
#: Metric that chooses the settings of a filter: the interior error, on the same pixels for all
#: methods. Silhouettes are excluded: their errors are largest, and smoothing cannot reduce them.
SURFACE: Final = "input_interior_rmse_mm"
#: Metric that then chooses the window of the mask clean-up.
SILHOUETTE: Final = "flips_px"


@dataclass(frozen=True)
class Tuned:
    """The best settings of a filter without and with mask clean-up, in command-line syntax."""

    name: str
    plain: str
    cleaned: str


def tune_filters(
    job: ScoringJob, names: Sequence[str], out: Path, *, workers: int | None = None,
    progress: Callable[[FrameProgress], None] | None = None,
) -> list[Tuned]:  # fmt: skip
    """Score each filter's grid of settings on ``job.split``; write all trials to tuning.csv.

    The metric SURFACE chooses the filter's parameters, with the input's mask. Then SILHOUETTE
    chooses the window of the mask clean-up. Raises the errors of ``evaluate``.
    """
    names = [name for name in names if name in GRIDS]
    if not names:
        return []
    stride = max(1, len(job.frames()) // TUNING_FRAMES)

    def run(specs: list[str], stage: str) -> Evaluation:
        trial = replace(job, denoisers=tuple(specs), stride=stride)
        folder = out / "tuning" / stage
        return evaluate(trial, folder, workers=workers, baselines=False, progress=progress)

    by_name = {name: tuning_specs(name, (0,)) for name in names}
    first = run([spec for specs in by_name.values() for spec in specs], "parameters")

    def mean(evaluation: Evaluation, metric: str) -> Callable[[str], float]:
        return lambda spec: evaluation.summary.mean(spec, metric)

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
        (spec, int(spec in chosen), *(mean(evaluation, m)(spec) for m in (SURFACE, SILHOUETTE)))
        for evaluation in (first, second)
        for spec in evaluation.summary.methods
    ]
    write_csv(out / "tuning.csv", ("denoiser", "chosen", SURFACE, SILHOUETTE), rows)
    return tuned
