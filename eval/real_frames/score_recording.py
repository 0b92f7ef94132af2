"""Scoring of denoisers on all frames of a recording, and tuning of filters, in worker processes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from glsim.core.errors import ConfigError, DenoiserError
from glsim.data.progress import FrameProgress
from glsim.data.worker_processes import available_workers, run_tasks
from glsim.denoise.denoiser import Denoiser
from glsim.denoise.registry import GRIDS, load_denoiser, tuning_specs
from glsim.eval.real_frames.frame_truth import FrameTruth
from glsim.eval.real_frames.halves import Source, SplitRecording, split_recording
from glsim.eval.real_frames.totals import RealScores, ScoredFrame, add_up
from glsim.eval.scoring.blocks import labelled, warned_already
from glsim.eval.scoring.evaluate import load_methods

#: Label of the first row, the raw frames.
RAW = "raw"
#: Largest number of frames that tuning denoises. The value was chosen, not measured.
_TUNING_FRAMES = 12


@dataclass(frozen=True)
class RealJob:
    """The task of a worker process; ``denoisers`` are specifications for ``load_denoiser``."""

    source: Source
    denoisers: tuple[str, ...]
    pairs_only: bool = False

    def run(self, numbers: Iterator[int]) -> Iterator[ScoredFrame]:
        """Score the frames ``numbers`` in a worker process."""
        with warned_already():
            recording = split_recording(self.source)
            methods = [load_denoiser(spec) for spec in self.denoisers]
            for number in numbers:
                yield _score_frame(recording, number, methods, self.pairs_only)

    def doing(self, number: int) -> str:
        """Describe a frame by its number, for messages."""
        return f"scoring frame {number}"


def _score_frame(
    recording: SplitRecording, number: int, methods: Sequence[Denoiser], pairs_only: bool
) -> ScoredFrame:
    """Denoise one frame by every method and measure the maps; a failure names the method."""
    truth = FrameTruth(recording, number, pairs_only)
    raw = np.nan_to_num(truth.frame.measured_mm)
    tallies = {RAW: truth.tally(raw)}
    for method in methods:
        try:
            maps = labelled(method, method.estimate(raw[None]))
        except Exception as error:  # any error of a denoiser
            text = str(error).removeprefix(f"{method.label}: ")
            raise DenoiserError(f"{method.label}: frame {truth.frame.name}: {text}") from error
        tallies |= {name: truth.tally(depth) for name, depth in maps.items()}
    sensor_losses = np.zeros(4)
    if truth.partner is not None and not pairs_only:
        sensor_losses = truth.edge_sums(np.nan_to_num(truth.partner.measured_mm))[:4]
    return ScoredFrame(number, tallies, sensor_losses, truth.board is not None)


def score_recording(
    recording: SplitRecording, denoisers: Sequence[str], *, scoring_half: bool = False,
    workers: int | None = None, progress: Callable[[FrameProgress], None] | None = None,
) -> RealScores:  # fmt: skip
    """Score denoisers and the raw frames on a recording.

    ``scoring_half``: score only on static pairs that ``tune_on_pairs`` does not use.

    Raises ConfigError: a denoiser is wrong or given twice; DenoiserError: one fails on a frame.
    """
    methods = load_methods(denoisers, RAW)
    numbers = list(range(len(recording.frames)))
    scored = run_frames(RealJob(recording.source, tuple(denoisers)), numbers, workers, progress)
    versions = {method.label: method.version for method in methods}
    return add_up(recording, scored, versions, False if scoring_half else None)


def tune_on_pairs(
    recording: SplitRecording, names: Sequence[str] | None = None, *, workers: int | None = None,
    progress: Callable[[FrameProgress], None] | None = None,
) -> tuple[list[str], RealScores]:  # fmt: skip
    """Choose the filter settings with the best ``pair_change`` on the tuning half of the recording.

    Returns the best setting of each filter, as on the command line, and the scores of all settings.

    ``names`` are of ``GRIDS``, by default all. Raises ConfigError without static pairs.
    """
    numbers = sorted(recording.partner)
    if not numbers:
        path = recording.source.path
        raise ConfigError(
            f"--tune-filters: {path} has no two frames of one static view: give settings"
        )
    stride = max(1, len(numbers) // _TUNING_FRAMES)
    by_name = {name: tuning_specs(name, (0,)) for name in names or GRIDS}
    specs = tuple(spec for settings in by_name.values() for spec in settings)
    job = RealJob(recording.source, specs, pairs_only=True)
    scored = run_frames(job, numbers[::stride], workers, progress)
    scores = add_up(recording, scored, {}, tuning_half=True)
    changes = {spec: measures.pair_change.value for spec, measures in scores.methods.items()}
    # A NaN change (unknown) is never the smallest.
    best = [
        min(specs, key=lambda s: (math.isnan(changes[s]), changes[s])) for specs in by_name.values()
    ]
    return best, scores


def run_frames(
    job: RealJob,
    numbers: Sequence[int],
    workers: int | None,
    progress: Callable[[FrameProgress], None] | None,
) -> list[ScoredFrame]:
    """Score frames in worker processes; return the scores in order."""
    frames = []
    processes = min(workers or available_workers(), len(numbers))
    for frame in run_tasks(job, numbers, processes):
        frames.append(frame)
        if progress is not None:
            progress(FrameProgress(len(frames), len(numbers), 0))
    return sorted(frames, key=lambda frame: frame.number)
