"""Comparison of the paper's 39 printed values with our values in four cases, with verdicts.

The paper states neither the origin of its depths nor whether its clean maps have holes. So there
are four cases: two depth protocols (``glsim.core.depth_protocol``) times two kinds of clean maps.
Clean maps are dense, or as in BlenSor: without depth wherever the noisy map has none.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, get_args

from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import wrap_read_errors, write_atomic
from glsim.core.files.regular import read_csv
from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.metrics.frame_score import METRICS
from glsim.eval.paper.paper_tables import PAPER_COLUMNS, TRIVIAL, mean_and_spread, with_twins
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS, PrintedRow
from glsim.eval.report.document import Document, TextTable, html_page
from glsim.eval.report.score_tables import format_number
from glsim.eval.scoring.trained_networks import find_trained_runs, group_by_network

#: Folder of the filters' data sets and scores, within a reproduction's folder.
FILTERS_FOLDER: Final = "filters"
#: ``output.clean_mask`` -> its description in pages.
MASKS: Final = {"dense": "dense clean maps", "as-noisy": "BlenSor's mask"}

Verdict = Literal["inside the seeds' spread", "same order", "other order", "not comparable"]
VERDICTS: Final[dict[Verdict, str]] = {
    "inside the seeds' spread": "in some case at most two standard deviations of our seeds away",
    "same order": "in some case all seeds lie on the printed side of the noisy input",
    "other order": "in no case they do",
    "not comparable": "not scored, or the noisy input itself, whose noise is the paper's own",
}
#: Standard deviations over our seeds within which a value is reproduced: 95 % of a normal one.
_SPREADS: Final = 2.0
#: Half of the last printed digit; smaller differences from the noisy input count as 0.
_ROUNDING: Final = 5e-5

#: Means of one method: metric -> mean over frames.
_Means = dict[str, float]


@dataclass
class Case:
    """Our scores in one case: one depth protocol with one mask of clean maps.

    Attributes:
        title: protocol and mask.
        seeds: row of the paper, or trivial prediction -> a pair for each seed: means of the method,
            and means of the noisy input on the same frames.
        sizes: row -> size of the network.
    """

    title: str
    seeds: dict[str, list[tuple[_Means, _Means]]] = field(default_factory=dict)
    sizes: dict[str, str] = field(default_factory=dict)

    def values(self, row: str, metric: str) -> list[float]:
        """Return the mean of a metric for each seed; empty for a row that was not scored."""
        return [means[metric] for means, _ in self.seeds.get(row, ())]


def mask_folder(out: Path, mask: str) -> Path:
    """Return the data folder of a mask in a reproduction; for dense maps, ``out``."""
    return out if mask == "dense" else out / f"mask_{mask}"


def case_folder(out: Path, protocol: DepthProtocol, mask: str = "dense") -> Path:
    """Return the folder with the networks and tables of a case, within a reproduction's folder."""
    folder = mask_folder(out, mask)
    return folder if protocol == "depth" else folder / f"protocol_{protocol}"


def read_cases(folder: Path) -> list[Case]:
    """Read the scores of the four cases of a reproduction; a case without scores has no rows."""
    cases = []
    for protocol in get_args(DepthProtocol):
        for mask, words in MASKS.items():
            case = Case(f"protocol {protocol}, {words}")
            for table in sorted(folder.glob(f"{FILTERS_FOLDER}/{mask}/*/{protocol}/table.csv")):
                _add_filters(case, table)
            _add_networks(case, case_folder(folder, protocol, mask))
            cases.append(case)
    return cases


def _add_filters(case: Case, path: Path) -> None:
    means = read_means(path)
    trivial = path.with_name("baselines.csv")
    if trivial.is_file():
        means |= read_means(trivial)
    for name in (*PAPER_FILTERS, *TRIVIAL):
        if name in means:
            title = PRINTED_FILTERS[name].title if name in PRINTED_FILTERS else name
            case.seeds.setdefault(title, []).append((means[name], means["noisy"]))


