"""The paper's 39 printed values beside ours, with verdicts that chance does not give.

The paper states neither the origin of its depths nor whether its clean maps have holes: there are
four cases, two depth protocols times two kinds of clean maps. One of them is judged, ``JUDGED``.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from glsim.core.depth_protocol import MEANING, DepthProtocol
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import wrap_read_errors, write_atomic
from glsim.core.files.regular import read_csv
from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.metrics.frame_score import METRICS
from glsim.eval.paper.data_note import plan_size, run_note
from glsim.eval.paper.paper_tables import PAPER_COLUMNS, TRIVIAL, mean_and_spread
from glsim.eval.paper.printed_values import (
    COPIES,
    PRINTED_FILTERS,
    PRINTED_NETWORKS,
    TEXTS,
    VERDICTS,
    PrintedRow,
)
from glsim.eval.report.document import Document, TextTable, html_page
from glsim.eval.report.score_tables import format_number
from glsim.eval.scoring.trained_networks import SeedGroup, find_trained_runs, group_by_network

#: Folder of the filters' data sets and scores, within a reproduction's folder.
FILTERS_FOLDER: Final = "filters"
#: ``output.clean_mask`` -> its description in pages.
MASKS: Final = {"dense": "dense clean maps", "as-noisy": "BlenSor's mask"}
#: The judged case of all three tables, by the paper's text alone: "we automatically positioned the
#: faces at 1 millimetre"; no word of pixels that are removed from clean maps.
JUDGED: Final[tuple[DepthProtocol, str]] = ("paper", "dense")

_TEXTS: Final = TEXTS["values"]
#: Standard deviations over our seeds: 95 % of a normal distribution.
_SPREADS: Final = 2.0
_LEAST_SEEDS: Final = 3
#: Half of the last printed digit; smaller differences of printed values count as none.
_ROUNDING: Final = 5e-5

#: Means of one method: metric -> mean over frames.
_Means = dict[str, float]


@dataclass
class Case:
    """Our scores in one case: one depth protocol with one mask of clean maps.

    Attributes:
        seeds: row of the paper, or trivial prediction -> a pair for each seed: means of the method,
            and means of the noisy input on the same frames.
        networks: row -> the trainings behind it.
    """

    seeds: dict[str, list[tuple[_Means, _Means]]] = field(default_factory=dict)
    networks: dict[str, SeedGroup] = field(default_factory=dict)

    def cell(self, row: str, metric: str) -> str:
        """Return mean and standard deviation over seeds as text."""
        values = [means[metric] for means, _ in self.seeds.get(row, ())]
        return mean_and_spread(values, METRICS[metric].unit)


def mask_folder(out: Path, mask: str) -> Path:
    """Return the data folder of a mask in a reproduction; for dense maps, ``out``."""
    return out if mask == "dense" else out / f"mask_{mask}"


def case_folder(out: Path, protocol: DepthProtocol, mask: str = "dense") -> Path:
    """Return the folder with the networks and tables of a case, within a reproduction's folder."""
    folder = mask_folder(out, mask)
    return folder if protocol == "depth" else folder / f"protocol_{protocol}"


def read_case(folder: Path, protocol: DepthProtocol, mask: str) -> Case:
    """Read the scores of a case; without sets for table 1 alone, filters are those of the data."""
    case, of_networks = Case(), case_folder(folder, protocol, mask) / "table.csv"
    sets = sorted(folder.glob(f"{FILTERS_FOLDER}/{mask}/*/{protocol}/table.csv"))
    for table in sets or filter(Path.is_file, [of_networks]):
        means = read_means(table)
        if (trivial := table.with_name("baselines.csv")).is_file():
            means |= read_means(trivial)
        for name in (*PAPER_FILTERS, *TRIVIAL):
            if name in means:
                title = PRINTED_FILTERS[name].title if name in PRINTED_FILTERS else name
                case.seeds.setdefault(title, []).append((means[name], means["noisy"]))
    try:
        groups = group_by_network(find_trained_runs(of_networks.with_name("runs")).runs)
    except ConfigError:  # the folder has no trained network
        groups = []
    means = read_means(of_networks) if groups and of_networks.is_file() else {}
    for group in sorted(groups, key=lambda group: group.size == "full"):  # full size is preferred
        scored = [run.label for run in group.members if run.label in means]
        if group.row is not None and scored:
            case.networks[group.row] = group
            case.seeds[group.row] = [(means[label], means["noisy"]) for label in scored]
    for row, other in COPIES.items():
        if other in case.seeds:
            case.seeds.setdefault(row, case.seeds[other])
    return case


def read_means(path: Path) -> dict[str, _Means]:
    """Read table.csv or baselines.csv of ``glsim eval``: method -> metric -> mean over frames.

    Raises DatasetError if the file cannot be read, or is another table.
    """
    means: dict[str, _Means] = {}
    with wrap_read_errors(path):
        rows = read_csv(path)
    for row in rows:
        try:
            means.setdefault(row["method"], {})[row["metric"]] = float(row["mean"])
        except (KeyError, TypeError, ValueError) as error:
            raise DatasetError(f"{path}: is no table of glsim eval: {error!r}") from None
    return means


