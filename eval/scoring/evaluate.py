"""Scoring of a whole set: blocks of frames in worker processes, resumable, in constant memory.

    -o DIR/.blocks/<fingerprint>/<block>.json   finished blocks; the same command resumes from them
    -o DIR/rows.csv                             one row per frame and method, in order
    -o DIR/bad.csv                              frames that could not be scored, and why

Rows are CSV, not Parquet: every program reads CSV, and pyarrow would add 130 MB for one table.
"""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import AtomicFile, to_json, wrap_write_errors, write_atomic
from glsim.data.disk_format import HEADER
from glsim.data.progress import FrameProgress
from glsim.data.worker_processes import available_workers, run_tasks
from glsim.denoise.denoiser import Denoiser
from glsim.denoise.registry import load_denoiser
from glsim.eval.metrics.frame_score import metrics_with_regions
from glsim.eval.metrics.metric import Metric
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.baselines import BASELINE_FRAMES, mean_face
from glsim.eval.scoring.blocks import FrameBlock, ScoredBlock, ScoringJob

#: Number of frames in a block. Small blocks lose little in a crash, and all cores end together.
_BLOCK: Final = 25
#: Version of the scores; increase it with a change that alters the scores of a frame.
_VERSION: Final = 4


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of all methods; ``bad``: number of frames in which a method failed, or all."""

    summary: ScoreSummary
    baselines: ScoreSummary
    frames: int
    bad: int
    first_bad: tuple[str, ...]
    protocol: DepthProtocol = "depth"


def evaluate(
    job: ScoringJob, out: Path, *, workers: int | None = None, baselines: bool = True,
    progress: Callable[[FrameProgress], None] | None = None,
) -> Evaluation:  # fmt: skip
    """Score every frame of a set by every denoiser; write rows.csv and bad.csv to ``out``.

    Raises ConfigError for a wrong denoiser, a denoiser trained under another protocol, or an empty
    set, DatasetError if no frame can be scored.

    ``workers``: default, one per core. ``baselines``: also score trivial predictions.
    """
    methods = load_methods(job.denoisers)  # raises errors before scoring starts
    frames = job.frames()
    if len(frames) == 0:
        advice = "take another --split, or glsim generate --set split=0.7,0.1,0.2"
        raise ConfigError(f"{job.dataset}: has no frames in {job.split}: {advice}")
    for method in methods:
        method.check_protocol(frames.protocol)
    if baselines:
        every = -(-len(frames) // BASELINE_FRAMES)
        job = replace(job, baseline_every=every, mean_face=mean_face(frames))
    identity = [_VERSION, frames.identity, job.split, job.denoisers, job.baseline_every, job.stride]
    metrics = metrics_with_regions(frames.regions)
    identity += [list(metrics), [method.version for method in methods]]
    digest = hashlib.blake2b(json.dumps(identity).encode(), digest_size=8).hexdigest()
    folder = out / ".blocks" / digest
    check_owner(out, f"{job.split} of {job.dataset.absolute()}")
    with wrap_write_errors(folder):
        folder.mkdir(exist_ok=True)
    blocks = [
        FrameBlock(number, first, min(_BLOCK, len(frames) - first))
        for number, first in enumerate(range(0, len(frames), _BLOCK))
    ]
    _score_missing(job, folder, blocks, workers or available_workers(), len(frames), progress)
    evaluation = _collect(out, folder, blocks, -(-len(frames) // job.stride), metrics)
    return replace(evaluation, protocol=frames.protocol)


def check_owner(out: Path, scored: str) -> None:
    """Note what is scored in a folder. Raises ConfigError if it has the scores of other frames."""
    if (out / HEADER).is_file():
        raise ConfigError(f"{out}: is a data set: name another folder by -o")
    note = out / ".blocks" / "scored"
    with wrap_write_errors(note):
        note.parent.mkdir(parents=True, exist_ok=True)
        owner = note.read_text("utf-8") if note.is_file() else scored
        if owner != scored:
            raise ConfigError(f"{out}: holds the scores of {owner}: name another folder by -o")
        note.write_text(scored, "utf-8")


def load_methods(specs: Sequence[str], *taken: str) -> list[Denoiser]:
    """Load denoisers. Raises ConfigError for a wrong spec, and a repeated or ``taken`` label."""
    methods = [load_denoiser(spec) for spec in specs]
    labels = [*taken, *(method.label for method in methods)]
    for label in labels:
        if labels.count(label) > 1:
            raise ConfigError(f"denoiser {label}: is given twice: name one of them label@{label}")
    return methods


def _score_missing(
    job: ScoringJob, folder: Path, blocks: list[FrameBlock], workers: int, total: int,
    progress: Callable[[FrameProgress], None] | None,
) -> None:  # fmt: skip
    stored = ((block, _read(folder, block.number)) for block in blocks)
    # Bad frames may have been repaired since.
    missing = [block for block, scored in stored if scored is None or scored.bad]
    reused = done = total - sum(block.frames for block in missing)
    bad = 0
    show = progress or (lambda _: None)
    show(FrameProgress(done, total, bad, reused))
    if not missing:
        return
    for scored in run_tasks(job, missing, min(workers, len(missing))):
        path = _path(folder, scored.number)
        data = to_json(asdict(scored), str(path)).encode()
        write_atomic(data, path, sync=False)  # an empty block is scored again
        done, bad = done + scored.frames, bad + len({item["frame"] for item in scored.bad})
        show(FrameProgress(done, total, bad, reused))


def _path(folder: Path, number: int) -> Path:
    return folder / f"{number:06d}.json"


def _read(folder: Path, number: int) -> ScoredBlock | None:
    """Read the scores of a finished block; None if the file is missing or damaged."""
    try:
        return ScoredBlock(**json.loads(_path(folder, number).read_bytes()))
    except (OSError, ValueError, TypeError):
        return None


def _collect(
    out: Path, folder: Path, blocks: list[FrameBlock], total: int, metrics: Mapping[str, Metric]
) -> Evaluation:
    summary, baselines = ScoreSummary(metrics), ScoreSummary(metrics)
    bad: list[tuple[str, str]] = []
    fields = ("subject", "sequence", "frame", "method", *metrics)

    def rows() -> Iterator[list[object]]:
        for block in blocks:
            scored = _read(folder, block.number)
            if scored is None:
                where = _path(folder, block.number)
                raise DatasetError(f"{where}: is missing or damaged: run the same command again")
            for row in scored.rows:
                summary.add(row)
                yield [row[field] for field in fields]
            for row in scored.baselines:
                baselines.add(row)
            summary.add_bias(scored.bias)
            bad.extend((item["frame"], item["why"]) for item in scored.bad)

    write_csv(out / "rows.csv", fields, rows())
    if bad:
        write_csv(out / "bad.csv", ("frame", "why"), bad)
    else:
        (out / "bad.csv").unlink(missing_ok=True)
    counts, named = Counter(why for _, why in bad), {why: frame for frame, why in reversed(bad)}
    first = tuple(
        f"{named[why]}: {why}{f' ({n} such)' * (n > 1)}" for why, n in counts.most_common(10)
    )
    if not summary.methods:
        raise DatasetError(f"no frame could be scored: {first[0]}")
    return Evaluation(summary, baselines, total, len({frame for frame, _ in bad}), first)


def write_csv(path: Path, fields: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV file atomically, with "nan" for None. Raises DatasetError if writing fails."""
    with AtomicFile(path) as file:
        for row in itertools.chain([fields], rows):
            text = io.StringIO()
            values = (float("nan") if value is None else value for value in row)
            cells = [f"{v:.9g}" if isinstance(v, float) else v for v in values]
            csv.writer(text, lineterminator="\n").writerow(cells)
            file.write(text.getvalue().encode())
