"""Write findings.html: which relations of the printed tables hold in our scores, what is open."""

from __future__ import annotations

import csv
import math
import re
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Final

from glsim.dataset import open_dataset
from glsim.depth_protocol import MEANING
from glsim.eval.paper.cases import (
    MASKS,
    PaperCase,
    case_folder,
    read_filter_cases,
    read_means,
)
from glsim.eval.paper.data_note import data_note
from glsim.eval.paper.figures.write import FOLDER as FIGURES_FOLDER
from glsim.eval.paper.filter_table import yes_or_no
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS
from glsim.eval.paper.protocol_page import conclusions, relation_table
from glsim.eval.paper.runs import (
    ARTEFACT_REMOVAL,
    SeedGroup,
    find_trained_runs,
    group_by_network,
    with_twins,
)
from glsim.eval.report.document import CaptionedPng, Document, Heading, TextTable
from glsim.eval.report.page import html_page
from glsim.eval.report.tables import format_number
from glsim.files.atomic import wrap_read_errors, write_atomic

#: Names of the page's files in the folder of a reproduction.
FINDINGS: Final = ("findings.md", "findings.html")
_BASELINE, _MEDIAN = PRINTED_FILTERS["noisy"].title, PRINTED_FILTERS["median"].title

#: MSE by row of tables 1 to 3, mm^2.
Mse = Mapping[str, float]

#: Relation of the printed tables 2 and 3 -> the rows that it needs, and whether it holds.
_RELATIONS: Final[dict[str, tuple[tuple[str, ...], Callable[[Mse], bool]]]] = {
    "every network has a larger MSE than the noisy input": (
        tuple(PRINTED_NETWORKS),
        lambda mse: all(mse[row] > mse[_BASELINE] for row in PRINTED_NETWORKS),
    ),
    "every network has a larger MSE than Median": (
        tuple(PRINTED_NETWORKS),
        lambda mse: all(mse[row] > mse[_MEDIAN] for row in PRINTED_NETWORKS),
    ),
    "Restormer has the largest MSE, UNet the next": (
        tuple(PRINTED_NETWORKS),
        lambda mse: sorted(PRINTED_NETWORKS, key=lambda r: -mse[r])[:2] == ["Restormer", "UNet"],
    ),
    "deeper DnCNNs have a smaller MSE: D64 < D20 < D7": (
        ("D7", "D20", "D64"),
        lambda mse: mse["D64"] < mse["D20"] < mse["D7"],
    ),
    "artefact removal lowers the MSE of D7": (
        ("D7", "AR D7"),
        lambda mse: mse["AR D7"] < mse["D7"],
    ),
    "artefact removal raises the MSE of D64": (
        ("D64", "AR D64"),
        lambda mse: mse["AR D64"] > mse["D64"],
    ),
}

#: Questions to the authors, and what the answers decide.
_QUESTIONS: Final = (
    "Was table 1 scored on faces whose nearest point is at 1 mm? The order of its filters and its "
    "(1 - SSIM) / MSE speak for it.",
    "Were tables 2 and 3 scored on the same maps as table 1? Their (1 - SSIM) / MSE, 3.3 to 5.5e-7 "
    "per mm² against 9.9e-7 of the baseline in table 1, speaks for depth as measured, near 900 mm. "
    "Then no row of theirs can be compared with a row of table 1.",
    "Do the clean maps of each table have the holes of the noisy ones, as BlenSor writes them, or "
    "none?",
    "Which type of number, which L and which program gave the SSIM of each row of table 1?",
    "What did the networks see and return? At 900 mm an MSE of 34,000 to 80,000 mm² is that of 682 "
    "to 1,619 pixels that are a hole in one map only; at 1 mm it would be many times the MSE of a "
    "map of zeros. One noisy map, the output of one network for it, and the clean map beside them "
    "would decide it.",
    "How many images did D3DFACS, FaceWarehouse and Biwi give, and which settings had BlenSor's "
    "noise?",
    "What is inverted by artefact removal? In deepinv's class it is the measurement operator, that "
    "is, the identity for denoising: then rows with and without it are the same network. That the "
    "paper used this class so is an inference.",
)


