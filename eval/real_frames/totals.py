"""Totals over all frames of a recording: each measure with its confidence interval."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from glsim.core.array_types import Array
from glsim.core.files.atomic import without_nan
from glsim.core.units import MM_PER_M
from glsim.eval.real_frames.frame_truth import BINS_M, EDGE_SUMS, SHIFT_BIN_MM, SHIFT_BINS, Tally
from glsim.eval.real_frames.halves import SplitRecording
from glsim.eval.scoring.statistics import resampled
from glsim.measures.stacks import ratio

#: Version of the measures; increase it with a change that alters a number.
VERSION: Final = 3
#: Smallest number of pixels in a bin. Derived: noise of 2 mm, correlated over ten neighbours, gives
#: the mean an error of at most 0.1 mm.
_LEAST_PIXELS: Final = 1000
#: Smallest number of units, or of frames with a board, for a bootstrap interval.
_LEAST_UNITS = 5


class ScoredFrame(NamedTuple):
    """Sums of one frame for each method, and the first four EDGE_SUMS of its static partner."""

    number: int
    tallies: dict[str, Tally]
    sensor_losses: Array
    has_board: bool


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % interval; NaN if there are too few units to resample."""

    value: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class RealMeasures:
    """All measures of one method, by distance bin of BINS_M; NaN where the recording has no data.

    Changes are against the raw frames, %: geometric means over bins. ``shift_mm``: mean of
    denoised - raw over smooth surfaces; ``shift_by_100mm`` has the lower edges of its bins, mm.
    """

    pair_rmse_mm: list[float]
    pair_change: Interval
    paper_rmse_mm: list[float]
    paper_change: Interval
    shift_mm: list[float]
    shift_by_100mm: list[tuple[int, float]]
    plane_rmse_mm: list[float]
    plane_change: Interval
    edges: dict[str, float]

    @property
    def largest_shift_mm(self) -> float:
        """The signed shift of the 100 mm bin with the largest |shift|, mm; NaN without bins."""
        return max((s for _, s in self.shift_by_100mm), key=abs, default=math.nan)


