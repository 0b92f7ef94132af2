"""Add up the sums of all frames: a table of each measure, with intervals."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.stacks import ratio
from glsim.core.files.atomic import without_nan
from glsim.eval.real_frames.frame_truth import (
    BINS_M,
    EDGE_SUMS,
    SHIFT_BIN_MM,
    ScoredFrame,
    Tally,
)
from glsim.eval.scoring.statistics import resampled

if TYPE_CHECKING:
    from glsim.eval.real_frames.split import SplitRecording

_Array = NDArray[np.float64]

#: Version of the measures; increase it with a change that alters a number.
VERSION: Final = 1
#: Least pixels of a bin. Derived: its mean is then known to 0.1 mm under noise of 2 mm that is
#: alike in ten neighbours.
_LEAST_PIXELS: Final = 1000
#: Least number of units or boards to resample.
_LEAST_UNITS = 5


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % interval, NaN where there is too little to resample."""

    value: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class RealMeasures:
    """All measures of one method, by BINS_M of distance; NaN where the recording lacks one.

    Attributes:
        pair_rmse_mm: error on static pairs.
        pair_change: geometric mean over the bins of RMSE over that of the raw frames, as a change
            in %.
        paper_rmse_mm: residual of the board's white paper from its plane.
        paper_change: as pair_change.
        board_rmse_mm: residual of paper and print.
        board_shift_mm: mean of denoised - raw on the paper.
        shift_mm: the same over all smooth surfaces.
        shift_by_100mm: (from mm, shift mm) of bins of 100 mm.
        edges: numbers of EDGES.

    """

    pair_rmse_mm: tuple[float, ...]
    pair_change: Interval
    paper_rmse_mm: tuple[float, ...]
    paper_change: Interval
    board_rmse_mm: tuple[float, ...]
    board_shift_mm: tuple[float, ...]
    shift_mm: tuple[float, ...]
    shift_by_100mm: tuple[tuple[int, float], ...]
    edges: dict[str, float]

    @property
    def largest_shift_mm(self) -> float:
        """The shift, with its sign, of the 100 mm in which it is largest; NaN without any."""
        return max((s for _, s in self.shift_by_100mm), key=abs, default=math.nan)


