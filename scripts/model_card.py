"""Model card: tables of a denoiser under conditions it was not tuned for, as Markdown.

    python -m scripts.model_card face -o card.md                  about five minutes on two cores
    python -m scripts.model_card run/best.pt --only limits
    python -m scripts.model_card face --source ict-facekit --root FaceXModel

They are the tables of docs/model_card.md. Faces have another seed than the default data sets of
glsim. A row is scored on few frames: enough to find harm, too few to rank denoisers (use glsim
eval).
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim import Frame, load_settings, simulate
from glsim.dataset import available_workers
from glsim.denoise import DEFAULT_COMPOSITE, Method, compose, load
from glsim.errors import GlsimError
from glsim.eval.metrics.prediction import Truth
from glsim.eval.metrics.score import score
from glsim.eval.report.document import Document, TextTable
from glsim.eval.report.tables import format_number
from glsim.files.atomic import write_atomic
from glsim.worker_processes import SINGLE_THREADED

Depth = NDArray[np.float32]

#: Seed of heads that no other command makes by default.
_SEED: Final = 20_260_731
#: Default frames per row; every frame shows another person.
_FRAMES: Final = 32
#: Side of a crop that holds a head at 0.6 m: 290 mm, 365 px * 290 mm / 600 mm = 176 px.
_NEAR_CROP: Final = 192
#: Metric -> title of its columns.
_COLUMNS: Final = {
    "both_rmse_mm": "RMSE [mm]",
    "both_interior_rmse_mm": "interior [mm]",
    "flips_px": "flips [px]",
    "flying_px": "flying [px]",
}
_SENSORS: Final = (
    *("kinect-v2", "kinect-v2-sdk", "kinect-v2-fast", "kinect-v2-fankhauser", "kinect-v2-paper"),
    *("kinect-v1", "azure-kinect", "realsense-d435", "truedepth", "led3d", "ideal"),
)
_POSE: Final = {"yaw_deg": {"uniform": [-30, 30]}, "pitch_deg": {"uniform": [-15, 15]}}


@dataclass(frozen=True)
class CardRow:
    """A row of a table: changes to the settings of kinect-v2 at 0.9 m, and its crop, px."""

    name: str
    settings: dict[str, Any]
    crop: int = 128


def _distance(mm: int) -> CardRow:
    settings = {"pose": _POSE | {"distance_mm": mm}}
    return CardRow(f"{mm / 1000:.1f} m", settings, 128 if mm >= 900 else _NEAR_CROP)


def _sensor(name: str, wall: bool) -> CardRow:
    scene = {"scene": {"wall_mm": {"uniform": [1200, 2000]}}} if wall else {}
    return CardRow(f"{name}{', wall' * wall}", {"sensor": name, "pose": _POSE} | scene)


_NO_PATTERN: Final = {"fixed_pattern": {"enabled": 0}}
_NO_FLOOR: Final = {"tof_floor": {"enabled": 0}}
_NO_BLUR: Final = {"tof_taps": {"psf_sigma_px": 0.0}}

#: Section -> its rows.
SECTIONS: Final[dict[str, list[CardRow]]] = {
    "distances": [_distance(mm) for mm in range(600, 1400, 100)],
    "yaw": [CardRow(f"{yaw}°", {"pose": {"yaw_deg": yaw}}) for yaw in (0, 15, 30, 45, 60)],
    "sensors": [_sensor(name, wall) for name in _SENSORS for wall in (False, True)],
    "limits": [
        CardRow("kinect-v2 as it is", {}),
        CardRow("without the fixed pattern", {"stage": _NO_PATTERN}),
        CardRow("without the temporal floor", {"stage": _NO_FLOOR}),
        CardRow("without the point spread", {"stage": _NO_BLUR}),
        CardRow("without all three", {"stage": _NO_PATTERN | _NO_FLOOR | _NO_BLUR}),
    ],
}
#: Rows of the sections clean (a denoiser should not change clean frames) and sigma.
_CLEAN: Final = [_distance(mm) for mm in (600, 900, 1300)]
_TITLES: Final = {
    "distances": "Distance, `kinect-v2`, yaw up to 30°",
    "yaw": "Head turned, `kinect-v2`, 0.9 m",
    "sensors": "Sensors, 0.9 m, with and without a wall 0.3 to 1.1 m behind",
    "limits": "What limits it: `kinect-v2` with a part of the noise switched off",
    "clean": "Clean input: how far the surface is moved",
    "sigma": "Uncertainty: errors within the standard deviation that is stated",
    "time": "Time of `glsim denoise`, reading and writing included",
}


@dataclass(frozen=True)
class CardJob:
    """Work of a process: denoiser, changes to the settings of the face source, frames per row."""

    denoiser: str
    source: dict[str, Any]
    frames: int


def _frames(job: CardJob, row: CardRow) -> Iterator[tuple[Depth, Depth, Truth]]:
    """Yield clean, noisy and expected depth, mm; only the noisy depth is rounded, as in files."""
    people = {"subjects": job.frames, "frames_per_subject": 1}
    base = {"sensor": "kinect-v2", "seed": _SEED, "output": {"crop": row.crop}}
    settings = load_settings(overrides=base | row.settings, source=job.source | people)
    for frame in simulate(settings, layers=("clean", "expected", "noisy")):
        if not isinstance(frame, Frame):
            raise SystemExit(f"{row.name}: {frame.why}")
        assert frame.expected_m is not None
        noisy = frame.noisy.astype(np.float32)
        clean, expected = np.zeros_like(noisy), np.zeros_like(noisy)
        clean[frame.window.slices] = 1000 * frame.clean_m
        expected[frame.window.slices] = 1000 * frame.expected_m
        yield clean, noisy, Truth(expected, noisy, frame.intrinsics.rays())


@cache
def _method(spec: str) -> Method:
    return load(spec)


def _denoised(job: CardJob, noisy_mm: Depth) -> Depth:
    parts = compose(_method(job.denoiser)(noisy_mm[None]), noisy_mm)
    depth: Depth = parts["" if "" in parts else DEFAULT_COMPOSITE]
    return depth


def score_row(job: CardJob, row: CardRow) -> dict[str, tuple[float, float]]:
    """Map each metric to its means before and after denoising; NaN if no frame defines it."""
    before, after = [], []
    for _, noisy, truth in _frames(job, row):
        before.append(score(noisy, truth))
        after.append(score(_denoised(job, noisy), truth))
    return {
        name: (mean(scores[name] for scores in before), mean(scores[name] for scores in after))
        for name in _COLUMNS
    }


def score_clean(job: CardJob, row: CardRow) -> tuple[float, float, float]:
    """RMSE that denoising adds to a clean map, unrounded and in whole mm, and flips in px."""
    moved_mm, moved_whole_mm, flips_px = [], [], []
    for clean, _, truth in _frames(job, row):
        whole = np.rint(clean)
        exact = score(_denoised(job, clean), Truth(clean, clean, truth.rays))
        rounded = score(_denoised(job, whole), Truth(whole, whole, truth.rays))
        moved_mm.append(exact["both_rmse_mm"])
        moved_whole_mm.append(rounded["both_rmse_mm"])
        flips_px.append(rounded["flips_px"])
    return mean(moved_mm), mean(moved_whole_mm), mean(flips_px)


def score_sigma(job: CardJob, row: CardRow) -> tuple[float, float, float] | None:
    """Median sigma in mm, and % of errors within one and two sigma; None without an uncertainty.

    Counts pixels with depth in truth and prediction. A normal distribution has 68 and 95 %.
    """
    method = _method(job.denoiser)
    if not method.uncertain:
        return None
    sigmas, ratios = [], []
    for _, noisy, truth in _frames(job, row):
        (depth, valid), sigma = method.with_sigma(noisy)
        both = truth.valid & (valid > 0.5)
        sigmas.append(sigma[both])
        ratios.append(np.abs(depth - truth.clean)[both] / sigma[both])
    ratio = np.concatenate(ratios)
    within_1, within_2 = (100 * float((ratio < limit).mean()) for limit in (1, 2))
    return float(np.median(np.concatenate(sigmas))), within_1, within_2


def mean(values: Iterable[float]) -> float:
    """Mean of the values that are not NaN; NaN if there are none."""
    known = [value for value in values if not np.isnan(value)]
    return statistics.fmean(known) if known else float("nan")


def _time_ms(denoiser: str, crop: int | None, folder: Path) -> float:
    """Time of ``glsim denoise`` per map of a folder, ms, without the start of the program."""
    from glsim.cli import main

    overrides = {"seed": _SEED} | ({"output": {"crop": crop}} if crop else {})
    source = {"subjects": 1, "frames_per_subject": 1}
    (frame,) = simulate(load_settings(overrides=overrides, source=source))
    assert isinstance(frame, Frame)
    seconds = {}
    for count in (2, 12):
        place = folder / f"{crop}-{count}"
        place.mkdir()
        for copy in range(count):
            cv2.imwrite(str(place / f"{copy:02d}.png"), frame.noisy)
        start = time.perf_counter()
        if main(["denoise", str(place), "-o", f"{place}-out", "-d", denoiser, "-q"]) != 0:
            raise SystemExit(1)
        seconds[count] = time.perf_counter() - start
    return 1000 * (seconds[12] - seconds[2]) / 10


def _section(title: str, rows: list[dict[str, tuple[float, float]]], names: list[str]) -> Document:
    titles = (f"{metric}, {map_}" for metric in _COLUMNS.values() for map_ in ("noisy", "denoised"))
    cells = []
    for name, row in zip(names, rows, strict=True):
        before, after = row["both_rmse_mm"]
        numbers = [format_number(value) for metric in _COLUMNS for value in row[metric]]
        cells.append([name, *numbers, "yes" if after <= before else "**no**"])
    return Document(title, [TextTable(["", *titles, "RMSE no worse"], cells)])


def card(job: CardJob, sections: Sequence[str], processes: int) -> str:
    """Score the rows in parallel and return the sections as Markdown, in order."""
    pages = [
        Document(
            f"`{Path(job.denoiser).name}` where it was not tuned",
            [
                f"{job.frames} frames of as many people ({job.source.get('kind', 'procedural')} "
                f"faces, seed {_SEED}) a row; truth is the layer `expected`, not rounded. RMSE: "
                "where truth and map have depth, each by its own mask. The composite is "
                f"{DEFAULT_COMPOSITE!r}, as `glsim denoise` writes it."
            ],
        )
    ]
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        futures = {
            name: [pool.submit(score_row, job, row) for row in SECTIONS[name]]
            for name in sections
            if name in SECTIONS
        }
        moved = [pool.submit(score_clean, job, row) for row in _CLEAN if "clean" in sections]
        stated = [pool.submit(score_sigma, job, row) for row in _CLEAN if "sigma" in sections]
        for name, results in futures.items():
            names = [row.name for row in SECTIONS[name]]
            pages.append(_section(_TITLES[name], [result.result() for result in results], names))
        if moved:
            head = [
                "distance",
                "RMSE moved [mm], input unrounded",
                "input in whole mm",
                "flips [px]",
            ]
            grid = [
                [row.name, *(format_number(value) for value in result.result())]
                for row, result in zip(_CLEAN, moved, strict=True)
            ]
            pages.append(Document(_TITLES["clean"], [TextTable(head, grid)]))
        sigmas = [(row.name, result.result()) for row, result in zip(_CLEAN, stated, strict=False)]
        grid = [
            [name, *map(format_number, values)] for name, values in sigmas if values is not None
        ]
        if grid:
            head = ["distance", "median sigma [mm]", "within 1 sigma [%]", "within 2 sigma [%]"]
            pages.append(Document(_TITLES["sigma"], [TextTable(head, grid)]))
    if "time" in sections:
        with tempfile.TemporaryDirectory() as folder:
            times = [
                [name, f"{_time_ms(job.denoiser, crop, Path(folder)):.0f}"]
                for name, crop in (("128x128 crop", 128), ("512x424 frame", None))
            ]
        pages.append(Document(_TITLES["time"], [TextTable(["map", "ms"], times)]))
    first, *others = (page.markdown() for page in pages)
    return first + "".join(f"\n#{text}" for text in others)


def main() -> None:
    """Read the command line; print the card or write it to a file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("denoiser", help="as for glsim denoise -d")
    parser.add_argument("-o", "--out", type=Path, help="output file; default: standard output")
    parser.add_argument(
        "--only", choices=list(_TITLES), nargs="+", default=list(_TITLES), help="default: all"
    )
    parser.add_argument("--frames", type=int, default=_FRAMES, help="frames per row")
    parser.add_argument("--source", default="procedural", help="face source")
    parser.add_argument("--root", help="folder of the face model")
    parser.add_argument("--processes", type=int, default=available_workers())
    chosen = parser.parse_args()
    load(chosen.denoiser)  # raises its error before any work starts
    os.environ.update(SINGLE_THREADED)
    source = {"kind": chosen.source} | ({"root": chosen.root} if chosen.root else {})
    start = time.perf_counter()
    text = card(CardJob(chosen.denoiser, source, chosen.frames), chosen.only, chosen.processes)
    if chosen.out:
        write_atomic(text.encode(), chosen.out)
    else:
        sys.stdout.write(text)
    sys.stderr.write(f"{time.perf_counter() - start:.0f} s\n")


if __name__ == "__main__":
    try:
        main()
    except GlsimError as error:
        raise SystemExit(f"model_card: {error}") from None