def printed_values() -> list[tuple[int, PrintedRow, str, float]]:
    """Return the 39 printed values in the order of the tables: (table, row, our metric, value)."""
    tables = [(1, row) for row in PRINTED_FILTERS.values()]
    tables += [(2 if row.title in ("Restormer", "UNet") else 3, row)
               for row in PRINTED_NETWORKS.values()]  # fmt: skip
    return [
        (table, row, metric, value)
        for table, row in tables
        for metric, value in zip(PAPER_COLUMNS, row[1:], strict=True)
    ]


def log_error(metric: str, value: float) -> float:
    """Return the logarithm of the error behind a score: MSE, the MSE of a PSNR, or 1 - SSIM."""
    if metric == "psnr_db":
        return -value * math.log(10) / 10
    error = 1 - value if metric.startswith("ssim") else value
    return math.log(max(error, 1e-9))


def verdict(row: str, metric: str, printed: float, case: Case) -> tuple[str, float]:
    """Judge a printed value by VERDICTS; also return the probability of "inside" by chance.

    By chance, the logarithm of our error lies anywhere in the range of the printed rows.
    """
    noisy = dict(zip(PAPER_COLUMNS, PRINTED_FILTERS["noisy"][1:], strict=True))[metric]
    seeds, group = case.seeds.get(row, []), case.networks.get(row)
    refused = {
        "baseline": row == PRINTED_FILTERS["noisy"].title,
        "copy": row in COPIES,
        "not scored": not seeds,
        "not trained": group is not None and not all(run.is_trained for run in group.members),
        "too few seeds": len(seeds) < _LEAST_SEEDS,
    }
    for reason, applies in refused.items():
        if applies:
            return reason, 0.0
    error = [log_error(metric, means[metric]) for means, _ in seeds]
    gain = [e - log_error(metric, of[metric]) for e, (_, of) in zip(error, seeds, strict=True)]
    margin, apart = (_SPREADS * statistics.stdev(values) for values in (error, gain))
    range_ = [log_error(metric, value) for _, _, name, value in printed_values() if name == metric]
    chance = min(1.0, 2 * margin / (max(range_) - min(range_)))
    ours, claim = statistics.fmean(gain), log_error(metric, printed) - log_error(metric, noisy)
    if abs(statistics.fmean(error) - log_error(metric, printed)) <= margin:
        return "inside the spread", chance
    if abs(printed - noisy) < _ROUNDING or abs(ours) <= apart:
        return "not told apart", chance
    if ours * claim < 0:
        return "other side", chance
    return ("same side" if abs(ours - claim) < math.log(10) else "other size"), chance


def write_values(folder: Path) -> list[Path]:
    """Write paper_values.md, .tex and .html to a reproduction's folder.

    Raises:
        DatasetError: for a table that cannot be read.
        GlsimError: without Jinja2.
    """
    case = read_case(folder, *JUDGED)
    runs = [run for group in case.networks.values() for run in group.members]
    note = run_note(mask_folder(folder, JUDGED[1]) / "data", runs)
    document = values_document(case, plan_size(folder), note)
    texts = {"md": document.markdown(), "tex": document.latex()}
    texts["html"] = html_page(document.title, [document])
    paths = [folder / f"paper_values.{suffix}" for suffix in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        write_atomic(text.encode(), path)
    return paths


def values_document(case: Case, size: str, note: str) -> Document:
    """Return the page that lists all printed values with our values; ``note``: of ``run_note``."""
    rows, counts = [], Counter[str]()
    chances = {"inside the spread": 0.0, "same side": 0.0}
    for table, row, metric, printed in printed_values():
        judged, chance = verdict(row.title, metric, printed, case)
        counts[judged] += 1
        chances["inside the spread"] += chance
        if judged.endswith(("spread", "side", "size")):  # a coin would decide the side
            chances["same side"] += (1 - chance) / 2
        group = case.networks.get(row.title)
        name = f"{row.title} ({group.training})" if group else row.title
        text = f"{judged} of {COPIES[row.title]}" if judged == "copy" else judged
        cells = [format_number(printed, METRICS[metric].unit), case.cell(row.title, metric)]
        rows.append([str(table), name, metric.split("_")[0].upper(), *cells, f"**{text}**"])
    for name in TRIVIAL:
        rows.append(["-", name, "MSE", "-", case.cell(name, "mse_mm2"), "a scale"])
    expected = {name: f"{number:.1f}" for name, number in chances.items()}
    return Document(
        f"The 39 printed values{size}",
        [
            _TEXTS["source"],
            _TEXTS["case"].format(protocol=MEANING[JUDGED[0]], mask=MASKS[JUDGED[1]]),
            note,
            TextTable(
                ["verdict", "values", "by chance", "rule, the first that holds"],
                [[n, str(counts[n]), expected.get(n, "-"), rule] for n, rule in VERDICTS.items()],
            ),
            TextTable(["table", "row", "metric", "printed", "ours", "verdict"], rows),
        ],
    )