#: Measures at edges. Shares: lost pixels of the first and second ring of foregrounds and of smooth
#: surfaces, filled pixels of holes beside foregrounds. Pixels per frame: lone pixels (at most two
#: neighbours have depth), lone pixels without input depth, removed pixels with six neighbours.
EDGES: Final = (
    "ring_1_lost", "ring_2_lost", "surface_lost", "shadow_filled",
    "alone", "alone_filled", "pinholes",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class RealScores:
    """The result of ``score_recording``.

    ``methods``: name -> measures, the raw frames first. ``versions``: label -> version of the
    denoiser's file. ``by_scene``: whether units are scenes; otherwise tiles. ``own_ring_losses``:
    shares of both rings that are lost in another raw frame of the view.
    """

    title: str
    methods: dict[str, RealMeasures]
    versions: dict[str, str]
    checksums: dict[str, str]
    static_frames: int
    scenes: int
    boards: int
    by_scene: bool
    own_ring_losses: tuple[float, float]
    pixels: list[int]
    simulated_by: str

    @property
    def kind(self) -> str:
        """What the frames are, for titles."""
        return f"frames simulated by {self.simulated_by}" if self.simulated_by else "real frames"

    def as_json(self) -> dict[str, Any]:
        """Return all scores as JSON values; None for NaN."""
        return {"version": VERSION, "bins_m": list(BINS_M), **without_nan(asdict(self))}

    @property
    def identity(self) -> str:
        """A hash of the frames, the files of the denoisers and the measures."""
        parts = [VERSION, self.checksums, self.versions]
        return hashlib.blake2b(json.dumps(parts).encode(), digest_size=8).hexdigest()


def add_up(
    recording: SplitRecording,
    scored: Sequence[ScoredFrame],
    versions: Mapping[str, str],
    tuning_half: bool | None = None,
) -> RealScores:
    """Add up the sums of the scored frames and compute all measures.

    ``tuning_half``: True: static pairs of the tuning half; False: of the scoring half; None: all.
    """
    half = recording.tuning_units()
    units = np.ones_like(half) if tuning_half is None else half == tuning_half
    totals = {}
    for name in scored[0].tallies:
        frames = zip(*(frame.tallies[name] for frame in scored), strict=True)
        pair, paper, shift, planes, edges = (np.stack(sums) for sums in frames)
        pair, paper, planes = (
            sums[sums[..., 0].any(axis=1)] for sums in (pair.sum(axis=0)[units], paper, planes)
        )
        totals[name] = Tally(pair, paper, shift.sum(axis=0), planes, edges.sum(axis=0))
    raw = next(iter(totals.values()))
    losses = np.sum([frame.sensor_losses for frame in scored], axis=0)
    return RealScores(
        title=recording.source.path.name,
        methods={name: _measures(total, raw) for name, total in totals.items()},
        versions=dict(versions), checksums=recording.checksums(),
        static_frames=len(recording.partner), scenes=recording.scenes,
        boards=sum(frame.has_board for frame in scored), by_scene=recording.by_scene,
        own_ring_losses=(ratio(losses[1], losses[0]), ratio(losses[3], losses[2])),
        pixels=raw.pair[..., 0].sum(axis=0).astype(int).tolist(),
        simulated_by=recording.recording.simulated_by,
    )  # fmt: skip


def _measures(total: Tally, raw: Tally) -> RealMeasures:
    middles_m = SHIFT_BIN_MM * (np.arange(SHIFT_BINS) + 0.5) / MM_PER_M
    shift = np.zeros((len(BINS_M) - 1, 2))
    np.add.at(shift, np.digitize(middles_m, BINS_M) - 1, total.shift)  # none is below bin 0
    by_100mm = enumerate(_means(total.shift[None], _LEAST_PIXELS).tolist())
    sums = dict(zip(EDGE_SUMS, total.edges.tolist(), strict=True))
    of = {name: name.rpartition("_")[0] for name in EDGES[:4]}  # ring_1_lost -> ring_1
    edges = {name: ratio(sums[name], sums[of.get(name, "frames")]) for name in EDGES}
    return RealMeasures(
        pair_rmse_mm=_roots(total.pair, _LEAST_PIXELS),
        pair_change=_change(total.pair, raw.pair, _LEAST_PIXELS),
        paper_rmse_mm=_roots(total.paper, 1),
        paper_change=_change(total.paper, raw.paper, 1),
        shift_mm=_means(shift[None], _LEAST_PIXELS).tolist(),
        shift_by_100mm=[(SHIFT_BIN_MM * n, mm) for n, mm in by_100mm if not math.isnan(mm)],
        plane_rmse_mm=_roots(total.planes, _LEAST_PIXELS),
        plane_change=_change(total.planes, raw.planes, _LEAST_PIXELS),
        edges=edges,
    )


def _means(sums: Array, least: int) -> Array:
    """Compute the mean of each bin from (units, bins, 2) sums; NaN below ``least`` pixels."""
    total = sums.sum(axis=0)
    pixels = np.where(total[:, 0] >= least, total[:, 0], np.nan)
    return np.asarray(total[:, 1] / pixels)


def _roots(sums: Array, least: int) -> list[float]:
    roots: list[float] = np.sqrt(np.maximum(_means(sums, least), 0.0)).tolist()
    return roots


def _change(sums: Array, raw: Array, least: int) -> Interval:
    """Compute the change of the RMSE in %, with interval: geometric mean over bins."""
    used = raw[:, :, 0].sum(axis=0) >= least
    if not used.any():
        return Interval(math.nan)
    units = len(raw)
    weights = np.ones((1, units))
    if units >= _LEAST_UNITS:
        weights = np.concatenate([weights, resampled(units)])
    ours, theirs = (np.tensordot(weights, s[:, used, 1], 1) for s in (sums, raw))
    with np.errstate(divide="ignore", invalid="ignore"):
        # The sums have the same pixels: their ratio is the means'. NaN for a draw without pixels.
        change = np.log(np.maximum(ours, 0.0) / theirs) / 2.0
    known = theirs > 0
    mean = np.where(known, change, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    values = 100.0 * (np.exp(mean) - 1.0)
    if units < _LEAST_UNITS:
        return Interval(float(values[0]))
    low, high = np.nanquantile(values[1:], [0.025, 0.975])
    return Interval(float(values[0]), float(low), float(high))