def write_findings(folder: Path) -> list[Path]:
    """Write findings.md and findings.html to the folder of a reproduction.

    Args:
        folder: of ``glsim paper reproduce``, with data, networks, tables and figures.

    Returns:
        The written files.

    Raises:
        ConfigError, DatasetError, DenoiserError: for a folder that holds no reproduction.
        GlsimError: without Jinja2.
    """
    document = _document(folder)
    title = "A reproduction of Kendrick, Yap and Tan"
    page = html_page(title, [document], _pictures(folder / FIGURES_FOLDER))
    written = [folder / name for name in FINDINGS]
    for path, text in zip(written, (document.markdown(), page), strict=True):
        write_atomic(text.encode(), path)
    return written


def _document(folder: Path) -> Document:
    cases = read_filter_cases(folder)
    places = {
        PaperCase(protocol, mask).title: place
        for protocol, mask in product(MEANING, MASKS)
        if ((place := case_folder(folder, protocol, mask)) / "table.csv").is_file()
    }
    groups = {
        title: with_twins(group_by_network(find_trained_runs(place / "runs")[0]))
        for title, place in places.items()
    }
    mse = {title: _mse_by_row(place, groups[title]) for title, place in places.items()}
    relations = _network_relations(mse)
    document = Document(
        "What holds, what does not, what is open",
        [
            'Kendrick, Yap and Tan, "Synthetic Data Generation for Demonstrating Noise Reduction '
            'in Facial Depth Imaging". The printed numbers beside ours are in paper_table_1.md to '
            f"paper_table_3.md. {data_note(open_dataset(folder / 'data'))}",
            [f"protocol {name}: {text}" for name, text in MEANING.items()],
            Heading("Table 1, filters"),
            "In how many sets of other people and other noise a relation of the printed table "
            "holds:",
            relation_table(cases),
            list(conclusions(cases)),
            "Which reading of the text gives the printed SSIM, and how nearly, is measured in "
            "filters/*/*/ssim_readings.md.",
            Heading("Tables 2 and 3, networks"),
            _sizes([group for found in groups.values() for group in found]),
            relations,
            list(_ranges(mse)),
        ],
    )
    if photographs := list(_photographs(folder / "photographs.csv")):
        document.parts += [Heading("Networks of photographs, on depth"), photographs]
    document.parts += [
        Heading("What it takes to find out"),
        "Answers of the authors:",
        list(_QUESTIONS),
        "And on our side: all rows at full size (`glsim paper reproduce --size full`, with a GPU), "
        "with the paper's face sets (`--d3dfacs`, `--facewarehouse`, `--biwi`).",
    ]
    return document


def _mse_by_row(folder: Path, groups: Sequence[SeedGroup]) -> dict[str, float]:
    """Average the MSE of each row of the paper's tables over the seeds, mm^2.

    A row with artefact removal has its partner's MSE plus the mean difference between the two in
    the seeds that both have.

    Args:
        folder: of a case, with table.csv.
        groups: its trained networks.
    """
    means = read_means(folder / "table.csv")
    by_label = {method: values["mse_mm2"] for method, values in means.items()}
    mse = {
        printed.title: by_label[name]
        for name, printed in PRINTED_FILTERS.items()
        if name in by_label
    }
    seeds = {
        str(group.row): {
            run.seed: by_label[run.label] for run in group.members if run.label in by_label
        }
        for group in groups
        if group.row is not None
    }
    for row, of_seeds in seeds.items():
        plain = seeds.get(row.removeprefix(ARTEFACT_REMOVAL), {})
        both = of_seeds.keys() & plain.keys()
        if row.startswith(ARTEFACT_REMOVAL) and both:
            difference = statistics.fmean(of_seeds[seed] - plain[seed] for seed in both)
            mse[row] = statistics.fmean(plain.values()) + difference
        elif of_seeds:
            mse[row] = statistics.fmean(of_seeds.values())
    return mse


