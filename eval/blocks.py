"""A run of consecutive frames, scored by every method: what a worker does at a time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from glsim.errors import DatasetError, DenoiserError

from .denoisers import Method, compose, load
from .frames import Frames, Stacks, open_frames
from .metrics import Regions, Truth, score
from .probes import PROBES
from .types import Depth

#: Absolute errors are counted in bins of this width up to BINS of them; the last holds the rest.
BIN_MM: Final = 0.1
BINS: Final = 500

Row = dict[str, Any]


class Block(NamedTuple):
    """Frames [first, first + frames)."""

    number: int
    first: int
    frames: int


@dataclass
class Scored:
    """Of one block. JSON-compatible, NaN as None.

    rows: one a frame and method. probes: the same for trivial predictions.
    histograms: method -> counts of |error| on pixels where input and clean are valid.
    bad: frame -> why it (or a method on it) could not be scored.
    """

    number: int
    frames: int
    rows: list[Row]
    probes: list[Row]
    histograms: dict[str, list[int]]
    bad: list[dict[str, str]]


@dataclass(frozen=True, eq=False)
class Scoring:
    """What workers need to know. denoisers: as users write them, see ``denoisers.load``.

    probe_every: probes are scored on every n-th frame, 0 is never.
    stride: only every n-th frame is scored.
    """

    dataset: Path
    split: str
    denoisers: tuple[str, ...]
    focal_px: float | None = None
    probe_every: int = 0
    mean_face: Depth | None = None
    stride: int = 1

    def frames(self) -> Frames:
        """The frames that are scored."""
        return open_frames(self.dataset, self.split, self.focal_px)

    def start(self) -> Callable[[Block], Scored]:
        """In the worker: opens the data set, loads the denoisers."""
        methods = [load(spec) for spec in self.denoisers]
        return _Scorer(self, self.frames(), methods)


class _Scorer:
    def __init__(self, job: Scoring, frames: Frames, methods: list[Method]) -> None:
        self._job, self._frames, self._methods = job, frames, methods
        before = max((method.before for method in methods), default=0)
        after = max((method.after for method in methods), default=0)
        self._stacks = Stacks(frames, before, after)

    def __call__(self, block: Block) -> Scored:
        result = Scored(block.number, block.frames, [], [], {}, [])
        for number in range(block.first, block.first + block.frames):
            if number % self._job.stride:
                continue
            try:
                self._score(number, result)
            except DatasetError as error:
                result.bad.append({"frame": str(self._frames.key(number)), "why": str(error)})
        return result

    def _score(self, number: int, result: Scored) -> None:
        sample = self._stacks.sample(number)
        key = self._frames.key(number)
        place = {"subject": key.subject, "sequence": key.sequence, "frame": key.frame}
        regions = None if sample.regions is None else Regions(sample.regions, self._frames.regions)
        truth = Truth(sample.clean_mm, sample.noisy_mm, sample.intrinsics.rays(), regions)
        for method in self._methods:
            stack, now = self._stacks.around(number, method.before, method.after)
            try:
                start = time.perf_counter()
                denoised = method(stack, now)
                time_ms = 1000 * (time.perf_counter() - start)
                parts = compose(denoised, sample.noisy_mm)
                scores = {part: score(depth, truth) for part, depth in parts.items()}
            except DenoiserError as error:
                result.bad.append({"frame": str(key), "why": f"{method.label}: {error}"})
                continue
            except Exception as error:  # of a denoiser that users brought
                why = f"{method.label}: {type(error).__name__}: {error}"
                result.bad.append({"frame": str(key), "why": why})
                continue
            for part, depth in parts.items():
                name = f"{method.label} [{part}]" if part else method.label
                result.rows.append(place | {"method": name} | plain(scores[part], time_ms))
                counts = _histogram(depth, truth)
                before = result.histograms.get(name)
                result.histograms[name] = (counts if before is None else counts + before).tolist()
        if self._job.probe_every and number % self._job.probe_every == 0:
            for name, predict in PROBES.items():
                prediction = predict(sample.clean_mm, self._job.mean_face)
                if prediction is not None and prediction.shape == truth.clean.shape:
                    scored = plain(score(prediction, truth), float("nan"))
                    result.probes.append(place | {"method": name} | scored)


def plain(scores: dict[str, float], time_ms: float) -> Row:
    """Metrics as JSON has them: None for what is undefined."""
    row = scores | {"time_ms": time_ms}
    return {name: None if math.isnan(value) else value for name, value in row.items()}


def _histogram(depth: np.ndarray[Any, Any], truth: Truth) -> np.ndarray[Any, np.dtype[np.int64]]:
    pixels = truth.input_valid & truth.valid
    prediction = np.where(depth > 0, depth, truth.noisy)[pixels]
    size = np.abs(prediction - truth.clean[pixels])
    place = np.minimum((size / BIN_MM).astype(np.int64), BINS)
    return np.bincount(place, minlength=BINS + 1)
