"""Do denoisers of photographs transfer to depth? Networks trained on both, scored on depth.

The paper speaks of "standard depth data denoising algorithms in comparison with traditional
denoising datasets". Here the same networks are trained on photographs with Gaussian noise and on
the pairs of a reproduction, and scored on its test frames.
"""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from glsim.denoise import DEFAULT_COMPOSITE, Method, composed, load
from glsim.denoise.frames import Frames
from glsim.denoise.interface import Depth
from glsim.errors import ConfigError, DenoiserError
from glsim.eval.metrics.prediction import Truth
from glsim.eval.metrics.score import score
from glsim.eval.paper.runs import TrainedRun, find_trained_runs
from glsim.eval.report.document import Document, Heading, TextTable
from glsim.eval.report.tables import TABLE_METRICS, format_number
from glsim.files.atomic import read_json

#: Metrics of the table: name -> heading.
_METRICS: Final = {
    "mse_mm2": "MSE [mm²]",
    "both_interior_rmse_mm": "interior RMSE [mm]",
    "normal_mean_deg": "normals [°]",
    "flying_px": "flying pixels",
}
_RATIO: Final = "both_interior_rmse_mm"
#: Methods that give the table a scale: denoiser -> name.
_SCALE: Final = {"noisy": "noisy input", "median": "Median", "bilateral": "Bilateral"}
#: Largest number of scored frames, evenly spaced. Chosen: the differences far exceed their error.
_MOST_FRAMES: Final = 60
_OUR_PAIRS: Final = "our pairs"
#: Treatments of holes, which a network of photographs has never seen.
_AS_IT_IS, _FILLED = "as they are", "filled, mask kept"

Scores = dict[str, float]


@dataclass(frozen=True)
class _Trained:
    """A network, its training data, and its relative error on held-out photographs."""

    run: TrainedRun
    trained_on: str
    left_of_noise: float

    @property
    def row(self) -> tuple[str, str]:
        """What the seeds of a row have in common."""
        return self.run.title, self.trained_on


def photograph_table(
    frames: Frames,
    photo_runs: Path,
    runs: Path,
    scoring: Callable[[int, int], None] = lambda *_: None,
) -> tuple[Document, str]:
    """Score on depth the networks trained on photographs, beside those trained on depth.

    Args:
        frames: the test frames of the reproduction.
        photo_runs: folder with a folder per noise, each with runs of ``glsim train --photos``.
        runs: folder of runs on depth; networks that photo_runs lacks are left out.
        scoring: called with the number of scored frames and their total.

    Returns:
        The page, and a CSV table with a row per network and seed.

    Raises:
        ConfigError: without runs.
        DatasetError: for an unreadable frame.
        DenoiserError: for an unreadable network. One that returns what is no depth map, such as
            negative depths after too few steps, is listed as not scored.
    """
    networks = _find(photo_runs, runs)
    methods = [load(item.run.spec) for item in networks]
    scale = [load(name) for name in _SCALE]
    count = min(len(frames), _MOST_FRAMES)
    numbers = np.linspace(0, len(frames) - 1, count).round().astype(int)
    sums: dict[tuple[int, str], list[Scores]] = {}
    faults: dict[tuple[int, str], list[str]] = {}
    for done, number in enumerate(numbers.tolist(), 1):
        sample = frames.load(number)
        truth = Truth(sample.clean_mm, sample.noisy_mm, sample.intrinsics.rays())
        for place, method in enumerate(scale, -len(scale)):
            depth = _denoised(method, sample.noisy_mm)
            sums.setdefault((place, ""), []).append(_scores(depth, truth))
        filled_mm = fill_holes(sample.noisy_mm)
        for place, method in enumerate(methods):
            kept = np.where(sample.noisy_mm > 0, method(filled_mm[None])[0], np.float32(0))
            depths = {_AS_IT_IS: _denoised(method, sample.noisy_mm), _FILLED: kept}
            for holes, depth in depths.items():
                try:
                    sums.setdefault((place, holes), []).append(_scores(depth, truth))
                except DenoiserError as error:
                    faults.setdefault((place, holes), []).append(str(error))
        scoring(done, count)
    # A mean over the other frames alone would favour a network that fails in some.
    keys = dict.fromkeys([*sums, *faults])
    means = {key: _mean([] if key in faults else sums[key]) for key in keys}
    document = _document(networks, means, count)
    if faults:
        document.parts += [Heading("Not scored"), list(_unscored(networks, faults, count))]
    return document, _csv(networks, means)


def fill_holes(depth_mm: Depth) -> Depth:
    """Fill holes with the depth of the nearest measured pixel; (H, W) mm, 0 = no depth."""
    measured = depth_mm > 0
    if not measured.any():
        return depth_mm
    _, labels = cv2.distanceTransformWithLabels(
        (~measured).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    depths = np.zeros(labels.max() + 1, np.float32)
    depths[labels[measured]] = depth_mm[measured]
    filled: Depth = depths[labels]
    return filled


def _find(photo_runs: Path, runs: Path) -> list[_Trained]:
    """Return the networks of photographs, then those of the same recipes on our pairs."""
    folders = sorted(folder for folder in photo_runs.glob("*") if folder.is_dir())
    if not folders:
        raise ConfigError(
            f"--photo-runs {photo_runs}: holds no folders of runs: train into one per noise, "
            f"glsim train RECIPE --data DATA --photos scikit-image -o {photo_runs}/sigma-25/NAME"
        )
    networks = [_trained(run) for folder in folders for run in find_trained_runs(folder)[0]]
    kinds = {item.run.network for item in networks}
    networks += [_trained(run) for run in find_trained_runs(runs)[0] if run.network in kinds]
    order = list(dict.fromkeys(item.run.title for item in networks))
    return sorted(networks, key=lambda item: (order.index(item.run.title), item.run.seed))


def _trained(run: TrainedRun) -> _Trained:
    report = read_json(run.checkpoint.parent / "run.json")
    data: dict[str, Any] = report.get("data") or {}
    if "photographs" not in data:
        return _Trained(run, _OUR_PAIRS, math.nan)
    sigma_mm = data["sigma_grey"] * data["span_mm"] / 255
    mse_mm2 = _best_mse_mm2(run.checkpoint.parent / "metrics.csv", report["best"]["step"])
    left = math.sqrt(mse_mm2) / sigma_mm if sigma_mm else math.nan
    count, sigma = data["photographs"], data["sigma_grey"]
    return _Trained(run, f"{count} photographs, sigma = {sigma:g} ({sigma_mm:.1f} mm)", left)


def _best_mse_mm2(metrics: Path, step: int) -> float:
    """Return the MSE of the validation that chose the weights; NaN if the file lacks it."""
    if not metrics.is_file():
        return math.nan
    with metrics.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.get("step") == str(step)]
    return float(rows[-1]["validation_mse_mm2"]) if rows else math.nan