def _add_networks(case: Case, folder: Path) -> None:
    """Add the scores of trained networks to a case; per row, the full size is preferred."""
    if not (folder / "table.csv").is_file():
        return
    try:
        groups = with_twins(group_by_network(find_trained_runs(folder / "runs").runs))
    except ConfigError:  # the folder has no trained network
        return
    means = read_means(folder / "table.csv")
    for group in sorted(groups, key=lambda group: group.size == "full"):
        scored = [run.label for run in group.members if run.label in means]
        if group.row is not None and scored:
            case.sizes[group.row] = group.size
            case.seeds[group.row] = [(means[label], means["noisy"]) for label in scored]


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


def verdict(row: str, metric: str, printed: float, cases: Sequence[Case]) -> Verdict:
    """Judge a printed value by the rules of VERDICTS."""
    scored = [case for case in cases if row in case.seeds]
    for case in scored:
        values = case.values(row, metric)
        if len(values) > 1:
            off = abs(statistics.fmean(values) - printed)
            if off <= _SPREADS * statistics.stdev(values) + _ROUNDING:
                return "inside the seeds' spread"
    of_noisy = PRINTED_FILTERS["noisy"]
    if not scored or row == of_noisy.title:
        return "not comparable"
    noisy_printed = dict(zip(PAPER_COLUMNS, of_noisy[1:], strict=True))[metric]
    wanted = _side(printed, noisy_printed)
    for case in scored:
        if {_side(means[metric], noisy[metric]) for means, noisy in case.seeds[row]} == {wanted}:
            return "same order"
    return "other order"


def _side(value: float, noisy: float) -> int:
    """Return the sign of value - noisy; 0 for a difference below the printed precision."""
    return 0 if abs(value - noisy) < _ROUNDING else int(math.copysign(1, value - noisy))


def write_values(folder: Path) -> list[Path]:
    """Write paper_values.md and paper_values.html to a reproduction's folder.

    Raises:
        DatasetError: for a table that cannot be read.
        GlsimError: without Jinja2.
    """
    document = values_document(read_cases(folder))
    texts = {"md": document.markdown(), "html": html_page("The paper, value by value", [document])}
    paths = [folder / f"paper_values.{suffix}" for suffix in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        write_atomic(text.encode(), path)
    return paths


def values_document(cases: Sequence[Case]) -> Document:
    """Return the page that lists all printed values with our values."""
    rows, counts = [], Counter[str]()
    for table, row, metric, printed in printed_values():
        unit = METRICS[metric].unit
        judged = verdict(row.title, metric, printed, cases)
        counts[judged] += 1
        sizes = sorted({case.sizes[row.title] for case in cases if row.title in case.sizes})
        name = f"{row.title} ({', '.join(sizes)})" if sizes else row.title
        cells = [_cell(case, row.title, metric) for case in cases]
        title = metric.split("_")[0].upper()
        value = format_number(printed, unit)
        rows.append([str(table), name, title, value, *cells, f"**{judged}**"])
    for name in TRIVIAL:
        cells = [_cell(case, name, "mse_mm2") for case in cases]
        rows.append(["-", name, "MSE", "-", *cells, "a scale"])
    titles = [case.title for case in cases]
    return Document(
        "The 39 printed values",
        [
            'Kendrick, Yap and Tan, "Synthetic Data Generation for Demonstrating Noise Reduction '
            'in Facial Depth Imaging", tables 1 to 3: MSE in mm², PSNR in dB, SSIM with L = 65535. '
            "Ours are means over seeds ± their standard deviation in four cases: depth as measured "
            "or with the nearest point at 1 mm, dense clean maps or BlenSor's mask. A network that "
            "was trained smaller than published says so, and its verdict stands for that size.",
            TextTable(
                ["verdict", "values", "rule, the first that holds"],
                [[name, str(counts[name]), rule] for name, rule in VERDICTS.items()],
            ),
            TextTable(["table", "row", "metric", "printed", *titles, "verdict"], rows),
        ],
    )


def _cell(case: Case, row: str, metric: str) -> str:
    return mean_and_spread(case.values(row, metric), METRICS[metric].unit)
