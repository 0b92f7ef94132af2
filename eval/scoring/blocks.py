"""Scoring of a block of consecutive frames by every method, as one task of a worker process."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from glsim.core.array_types import Depth
from glsim.core.depth_frame import Frames
from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import DatasetError, DenoiserError
from glsim.denoise.denoiser import Denoiser, Estimate
from glsim.denoise.frames import Stacks
from glsim.denoise.registry import load_denoiser
from glsim.eval.metrics.frame_score import score
from glsim.eval.metrics.regions import Regions
from glsim.eval.metrics.scored_map import Truth
from glsim.eval.scoring.baselines import trivial_predictions
from glsim.eval.scoring.bias import BiasSums, add_bias, bias_bins
from glsim.eval.scoring.pairs import TruthLayer, open_frames
from glsim.networks.composites import COMPOSITES, DEFAULT_COMPOSITE

Row = dict[str, Any]


class FrameBlock(NamedTuple):
    """A block of consecutive frames, numbered first to first + frames - 1."""

    number: int
    first: int
    frames: int


@dataclass
class ScoredBlock:
    """The scores of a block as JSON-compatible values, with None for NaN.

    Attributes:
        bias: method -> subject -> bins, see ``glsim.eval.scoring.bias``.
        bad: frames that all methods or one method could not score, with the reason.
    """

    number: int
    frames: int
    rows: list[Row]
    baselines: list[Row]
    bad: list[dict[str, str]]
    bias: BiasSums = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ScoringJob:
    """The task of an evaluation, which is sent to each worker process.

    ``baseline_every``: score trivial baselines on every n-th frame, 0: never. ``stride``: score
    every n-th frame. ``device``: sensor file; its fixed pattern and wiggling are subtracted from
    all inputs. ``protocol``: default, the files'. ``tuned``: filters that no user named.
    """

    dataset: Path
    split: str
    denoisers: tuple[str, ...]
    focal_px: float | None = None
    baseline_every: int = 0
    mean_face: Depth | None = None
    stride: int = 1
    truth: TruthLayer = "clean"
    device: Path | None = None
    protocol: DepthProtocol | None = None
    tuned: tuple[str, ...] = ()

    def frames(self) -> Frames:
        """Open the frames to score. Raises DatasetError."""
        return open_frames(
            self.dataset, self.split, self.focal_px, self.truth, self.device, self.protocol
        )

    def run(self, blocks: Iterator[FrameBlock]) -> Iterator[ScoredBlock]:
        """Score blocks of frames in a worker process."""
        with warned_already():
            methods = [load_denoiser(spec) for spec in self.denoisers]
            yield from map(_BlockScorer(self, self.frames(), methods), blocks)

    def doing(self, block: FrameBlock) -> str:
        """Describe a block by its frames, for messages."""
        return f"scoring frames {block.first} to {block.first + block.frames - 1}"


@contextmanager
def warned_already() -> Iterator[None]:
    """Silence warnings of denoisers, which the main process already logged."""
    logger = logging.getLogger("glsim.denoise")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def stacks_of(frames: Frames, methods: Sequence[Denoiser]) -> Stacks:
    """Open the frames with as many neighbours in time as the methods need."""
    before = max((method.before for method in methods), default=0)
    after = max((method.after for method in methods), default=0)
    return Stacks(frames, before, after)


def denoise(method: Denoiser, stacks: Stacks, number: int) -> tuple[dict[str, Depth], float]:
    """Denoise a frame; return label -> map of each composite, and the time, ms."""
    frame = stacks.frame(number)
    stack, now = stacks.around(number, method.before, method.after)
    infrared = frame.layer("infrared") if method.infrared else None
    start = time.perf_counter()
    estimate = method.estimate(stack, now, infrared)
    time_ms = 1000 * (time.perf_counter() - start)
    return labelled(method, estimate), time_ms


def labelled(method: Denoiser, estimate: Estimate) -> dict[str, Depth]:
    """Return label -> depth map for each composite of an estimate."""
    return {
        f"{method.label} [{part}]" if part else method.label: depth
        for part, depth in estimate.composites().items()
    }


def default_composites(labels: Iterable[str]) -> list[str]:
    """Return the labels without those of a network's composites that are not the default."""
    others = tuple(f" [{name}]" for name in COMPOSITES if name != DEFAULT_COMPOSITE)
    return [label for label in labels if not label.endswith(others)]


class _BlockScorer:
    def __init__(self, job: ScoringJob, frames: Frames, methods: list[Denoiser]) -> None:
        self._job, self._frames, self._methods = job, frames, methods
        self._stacks = stacks_of(frames, methods)
        #: Row of the table -> prediction and clean map of the previous frame.
        self._earlier: dict[str, tuple[Depth, Depth]] = {}

    def __call__(self, block: FrameBlock) -> ScoredBlock:
        result = ScoredBlock(block.number, block.frames, [], [], [])
        self._earlier.clear()  # rows must not depend on the worker's previous block
        for number in range(block.first, block.first + block.frames):
            if number % self._job.stride:
                continue
            try:
                self._score(number, result)
            except DatasetError as error:
                result.bad.append({"frame": str(self._frames.key(number)), "why": str(error)})
        return result

    def _score(self, number: int, result: ScoredBlock) -> None:
        frame = self._stacks.frame(number)
        key = frame.key
        names = {"subject": key.subject, "sequence": key.sequence, "frame": key.frame}
        regions = Regions(frame.regions, self._frames.regions) if "regions" in frame else None
        truth = Truth(frame.clean_mm, frame.noisy_mm, frame.rays, regions, frame.offset_mm)
        for method in self._methods:
            try:
                maps, time_ms = denoise(method, self._stacks, number)
                scores = {
                    name: score(depth, truth, self._earlier.get(name, (None, None)))
                    for name, depth in maps.items()
                }
            except Exception as error:  # any error of a third-party denoiser
                ours = isinstance(error, DenoiserError | DatasetError)
                why = f"{error}" if ours else f"{type(error).__name__}: {error}"
                why = f"{method.label}: {why.removeprefix(f'{method.label}: ')}"
                result.bad.append({"frame": str(key), "why": why})
                continue
            for name, depth in maps.items():
                self._earlier[name] = depth, frame.clean_mm
                result.rows.append(names | {"method": name} | json_row(scores[name], time_ms))
                add_bias(result.bias, name, key.subject, bias_bins(depth, truth))
        if self._job.baseline_every and number % self._job.baseline_every == 0:
            for name, depth in trivial_predictions(frame.clean_mm, self._job.mean_face).items():
                scored = json_row(score(depth, truth), float("nan"))
                result.baselines.append(names | {"method": name} | scored)


def json_row(scores: dict[str, float], time_ms: float) -> Row:
    """Return scores and time as a JSON row, with None for undefined metrics."""
    row = scores | {"time_ms": time_ms}
    return {name: None if math.isnan(value) else value for name, value in row.items()}