def _denoised(method: Method, noisy_mm: Depth) -> Depth:
    return composed(method(noisy_mm[None]), noisy_mm, DEFAULT_COMPOSITE)


def _scores(depth_mm: Depth, truth: Truth) -> Scores:
    scores = score(depth_mm, truth)
    return {name: scores[name] for name in _METRICS}


def _unscored(
    networks: Sequence[_Trained], faults: dict[tuple[int, str], list[str]], frames: int
) -> Iterator[str]:
    """Name the networks that returned what is no depth map, with the first reason."""
    for (place, holes), reasons in faults.items():
        item = networks[place]
        yield (
            f"{item.run.title}, seed {item.run.seed}, trained on {item.trained_on}, holes {holes}: "
            f"{reasons[0]} in the first of {len(reasons)} frames of {frames} that cannot be scored"
        )


def _mean(rows: Sequence[Scores]) -> Scores:
    """Return the mean of each metric over the frames where it is defined."""
    means = {}
    for name in _METRICS:
        values = [row[name] for row in rows if math.isfinite(row[name])]
        means[name] = statistics.fmean(values) if values else math.nan
    return means


def _document(
    networks: Sequence[_Trained], means: dict[tuple[int, str], Scores], frames: int
) -> Document:
    base = means[-len(_SCALE), ""]
    head = ["network", "trained on", "seeds", "left of the photographs' noise", "holes"]
    head += [*_METRICS.values(), "interior RMSE over noisy"]
    rows, verdicts = [], []
    groups: dict[tuple[str, str], list[int]] = {}
    for place, item in enumerate(networks):
        groups.setdefault(item.row, []).append(place)
    for (title, trained_on), places in groups.items():
        left = [networks[place].left_of_noise for place in places]
        for holes in (_AS_IT_IS, _FILLED):
            scores = [means[place, holes] for place in places]
            values = {name: [each[name] for each in scores] for name in _METRICS}
            cells = [_cell(values[name], TABLE_METRICS[name].unit) for name in _METRICS]
            ratio = [value / base[_RATIO] for value in values[_RATIO]]
            rows.append([title, trained_on, str(len(places)), _cell(left), holes, *cells,
                         _cell(ratio)])  # fmt: skip
            if holes == _FILLED and all(map(math.isfinite, ratio)):
                verdicts.append(
                    f"{title}, {trained_on}, holes filled: the interior error is "
                    f"{statistics.fmean(ratio):.2f} times the noisy input's."
                )
    for place, name in enumerate(_SCALE.values(), -len(_SCALE)):
        entries = means[place, ""]
        cells = [format_number(entries[n], TABLE_METRICS[n].unit) for n in _METRICS]
        rows.append([name, "", "", "", "", *cells, f"{entries[_RATIO] / base[_RATIO]:.2f}"])
    return Document(
        "Do denoisers of photographs transfer to depth?",
        [
            f"{frames} test frames. Networks of one recipe, trained on photographs with Gaussian "
            "noise or on our pairs, scored on depth; means over seeds ± their standard deviation.",
            "Grey levels 0 to 255 stand for the depths of a head, from the nearest point to the "
            "far ears, the medians of the clean training frames: so a network meets on depth the "
            "numbers that it knows. The noise is Gaussian with sigma in grey levels, scaled alike.",
            TextTable(head, rows),
            "Left of the photographs' noise: the error on held-out photographs over sigma; 1 "
            "removes nothing, and more than 1 has not learnt its own task. Photographs have no "
            "holes. *As they are*: holes are depth 0, as the paper's networks meet them. *Filled, "
            "mask kept*: holes get the depth of the nearest measured pixel before the network and "
            "are holes again after it, which leaves the noise of the surface alone to it.",
            verdicts,
        ],
    )


def _cell(values: Sequence[float], unit: str = "") -> str:
    if not all(map(math.isfinite, values)):
        return "-"
    text = format_number(statistics.fmean(values), unit)
    return f"{text} ± {format_number(statistics.stdev(values), unit)}" if len(values) > 1 else text


def _csv(networks: Sequence[_Trained], means: dict[tuple[int, str], Scores]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["network", "trained_on", "seed", "left_of_noise", "holes", *_METRICS])
    for (place, holes), scores in means.items():
        values = [f"{scores[name]:.6g}" for name in _METRICS]
        if place < 0:
            writer.writerow([list(_SCALE)[place], "", "", "", "", *values])
        else:
            item = networks[place]
            writer.writerow([item.run.title, item.trained_on, item.run.seed,
                             f"{item.left_of_noise:.4g}", holes, *values])  # fmt: skip
    return stream.getvalue()
