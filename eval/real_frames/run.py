"""Score denoisers on every frame of a recording, in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from glsim.bench.measures.boards import find_board
from glsim.core.errors import ConfigError, DenoiserError
from glsim.data.recordings.opencv_yaml import board_corners
from glsim.data.worker_processes import available_workers, run_tasks
from glsim.denoise import Denoiser, load_denoiser
from glsim.eval.real_frames.frame_truth import FrameTruth, ScoredFrame
from glsim.eval.real_frames.results import RealScores, add_up
from glsim.eval.real_frames.split import Source, SplitRecording, split_recording
from glsim.eval.scoring.blocks import warned_already
from glsim.eval.scoring.run import ScoringProgress

#: Label of the first row, the raw frames.
RAW = "raw"


@dataclass(frozen=True)
class RealJob:
    """The task of a worker; ``denoisers`` are specs of ``glsim.denoise.load``."""

    source: Source
    denoisers: tuple[str, ...]
    pairs_only: bool = False

    def run(self, numbers: Iterator[int]) -> Iterator[ScoredFrame]:
        """Score the frames ``numbers``: the job of a worker."""
        with warned_already():
            recording = split_recording(self.source)
            methods = [load_denoiser(spec) for spec in self.denoisers]
            for number in numbers:
                yield score_frame(recording, number, methods, self.pairs_only)

    def doing(self, number: int) -> str:
        """Name a frame by its number."""
        return f"scoring frame {number}"


def score_frame(
    recording: SplitRecording, number: int, methods: Sequence[Denoiser], pairs_only: bool = False
) -> ScoredFrame:
    """Denoise one frame by every method and measure the maps.

    Raises DenoiserError, naming method and frame, if a denoiser fails.
    """
    frame = recording.frames[number]
    board = None
    if not pairs_only:
        source = recording.source
        corners = board_corners(frame, source.path, source.pattern)
        board = None if corners is None else find_board(frame, corners, source.pattern)
    partner = recording.partner.get(number)
    truth = FrameTruth(
        frame,
        None if partner is None else recording.frames[partner],
        None if partner is None else recording.units(number),
        board,
        pairs_only,
    )
    raw = np.nan_to_num(frame.measured_mm)
    tallies = {RAW: truth.tally(raw)}
    for method in methods:
        try:
            parts = method.estimate(raw[None]).composites()
        except Exception as error:  # any error of a denoiser
            text = str(error).removeprefix(f"{method.label}: ")
            raise DenoiserError(f"{method.label}: frame {frame.name}: {text}") from error
        for part, depth in parts.items():
            name = f"{method.label} [{part}]" if part else method.label
            tallies[name] = truth.tally(depth)
    return ScoredFrame(
        number, tallies, truth.own_losses(), None if board is None else board.distance_mm
    )


def score_recording(
    recording: SplitRecording,
    denoisers: Sequence[str],
    *,
    scoring_half: bool = False,
    workers: int | None = None,
    progress: Callable[[ScoringProgress], None] | None = None,
) -> RealScores:
    """Score denoisers beside the raw frames.

    Args:
        recording: to score on.
        denoisers: specs of ``glsim.denoise.load``.
        scoring_half: use the half of the static pairs that ``tune_on_pairs`` has not seen.
        workers: number of processes; default: one per core.
        progress: called after each frame.

    Raises:
        ConfigError: a denoiser is wrong or given twice.
        DenoiserError: a denoiser fails on a frame.

    """
    methods = [
        load_denoiser(spec) for spec in denoisers
    ]  # reports wrong ones before scoring starts
    labels = [RAW, *(method.label for method in methods)]
    if len(set(labels)) != len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise ConfigError(f"--denoiser {twice}: is given twice: name one of them label@{twice}")
    numbers = list(range(len(recording.frames)))
    scored = run_frames(RealJob(recording.source, tuple(denoisers)), numbers, workers, progress)
    versions = {method.label: method.version for method in methods}
    chosen = (lambda unit: not recording.is_tuning_unit(unit)) if scoring_half else None
    return add_up(recording, scored, versions, chosen)


def run_frames(
    job: RealJob,
    numbers: Sequence[int],
    workers: int | None,
    progress: Callable[[ScoringProgress], None] | None,
) -> list[ScoredFrame]:
    """Score the frames ``numbers``; return them in order."""
    found = []
    processes = min(workers or available_workers(), len(numbers))
    for frame in run_tasks(job, numbers, processes):
        found.append(frame)
        if progress is not None:
            progress(ScoringProgress(len(found), len(numbers), 0, 0))
    return sorted(found, key=lambda frame: frame.number)