#: Lost shares of the first and second ring of foregrounds and of smooth surfaces, filled share of
#: holes beside foregrounds; per frame: pixels with depth and at most two neighbours with depth,
#: those of them without depth in the input, and dropped pixels with at least six neighbours.
EDGES: Final = (
    "ring_1_lost", "ring_2_lost", "surface_lost", "shadow_filled",
    "alone", "alone_filled", "pinholes",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class RealScores:
    """The result of ``score_recording``.

    Attributes:
        title: name of the recording.
        methods: name -> measures, the raw frames first.
        versions: label -> version of the denoiser's file.
        checksums: frame -> checksum.
        static_frames: number of frames with a static partner.
        scenes: number of static scenes.
        boards: number of frames with a board.
        by_scene: whether units are scenes, else tiles.
        own_ring_losses: shares of both rings that another raw frame of the view has lost.
        pixels: of the static pairs, by BINS_M.

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
    pixels: tuple[int, ...]

    def as_json(self) -> dict[str, Any]:
        """Return everything as JSON values; None for NaN."""
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
    chosen: Callable[[int], bool] | None = None,
) -> RealScores:
    """Add up the frames. chosen: selects units of static pairs; default: all."""
    names = list(scored[0].tallies)
    raw = names[0]
    by_name = {name: [frame.tallies[name] for frame in scored] for name in names}
    boards = [frame for frame in scored if frame.board_mm is not None]
    pairs = {name: _pair_sums(by_name[name], chosen) for name in names}
    papers = {name: _by_frame(by_name[name], "paper") for name in names}
    methods = {
        name: RealMeasures(
            pair_rmse_mm=_roots(pairs[name]),
            pair_change=_change(pairs[name], pairs[raw]),
            paper_rmse_mm=_roots(papers[name], least=0),
            paper_change=_change(papers[name], papers[raw], least=0),
            board_rmse_mm=_roots(_by_frame(by_name[name], "board"), least=0),
            board_shift_mm=_means(_by_frame(by_name[name], "paper", 2)),
            shift_mm=_shift_by_bin(by_name[name]),
            shift_by_100mm=_shift_by_100mm(by_name[name]),
            edges=_edges(by_name[name]),
        )
        for name in names
    }
    own = np.sum([frame.own for frame in scored], axis=0)
    return RealScores(
        title=recording.source.path.name,
        methods=methods,
        versions=dict(versions),
        checksums=recording.checksums(),
        static_frames=len(recording.partner),
        scenes=recording.scenes,
        boards=len(boards),
        by_scene=recording.by_scene,
        own_ring_losses=(ratio(own[1], own[0]), ratio(own[3], own[2])),
        pixels=tuple(int(n) for n in pairs[raw][:, :, 0].sum(axis=0)),
    )


def _pair_sums(tallies: Sequence[Tally], chosen: Callable[[int], bool] | None) -> _Array:
    """Return (units, bins, 2) pixels and sums of squares."""
    entries = [
        (unit, place, sums)
        for tally in tallies
        for (measure, unit, place), sums in tally.items()
        if measure == "pair" and (chosen is None or chosen(unit))
    ]
    number = {unit: n for n, unit in enumerate(sorted({unit for unit, _, _ in entries}))}
    total = np.zeros((len(number), len(BINS_M) - 1, 2))
    for unit, place, sums in entries:
        total[number[unit], place] += sums
    return total


def _by_frame(tallies: Sequence[Tally], wanted: str, column: int = 1) -> _Array:
    """Return (frames, bins, 2) pixels and the sum in ``column`` of a measure of the board."""
    total = np.zeros((len(tallies), len(BINS_M) - 1, 2))
    for number, tally in enumerate(tallies):
        for (measure, _, place), sums in tally.items():
            if measure == wanted:
                total[number, place] += sums[0], sums[column]
    seen: _Array = total[total[..., 0].sum(axis=1) > 0]
    return seen


def _means(sums: _Array, least: float = 1) -> tuple[float, ...]:
    total = sums.sum(axis=0)
    return tuple(float(s / n) if n >= max(least, 1) else math.nan for n, s in total)


def _roots(sums: _Array, least: int = _LEAST_PIXELS) -> tuple[float, ...]:
    """Return the root mean square by bin; 0 for a negative mean."""
    return tuple(math.sqrt(max(mean, 0.0)) for mean in _means(sums, least))


def _change(sums: _Array, raw: _Array, least: int = _LEAST_PIXELS) -> Interval:
    """Return the change against raw in %, a geometric mean over the bins, resampling the units."""
    used = raw[:, :, 0].sum(axis=0) >= max(least, 1)
    if not used.any():
        return Interval(math.nan)
    units = len(raw)
    weights = np.ones((1, units))
    if units >= _LEAST_UNITS:
        weights = np.concatenate([weights, resampled(units)])
    ours, theirs = (np.tensordot(weights, s[:, used, 1], 1) for s in (sums, raw))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Both have the same pixels, so sums have the ratio of means. A draw without a bin is NaN.
        change = np.log(np.maximum(ours, 0.0) / theirs) / 2.0
        change[~(theirs > 0)] = np.nan
        values = 100.0 * (np.exp(_mean_of_known(change)) - 1.0)
    if units < _LEAST_UNITS:
        return Interval(float(values[0]))
    low, high = np.nanquantile(values[1:], [0.025, 0.975])
    return Interval(float(values[0]), float(low), float(high))


def _mean_of_known(values: _Array) -> _Array:
    known = ~np.isnan(values)
    mean: _Array = np.where(known, values, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return mean


def _shift_sums(tallies: Iterable[Tally]) -> dict[int, _Array]:
    total: dict[int, _Array] = {}
    for tally in tallies:
        for (measure, _, place), sums in tally.items():
            if measure == "shift":
                total[place] = total.get(place, np.zeros(2)) + sums
    return total


def _shift_by_100mm(tallies: Sequence[Tally]) -> tuple[tuple[int, float], ...]:
    total = sorted(_shift_sums(tallies).items())
    return tuple(
        (SHIFT_BIN_MM * place, float(s / n)) for place, (n, s) in total if n >= _LEAST_PIXELS
    )


def _shift_by_bin(tallies: Sequence[Tally]) -> tuple[float, ...]:
    """Return the shift by BINS_M; each 100 mm counts where its middle lies."""
    sums = np.zeros((1, len(BINS_M) - 1, 2))
    for place, pair in _shift_sums(tallies).items():
        middle_m = SHIFT_BIN_MM * (place + 0.5) / 1000
        sums[0, int(np.digitize(middle_m, BINS_M)) - 1] += pair
    return _means(sums, _LEAST_PIXELS)


def _edges(tallies: Sequence[Tally]) -> dict[str, float]:
    found = [tally["edges", 0, 0] for tally in tallies if ("edges", 0, 0) in tally]
    if not found:
        return dict.fromkeys(EDGES, math.nan)
    total = dict(zip(EDGE_SUMS, (float(v) for v in np.sum(found, axis=0)), strict=True))
    of = {name: name.rpartition("_")[0] for name in EDGES[:4]}  # ring_1_lost is of ring_1
    shares = {name: ratio(total[name], total[whole]) for name, whole in of.items()}
    return shares | {name: total[name] / total["frames"] for name in EDGES[4:]}