def _network_relations(mse: Mapping[str, Mse]) -> TextTable:
    """Tabulate the relations of the printed tables that hold in each case, by its title."""
    printed = {row.title: row.mse_mm2 for row in PRINTED_FILTERS.values()}
    printed |= {title: row.mse_mm2 for title, row in PRINTED_NETWORKS.items()}
    table = []
    for text, (needed, holds) in _RELATIONS.items():
        cells = [yes_or_no(holds(printed))]
        for values in mse.values():
            missing = [row for row in (*needed, _BASELINE, _MEDIAN) if row not in values]
            absent = f"not scored: {', '.join(missing)} not trained"
            cells.append(absent if missing else yes_or_no(holds(values)))
        table.append([text, *cells])
    return TextTable(["relation", "printed", *mse], table)


def _ranges(mse: Mapping[str, Mse]) -> Iterator[str]:
    """Describe the range of the networks' MSE relative to the noisy input's."""
    for title, values in mse.items():
        networks = {row: values[row] for row in PRINTED_NETWORKS if row in values}
        if not networks or _BASELINE not in values:
            continue
        ratios = [value / values[_BASELINE] for value in networks.values()]
        printed = [
            PRINTED_NETWORKS[row].mse_mm2 / PRINTED_FILTERS["noisy"].mse_mm2 for row in networks
        ]
        yield (
            f"{title}: the networks have {min(ratios):.2f} to {max(ratios):.2f} times the "
            f"MSE of the noisy input ({format_number(values[_BASELINE])} mm²); printed are "
            f"{min(printed):.1f} to {max(printed):.1f} times."
        )


def _sizes(groups: Sequence[SeedGroup]) -> str:
    """Describe the sizes of the networks of the rows."""
    rows = [group for group in groups if group.row is not None and not group.twin]
    smaller = [group for group in rows if group.size != "full"]
    if not smaller:
        return "All rows were trained at the printed size."
    minutes = [run.minutes for group in smaller for run in group.members]
    return (
        f"{len(smaller)} of {len(rows)} rows were trained smaller than printed, for "
        f"{min(minutes):.1f} to {max(minutes):.1f} minutes: they show trends, and what they do not "
        "show may still hold at full size."
    )


def _photographs(path: Path) -> Iterator[str]:
    """Summarise photographs.md: networks trained on photographs, scored on depth."""
    if not path.is_file():
        return
    with wrap_read_errors(path):
        rows = list(csv.DictReader(path.read_text().splitlines()))
    name = "both_interior_rmse_mm"
    (noisy_mm,) = (float(row[name]) for row in rows if row["network"] == "noisy")
    groups: dict[tuple[str, str, str], list[dict[str, str]]] = {}
    for row in rows:
        if row["trained_on"]:
            key = row["network"], row["trained_on"], row["holes"]
            groups.setdefault(key, []).append(row)
    for (network, trained_on, holes), seeds in groups.items():
        ratio = statistics.fmean(float(row[name]) for row in seeds) / noisy_mm
        if not math.isfinite(ratio):  # photographs.md says why
            continue
        left = statistics.fmean(float(row["left_of_noise"]) for row in seeds)
        unlearnt = f" It has not learnt its own task: {left:.2f} of its noise is left."
        yield (
            f"{network}, trained on {trained_on}, holes {holes}: the interior error is {ratio:.2f} "
            f"times the noisy input's ({len(seeds)} seeds).{unlearnt if left > 1 else ''}"
        )


def _pictures(folder: Path) -> list[CaptionedPng]:
    """Read the figures that ``glsim paper figures`` drew, with their captions."""
    captions = folder / "captions.md"
    if not captions.is_file():
        return []
    found = re.findall(r"^- \*\*(\w+)\.png\*\*: (.+)$", captions.read_text(), re.MULTILINE)
    return [
        CaptionedPng(name, caption, (folder / f"{name}.png").read_bytes())
        for name, caption in found
        if (folder / f"{name}.png").is_file()
    ]
