"""The same faces through several sensors: does the ranking of the filters survive the noise?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from glsim.config import load_settings
from glsim.dataset import generate
from glsim.dataset.run import Progress as Generated
from glsim.errors import ConfigError
from glsim.sensor import sensor_names

from .blocks import Scoring
from .denoisers import PAPER
from .run import Evaluation, Progress, evaluate
from .tables import Table, number
from .tune import tune

#: What is compared unless told otherwise, as far as it is shipped.
SENSORS: Final = ("kinect-v2-paper", "kinect-v2", "kinect-v2-fast", "led3d")
#: Filters that are tuned on each sensor's validation split and scored beside the paper's.
RIVALS: Final = ("masked_bilateral", "quadric")
#: No subject is trained on: some to tune with, all others to score.
_SPLIT: Final = (0.0, 0.2, 0.8)

#: Metric -> heading of its table.
_TABLES: Final = {
    "mse_mm2": "MSE over all pixels [mm²]",
    "both_interior_rmse_mm": "RMSE, interior, valid in both [mm]",
    "normal_mean_deg": "normals [°]",
    "flying_px": "flying pixels",
}


@dataclass(frozen=True, eq=False)
class Result:
    """Of one sensor. names: label in the tables -> method."""

    sensor: str
    evaluation: Evaluation
    table: Table
    names: dict[str, str]


def choose(sensors: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """(sensors to run, those of SENSORS that this glsim does not have). ConfigError for unknown."""
    known = sensor_names()
    if sensors:
        return list(sensors), []
    found: list[str] = [name for name in SENSORS if name in known]
    if not found:
        raise ConfigError(f"none of {', '.join(SENSORS)} is shipped")
    return found, [name for name in SENSORS if name not in known]


def study(
    out: Path,
    sensors: Sequence[str],
    overrides: dict[str, Any],
    source: dict[str, Any],
    *,
    workers: int,
    generating: Callable[[str], Callable[[Generated], None] | None] = lambda _: None,
    scoring: Callable[[str], Callable[[Progress], None] | None] = lambda _: None,
) -> list[Result]:
    """Make the same faces with each sensor, and score the paper's filters and tuned rivals.

    out: gets a folder for each sensor with its data set and its scores; all of it is resumable.
    overrides, source: settings of the data sets, see ``load_settings``. The callbacks make the
    progress reports of each sensor.
    """
    results = []
    for sensor in sensors:
        tree = {"split": _SPLIT} | overrides | {"sensor": sensor}
        data, scores = out / sensor / "data", out / sensor / "scores"
        generate(load_settings(None, [], tree, source), data, workers=workers,
                 progress=generating(sensor))  # fmt: skip
        val = Scoring(data, "val", ())
        names = {name: name for name in PAPER}
        for rival in tune(val, RIVALS, scores, workers=workers):
            names[f"{rival.name}, tuned"] = rival.plain
            names[f"{rival.name}, tuned, mask cleaned"] = rival.cleaned
        job = Scoring(data, "test", tuple(names.values()))
        found = evaluate(job, scores, workers=workers, progress=scoring(sensor))
        results.append(Result(sensor, found, found.summary.compared(), names))
    return results


def report(results: Sequence[Result], absent: Sequence[str]) -> str:
    """Markdown: the noise of each sensor, Table 1 of each, and which filter wins by what."""
    frames, subjects = results[0].evaluation.frames, len(results[0].evaluation.summary.subjects)
    lines = [
        "# The same faces through several sensors",
        "",
        f"{frames} frames of {subjects} subjects for each sensor; the rivals are tuned on others.",
        "",
    ]
    if absent:
        lines += [f"Not in this glsim, and so left out: {', '.join(absent)}.", ""]
    columns = (
        *("mse_mm2", "mse_flips_pct", "flips_px", "flying_px", "both_interior_bias_mm"),
        *("both_interior_rmse_mm", "both_edge_rmse_mm", "normal_mean_deg"),
    )
    lines += [
        "## The noise",
        "",
        "| sensor | MSE [mm²] | of it in flipped pixels [%] | flipped pixels | flying pixels | "
        "interior bias [mm] | interior RMSE [mm] | edge RMSE [mm] | normals [°] |",
        "|---" * (len(columns) + 1) + "|",
    ]
    for result in results:
        noisy = result.table["noisy"]
        cells = " | ".join(number(noisy[name].mean) for name in columns)
        lines.append(f"| `{result.sensor}` | {cells} |")
    labels = list(results[0].names)
    for metric, title in _TABLES.items():
        lines += ["", f"## {title}", "", f"| sensor | {' | '.join(labels)} |"]
        lines.append("|---" * (len(labels) + 1) + "|")
        for result in results:
            means = {label: result.table[name][metric].mean for label, name in result.names.items()}
            top = min(means.values())
            cells = " | ".join(
                f"**{number(value)}**" if number(value) == number(top) else number(value)
                for value in means.values()
            )
            lines.append(f"| `{result.sensor}` | {cells} |")
    lines += ["", "## Who wins", "", "| sensor | by MSE | by interior RMSE | by normals |"]
    lines.append("|---|---|---|---|")
    for result in results:
        winners = [_winner(result, metric) for metric in list(_TABLES)[:3]]
        lines.append(f"| `{result.sensor}` | {' | '.join(winners)} |")
    lines += ["", "Among the paper's filters alone:", ""]
    lines += ["| sensor | by MSE | by interior RMSE | by normals |", "|---|---|---|---|"]
    for result in results:
        winners = [_winner(result, metric, PAPER) for metric in list(_TABLES)[:3]]
        lines.append(f"| `{result.sensor}` | {' | '.join(winners)} |")
    lines += ["", "The rivals' settings, chosen on the validation subjects of each sensor:", ""]
    for result in results:
        chosen = [f"`{name}`" for name in result.names.values() if name not in PAPER]
        lines.append(f"- `{result.sensor}`: {', '.join(chosen)}")
    return "\n".join(lines) + "\n"


def _winner(result: Result, metric: str, among: Sequence[str] | None = None) -> str:
    names = {label: name for label, name in result.names.items() if not among or label in among}
    means = {label: result.table[name][metric].mean for label, name in names.items()}
    label = min(means, key=lambda label: means[label])
    base = means["noisy"]
    return f"{label} ({100 * (means[label] / base - 1):+.0f} %)" if base else label
