"""Score filters on the same faces under several sensors, to see if noise decides the ranking."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from glsim.dataset import generate
from glsim.dataset.progress import GenerateProgress as GenerationProgress
from glsim.denoise import PAPER_FILTERS
from glsim.errors import ConfigError
from glsim.eval.report.tables import ResultTable, format_number
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.grid_search import tune_filters
from glsim.eval.scoring.run import Evaluation, ScoringProgress, evaluate
from glsim.files.markdown import markdown_table
from glsim.sensors.sensor import sensor_names
from glsim.settings.schema import load_settings

#: The default sensors, as far as they are shipped.
SENSORS: Final = ("kinect-v2-paper", "kinect-v2", "kinect-v2-fast", "led3d")
#: Filters that are tuned on each sensor's validation split and scored beside the paper's.
RIVALS: Final = ("masked_bilateral", "quadric")
#: Shares of train, val (tuning) and test (scoring) subjects; nothing is trained.
_SPLIT: Final = (0.0, 0.2, 0.8)

#: Columns of the table of the noise: metric -> heading.
_NOISE_COLUMNS: Final = {
    "mse_mm2": "MSE [mm²]",
    "mse_flips_pct": "of it in flipped pixels [%]",
    "flips_px": "flipped pixels",
    "flying_px": "flying pixels",
    "both_interior_bias_mm": "interior bias [mm]",
    "both_interior_rmse_mm": "interior RMSE [mm]",
    "both_edge_rmse_mm": "edge RMSE [mm]",
    "normal_mean_deg": "normals [°]",
}
#: Tables of all methods: metric -> heading.
_TABLES: Final = {
    "mse_mm2": "MSE over all pixels [mm²]",
    "both_interior_rmse_mm": "RMSE, interior, valid in both [mm]",
    "normal_mean_deg": "normals [°]",
    "flying_px": "flying pixels",
}


@dataclass(frozen=True, eq=False)
class SensorResult:
    """The scores of one sensor. names: label in the tables -> method."""

    sensor: str
    evaluation: Evaluation
    table: ResultTable
    names: dict[str, str]


def choose_sensors(sensors: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Return the sensors to run, and those of SENSORS that are not shipped.

    Raises ConfigError if none is shipped.
    """
    shipped = sensor_names()
    if sensors:
        return list(sensors), []
    available: list[str] = [name for name in SENSORS if name in shipped]
    if not available:
        raise ConfigError(f"none of {', '.join(SENSORS)} is shipped")
    return available, [name for name in SENSORS if name not in shipped]


def run_study(
    out: Path,
    sensors: Sequence[str],
    overrides: dict[str, Any],
    source: dict[str, Any],
    *,
    workers: int,
    generating: Callable[[str], Callable[[GenerationProgress], None] | None] = lambda _: None,
    scoring: Callable[[str], Callable[[ScoringProgress], None] | None] = lambda _: None,
) -> list[SensorResult]:
    """Generate the same faces with each sensor; score the paper's filters and tuned rivals.

    Heads keep still unless ``overrides`` set ``pose.motion``, as in the paper.

    out: gets a folder per sensor with its data set and scores; all steps are resumable.
    overrides, source: settings of the data sets, see ``load_settings``. generating, scoring: return
    the progress callback of a sensor.
    """
    results = []
    for sensor in sensors:
        tree = {"split": _SPLIT, "pose": {"motion": 0.0}} | overrides | {"sensor": sensor}
        data, scores = out / sensor / "data", out / sensor / "scores"
        generate(load_settings(None, [], tree, source), data, workers=workers,
                 progress=generating(sensor))  # fmt: skip
        val = ScoringJob(data, "val", ())
        names = {name: name for name in PAPER_FILTERS}
        for rival in tune_filters(val, RIVALS, scores, workers=workers):
            names[f"{rival.name}, tuned"] = rival.plain
            names[f"{rival.name}, tuned, mask cleaned"] = rival.cleaned
        job = ScoringJob(data, "test", tuple(names.values()))
        evaluation = evaluate(job, scores, workers=workers, progress=scoring(sensor))
        results.append(SensorResult(sensor, evaluation, evaluation.summary.compared(), names))
    return results


def study_markdown(results: Sequence[SensorResult], absent: Sequence[str]) -> str:
    """Return study.md: the noise of each sensor, its table 1, and the best filters."""
    frames, subjects = results[0].evaluation.frames, len(results[0].evaluation.summary.subjects)
    lines = [
        "# The same faces through several sensors",
        "",
        f"{frames} frames of {subjects} subjects for each sensor; the rivals are tuned on others.",
        "",
    ]
    if absent:
        lines += [f"Not in this glsim, and so left out: {', '.join(absent)}.", ""]
    lines += ["## The noise", "", *_noise_table(results)]
    for metric, title in _TABLES.items():
        lines += ["", f"## {title}", "", *_metric_table(results, metric)]
    lines += ["", "## Who wins", "", *_winner_table(results)]
    lines += ["", "Among the paper's filters alone:", "", *_winner_table(results, PAPER_FILTERS)]
    lines += ["", "The rivals' settings, chosen on the validation subjects of each sensor:", ""]
    for result in results:
        chosen = [f"`{name}`" for name in result.names.values() if name not in PAPER_FILTERS]
        lines.append(f"- `{result.sensor}`: {', '.join(chosen)}")
    return "\n".join(lines) + "\n"


def _noise_table(results: Sequence[SensorResult]) -> list[str]:
    """Return the metrics of the noisy input: a row per sensor."""
    rows = [
        [
            f"`{result.sensor}`",
            *(format_number(result.table["noisy"][metric].mean) for metric in _NOISE_COLUMNS),
        ]
        for result in results
    ]
    return markdown_table(["sensor", *_NOISE_COLUMNS.values()], rows)


def _metric_table(results: Sequence[SensorResult], metric: str) -> list[str]:
    """Return the means of a metric: a row per sensor, a column per method, the best bold."""
    rows = []
    for result in results:
        means = [result.table[name][metric].mean for name in result.names.values()]
        best = format_number(min(means))
        cells = [format_number(mean) for mean in means]
        rows.append(
            [f"`{result.sensor}`", *(f"**{cell}**" if cell == best else cell for cell in cells)]
        )
    return markdown_table(["sensor", *results[0].names], rows)


def _winner_table(results: Sequence[SensorResult], among: Sequence[str] | None = None) -> list[str]:
    """Return the best of the methods ``among`` (default: all) by three metrics, per sensor."""
    metrics = list(_TABLES)[:3]
    rows = [
        [f"`{result.sensor}`", *(_winner(result, metric, among) for metric in metrics)]
        for result in results
    ]
    return markdown_table(["sensor", "by MSE", "by interior RMSE", "by normals"], rows)


def _winner(result: SensorResult, metric: str, among: Sequence[str] | None = None) -> str:
    """Return the method with the lowest mean, and its change against the noisy input in %."""
    names = {label: name for label, name in result.names.items() if not among or label in among}
    means = {label: result.table[name][metric].mean for label, name in names.items()}
    label = min(means, key=lambda label: means[label])
    base = means["noisy"]
    return f"{label} ({100 * (means[label] / base - 1):+.0f} %)" if base else label
