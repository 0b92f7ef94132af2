"""Choose the settings of classical filters on one half of a recording's static pairs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from glsim.core.errors import ConfigError
from glsim.denoise import GRIDS
from glsim.denoise.registry import tuning_specs
from glsim.eval.real_frames.results import RealScores, add_up
from glsim.eval.real_frames.run import RealJob, run_frames
from glsim.eval.real_frames.split import SplitRecording
from glsim.eval.scoring.run import ScoringProgress

#: Most frames of static pairs that tuning denoises; chosen.
_TUNING_FRAMES = 12


def tune_on_pairs(
    recording: SplitRecording,
    names: Sequence[str] | None = None,
    *,
    workers: int | None = None,
    progress: Callable[[ScoringProgress], None] | None = None,
) -> tuple[list[str], RealScores]:
    """Choose settings of filters by ``pair_change`` on the half for tuning.

    Args:
        recording: with static pairs.
        names: filters of ``GRIDS``; default: all.
        workers: number of processes; default: one per core.
        progress: called after each frame.

    Returns:
        The best setting of each filter, as on the command line, and the scores of all.

    Raises:
        ConfigError: there are no static pairs.

    """
    numbers = sorted(recording.partner)
    if not numbers:
        raise ConfigError(
            f"--tune: {recording.source.path} has no two frames of one static view: give settings"
        )
    stride = max(1, len(numbers) // _TUNING_FRAMES)
    by_name = {name: tuning_specs(name, (0,)) for name in names or GRIDS}
    specs = tuple(spec for settings in by_name.values() for spec in settings)
    job = RealJob(recording.source, specs, pairs_only=True)
    scored = run_frames(job, numbers[::stride], workers, progress)
    scores = add_up(recording, scored, {}, recording.is_tuning_unit)

    def error(spec: str) -> float:
        change = scores.methods[spec].pair_change.value
        return math.inf if math.isnan(change) else change

    return [min(settings, key=error) for settings in by_name.values()], scores
