"""What a denoiser does where it was not tuned: the tables of docs/model_card.md, as Markdown.

    python -m scripts.model_card face -o card.md                  about five minutes on two cores
    python -m scripts.model_card run/best.pt --only limits
    python -m scripts.model_card face --source ict-facekit --root FaceXModel

Faces are of another seed than any data set that glsim makes by default. A cell is scored on few
frames: it finds harm, it does not rank denoisers (glsim eval does).
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
from glsim.dataset.files import write_bytes
from glsim.errors import GlsimError
from glsim.eval.denoisers import Method, compose, load
from glsim.eval.metrics import Truth, score
from glsim.eval.page import Grid, Page
from glsim.eval.tables import number
from glsim.processes import SINGLE_THREADED

Depth = NDArray[np.float32]

#: Heads that no other command makes unless it is told to.
_SEED: Final = 20_260_731
#: People of a cell; every frame is of another one.
_FRAMES: Final = 32
#: Side of a crop that holds a head at 0.6 m: 290 mm, 365 px * 290 mm / 600 mm = 176 px.
_NEAR_CROP: Final = 192
#: Metric -> what a column is called.
_SHOWN: Final = {
    "both_rmse_mm": "RMSE [mm]",
    "both_interior_rmse_mm": "interior [mm]",
    "flips_px": "flips [px]",
    "flying_px": "flying [px]",
}
_SENSORS: Final = (
    *("kinect-v2", "kinect-v2-fast", "kinect-v2-fankhauser", "kinect-v2-paper"),
    *("kinect-v1", "azure-kinect", "led3d", "ideal"),
)
_POSE: Final = {"yaw_deg": {"uniform": [-30, 30]}, "pitch_deg": {"uniform": [-15, 15]}}


@dataclass(frozen=True)
class Cell:
    """One row of a table: settings over kinect-v2 at 0.9 m with moderate poses."""

    name: str
    settings: dict[str, Any]
    crop: int = 128


def _distance(mm: int) -> Cell:
    settings = {"pose": _POSE | {"distance_mm": mm}}
    return Cell(f"{mm / 1000:.1f} m", settings, 128 if mm >= 900 else _NEAR_CROP)


def _sensor(name: str, wall: bool) -> Cell:
    scene = {"scene": {"wall_mm": {"uniform": [1200, 2000]}}} if wall else {}
    return Cell(f"{name}{', wall' * wall}", {"sensor": name, "pose": _POSE} | scene)


_NO_PATTERN: Final = {"fixed_pattern": {"enabled": 0}}
_NO_FLOOR: Final = {"tof_floor": {"enabled": 0}}
_NO_BLUR: Final = {"tof_taps": {"psf_sigma_px": 0.0}}

#: Section -> its cells.
SECTIONS: Final[dict[str, list[Cell]]] = {
    "distances": [_distance(mm) for mm in range(600, 1400, 100)],
    "yaw": [Cell(f"{yaw}°", {"pose": {"yaw_deg": yaw}}) for yaw in (0, 15, 30, 45, 60)],
    "sensors": [_sensor(name, wall) for name in _SENSORS for wall in (False, True)],
    "limits": [
        Cell("kinect-v2 as it is", {}),
        Cell("without the fixed pattern", {"stage": _NO_PATTERN}),
        Cell("without the temporal floor", {"stage": _NO_FLOOR}),
        Cell("without the point spread", {"stage": _NO_BLUR}),
        Cell("without all three", {"stage": _NO_PATTERN | _NO_FLOOR | _NO_BLUR}),
    ],
}
#: Where clean frames are given, which a denoiser should leave alone, and where sigma is checked.
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
class Job:
    """What a worker is told. source: of the faces, over the settings."""

    denoiser: str
    source: dict[str, Any]
    frames: int


def _frames(job: Job, cell: Cell) -> Iterator[tuple[Depth, Depth, Truth]]:
    """(clean, noisy) millimetres; clean is not rounded to whole ones, noisy is as it is stored."""
    people = {"subjects": job.frames, "frames_per_subject": 1}
    base = {"sensor": "kinect-v2", "seed": _SEED, "output": {"crop": cell.crop}}
    settings = load_settings(overrides=base | cell.settings, source=job.source | people)
    for frame in simulate(settings):
        if not isinstance(frame, Frame):
            raise SystemExit(f"{cell.name}: {frame.why}")
        noisy = frame.noisy.astype(np.float32)
        clean = np.zeros_like(noisy)
        clean[frame.window.slices] = 1000 * frame.clean_m
        yield clean, noisy, Truth(clean, noisy, frame.intrinsics.rays())


@cache
def _method(spec: str) -> Method:
    return load(spec)


def _denoised(job: Job, noisy_mm: Depth) -> Depth:
    parts = compose(_method(job.denoiser)(noisy_mm[None]), noisy_mm)
    depth: Depth = parts["" if "" in parts else "hard"]
    return depth


def score_cell(job: Job, cell: Cell) -> dict[str, tuple[float, float]]:
    """Metric -> means of the noisy input and of the denoiser; NaN where it is defined nowhere."""
    found = []
    for _, noisy, truth in _frames(job, cell):
        found.append((score(noisy, truth), score(_denoised(job, noisy), truth)))
    return {name: tuple(mean(pair[i][name] for pair in found) for i in (0, 1)) for name in _SHOWN}


def score_clean(job: Job, cell: Cell) -> tuple[float, float, float]:
    """RMSE in mm by which a clean map is moved, unrounded and in whole mm, and flips in px."""
    found = []
    for clean, _, truth in _frames(job, cell):
        whole = np.rint(clean)
        exact = score(_denoised(job, clean), Truth(clean, clean, truth.rays))
        rounded = score(_denoised(job, whole), Truth(whole, whole, truth.rays))
        found.append((exact["both_rmse_mm"], rounded["both_rmse_mm"], rounded["flips_px"]))
    return tuple(mean(column) for column in zip(*found, strict=True))


def score_sigma(job: Job, cell: Cell) -> tuple[float, float, float] | None:
    """Median sigma in mm, and % of errors within one and two of it; None without an uncertainty.

    Of pixels that have depth in truth and prediction. A normal law has 68 and 95 %.
    """
    method = _method(job.denoiser)
    if not method.uncertain:
        return None
    sigmas, ratios = [], []
    for _, noisy, truth in _frames(job, cell):
        (depth, valid), sigma = method.with_sigma(noisy)
        both = truth.valid & (valid > 0.5)
        sigmas.append(sigma[both])
        ratios.append(np.abs(depth - truth.clean)[both] / sigma[both])
    ratio = np.concatenate(ratios)
    within = (100 * float((ratio < limit).mean()) for limit in (1, 2))
    return float(np.median(np.concatenate(sigmas))), *within


def mean(values: Iterable[float]) -> float:
    """Of the defined ones; NaN if there are none."""
    known = [value for value in values if not np.isnan(value)]
    return statistics.fmean(known) if known else float("nan")


def _time_ms(denoiser: str, crop: int | None, folder: Path) -> float:
    """Of one map in a folder of many, without the start of the program."""
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


def _section(title: str, rows: list[dict[str, tuple[float, float]]], names: list[str]) -> Page:
    head = ["", *(f"{what}, {who}" for what in _SHOWN.values() for who in ("noisy", "denoised"))]
    cells = []
    for name, row in zip(names, rows, strict=True):
        before, after = row["both_rmse_mm"]
        numbers = [number(value) for metric in _SHOWN for value in row[metric]]
        cells.append([name, *numbers, "yes" if after <= before else "**no**"])
    return Page(title, [Grid([*head, "RMSE no worse"], cells)])


def card(job: Job, sections: Sequence[str], processes: int) -> str:
    """Markdown of the sections, in order."""
    pages = [
        Page(
            f"`{Path(job.denoiser).name}` where it was not tuned",
            [
                f"{job.frames} frames of as many people ({job.source.get('kind', 'procedural')} "
                f"faces, seed {_SEED}) a row; clean depth is not rounded to millimetres. RMSE: "
                "where truth and map have depth, each by its own mask. A soft validity is cut at "
                "1/2."
            ],
        )
    ]
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        futures = {
            name: [pool.submit(score_cell, job, cell) for cell in SECTIONS[name]]
            for name in sections
            if name in SECTIONS
        }
        moved = [pool.submit(score_clean, job, cell) for cell in _CLEAN if "clean" in sections]
        stated = [pool.submit(score_sigma, job, cell) for cell in _CLEAN if "sigma" in sections]
        for name, rows in futures.items():
            names = [cell.name for cell in SECTIONS[name]]
            pages.append(_section(_TITLES[name], [row.result() for row in rows], names))
        if moved:
            head = [
                "distance",
                "RMSE moved [mm], input unrounded",
                "input in whole mm",
                "flips [px]",
            ]
            grid = [
                [cell.name, *(number(value) for value in row.result())]
                for cell, row in zip(_CLEAN, moved, strict=True)
            ]
            pages.append(Page(_TITLES["clean"], [Grid(head, grid)]))
        rows = [(cell.name, row.result()) for cell, row in zip(_CLEAN, stated, strict=False)]
        grid = [[name, *map(number, values)] for name, values in rows if values is not None]
        if grid:
            head = ["distance", "median sigma [mm]", "within 1 sigma [%]", "within 2 sigma [%]"]
            pages.append(Page(_TITLES["sigma"], [Grid(head, grid)]))
    if "time" in sections:
        with tempfile.TemporaryDirectory() as folder:
            times = [
                [what, f"{_time_ms(job.denoiser, crop, Path(folder)):.0f}"]
                for what, crop in (("128x128 crop", 128), ("512x424 frame", None))
            ]
        pages.append(Page(_TITLES["time"], [Grid(["map", "ms"], times)]))
    first, *others = (page.markdown() for page in pages)
    return first + "".join(f"\n#{text}" for text in others)


def main() -> None:
    """Read the command line, print the card or write it to a file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("denoiser", help="as for glsim denoise -d")
    parser.add_argument("-o", "--out", type=Path, help="a file; default: standard output")
    parser.add_argument("--only", choices=list(_TITLES), nargs="+", default=list(_TITLES))
    parser.add_argument("--frames", type=int, default=_FRAMES, help="a row")
    parser.add_argument("--source", default="procedural", help="of faces")
    parser.add_argument("--root", help="folder of the face model")
    parser.add_argument("--processes", type=int, default=available_workers())
    chosen = parser.parse_args()
    load(chosen.denoiser)  # names what is wrong before anything starts
    os.environ.update(SINGLE_THREADED)
    source = {"kind": chosen.source} | ({"root": chosen.root} if chosen.root else {})
    start = time.perf_counter()
    text = card(Job(chosen.denoiser, source, chosen.frames), chosen.only, chosen.processes)
    if chosen.out:
        write_bytes(text.encode(), chosen.out)
    else:
        sys.stdout.write(text)
    sys.stderr.write(f"{time.perf_counter() - start:.0f} s\n")


if __name__ == "__main__":
    try:
        main()
    except GlsimError as error:
        raise SystemExit(f"model_card: {error}") from None
