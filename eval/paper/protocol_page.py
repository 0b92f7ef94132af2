"""Write protocols.md: table 1 in the four cases, and which of its relations hold in our scores."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from glsim.denoise import PAPER_FILTERS
from glsim.depth_protocol import MEANING
from glsim.eval.metrics.score import METRICS
from glsim.eval.paper.cases import CASE_METRICS, PaperCase
from glsim.eval.paper.filter_table import NOTHING_LOSES_TO, yes_or_no
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PrintedRow
from glsim.eval.report.document import Document, Heading, TextTable
from glsim.eval.report.tables import format_number

#: The paper's column of each metric that it has.
_PRINTED: Final = {"mse_mm2": 1, "psnr_db": 2, "ssim_paper": 3}
#: The filters that change single frames.
_CHANGING: Final = ("median", "nlm", "bilateral")


def protocol_document(cases: list[PaperCase]) -> Document:
    """Return the page of table 1 in all cases.

    Args:
        cases: those in which filters were scored.
    """
    frames = ", ".join(
        f"{case.frames} of {len(case.values['noisy']['mse_mm2'])} seeds ({case.title})"
        for case in cases
    )
    document = Document(
        "Table 1 under both protocols, with and without BlenSor's mask",
        [
            "Means over seeds ± their standard deviation; each seed has other people and other "
            f"noise. Frames: {frames}.",
            [f"protocol {name}: {meaning}" for name, meaning in MEANING.items()],
        ],
    )
    document.parts += [Heading("MSE over the baseline's"), _ratio_table(cases)]
    for metric in CASE_METRICS:
        document.parts += [Heading(METRICS[metric].heading), _metric_table(cases, metric)]
    document.parts += [
        Heading("(1 - SSIM) / MSE, 1e-7 per mm²"),
        "SSIM with K1 = 0.01, K2 = 0.03, L = 65535. The ratio hardly depends on the size of the "
        "errors; it depends on the depth around them, and on their extent.",
        _dissimilarity_table(cases),
        Heading("Relations of the printed table"),
        relation_table(cases),
        Heading("What this says"),
        list(conclusions(cases)),
    ]
    return document


#: The rows whose printed SSIM fits 16-bit maps, see ``glsim.eval.paper.ssim_readings``.
_OF_16_BIT: Final = ("noisy", "median")


def dissimilarity_per_mse(ssim: float, mse_mm2: float) -> float:
    """Return (1 - SSIM) / MSE, 1e-7 per mm^2.

    With L of 16-bit maps, C1 and C2 dominate, and 1 - SSIM is a sum of squared errors with weights
    that decrease with depth: the ratio shows where depth is counted from.
    """
    return 1e7 * (1 - ssim) / mse_mm2


def _dissimilarities(case: PaperCase, name: str) -> list[float]:
    """Compute ``dissimilarity_per_mse`` of a filter seed by seed, without seeds of no error."""
    values = case.values[name]
    pairs = zip(values["ssim_16bit"], values["mse_mm2"], strict=True)
    return [dissimilarity_per_mse(ssim, mse) for ssim, mse in pairs if mse > 0]


def _dissimilarity_table(cases: list[PaperCase]) -> TextTable:
    """Tabulate ``dissimilarity_per_mse`` of each case below the printed one and its rounding."""
    printed = []
    for name in _OF_16_BIT:
        row = PRINTED_FILTERS[name]
        rounding = dissimilarity_per_mse(1 - 0.00005, row.mse_mm2)
        value = dissimilarity_per_mse(row.ssim, row.mse_mm2)
        printed.append(f"{value:.2f} ± {rounding:.2f} (rounding)")
    rows = [["printed", *printed]]
    for case in cases:
        cells = [_cell(_dissimilarities(case, name) or [float("nan")], "") for name in _OF_16_BIT]
        rows.append([case.title, *cells])
    return TextTable(["case", *(PRINTED_FILTERS[name].title for name in _OF_16_BIT)], rows)


def _head(trivial: Sequence[str]) -> list[str]:
    return ["case", *(PRINTED_FILTERS[name].title for name in PAPER_FILTERS), *trivial]


def _trivial(cases: Sequence[PaperCase]) -> list[str]:
    """Return the trivial predictions that were scored in some case."""
    return [name for name in NOTHING_LOSES_TO if any(name in case.values for case in cases)]


def _cell(values: list[float], unit: str) -> str:
    text = format_number(statistics.fmean(values), unit)
    if len(values) < 2 or not all(map(math.isfinite, values)):  # zeros have no interior
        return text
    return f"{text} ± {format_number(statistics.stdev(values), unit)}"


def _ratio_table(cases: list[PaperCase]) -> TextTable:
    base = PRINTED_FILTERS["noisy"].mse_mm2
    trivial = _trivial(cases)
    printed = [f"{PRINTED_FILTERS[name].mse_mm2 / base:.3f}" for name in PAPER_FILTERS]
    rows = [["printed", *printed, *("-" for _ in trivial)]]
    for case in cases:
        cells = []
        for name in (*PAPER_FILTERS, *trivial):
            ratios = case.ratios(name) if name in case.values else []
            spread = f" ± {statistics.stdev(ratios):.3f}" if len(ratios) > 1 else ""
            cells.append(f"{statistics.fmean(ratios):.3f}{spread}" if ratios else "n/a")
        rows.append([case.title, *cells])
    return TextTable(_head(trivial), rows)


def _metric_table(cases: list[PaperCase], metric: str) -> TextTable:
    unit, trivial = METRICS[metric].unit, _trivial(cases)
    rows = []
    if metric in _PRINTED:
        place = _PRINTED[metric]
        printed = [float(PRINTED_FILTERS[n][place]) for n in PAPER_FILTERS]
        cells = [format_number(value, unit) for value in printed]
        rows.append(["printed", *cells, *("-" for _ in trivial)])
    for case in cases:
        values = [case.values.get(name) for name in (*PAPER_FILTERS, *trivial)]
        cells = [_cell(of_name[metric], unit) if of_name else "n/a" for of_name in values]
        rows.append([case.title, *cells])
    return TextTable(_head(trivial), rows)


#: Relation of the printed table -> whether it holds for MSEs by filter.
_RELATIONS: Final[dict[str, Callable[[Mapping[str, float]], bool]]] = {
    "every filter lowers the MSE": lambda mse: all(mse[n] < mse["noisy"] for n in _CHANGING),
    "NLM has the lowest MSE": lambda mse: min(mse, key=lambda n: mse[n]) == "nlm",
    "Bilateral is below Median": lambda mse: mse["bilateral"] < mse["median"],
    "Adaptive equals Baseline": lambda mse: mse["adaptive"] == mse["noisy"],
}


def relations(mse: Mapping[str, float]) -> dict[str, bool]:
    """Test the relations of the printed table 1.

    Args:
        mse: filter -> MSE, mm^2, the noisy input included.

    Returns:
        Relation -> whether it holds.
    """
    return {name: holds(mse) for name, holds in _RELATIONS.items()}


def relation_table(cases: list[PaperCase]) -> TextTable:
    """Tabulate in how many seeds of each case a relation of the printed table 1 holds.

    Args:
        cases: those in which filters were scored.
    """
    printed = relations({n: row.mse_mm2 for n, row in PRINTED_FILTERS.items()})
    rows = [["printed", *map(yes_or_no, printed.values())]]
    for case in cases:
        seeds = range(len(case.values["noisy"]["mse_mm2"]))
        held = [
            relations({n: case.values[n]["mse_mm2"][seed] for n in PAPER_FILTERS}) for seed in seeds
        ]
        counts = [f"{sum(one[name] for one in held)} of {len(held)}" for name in _RELATIONS]
        rows.append([case.title, *counts])
    return TextTable(["case", *_RELATIONS], rows)


def largest_ratio_difference(case: PaperCase) -> float:
    """Return how far the filters' MSE over the baseline's is from the printed one, at most.

    Args:
        case: with scores of the filters.
    """
    return max(
        abs(statistics.fmean(case.ratios(name)) - _printed_ratio(PRINTED_FILTERS[name]))
        for name in _CHANGING
    )


def _printed_ratio(row: PrintedRow) -> float:
    return row.mse_mm2 / PRINTED_FILTERS["noisy"].mse_mm2


def conclusions(cases: list[PaperCase]) -> Iterator[str]:
    """Compare each case with the MSE and the SSIM that table 1 prints.

    Args:
        cases: those in which filters were scored.

    Yields:
        A sentence for each case, and for each measure the case that comes nearest.
    """
    printed = PRINTED_FILTERS["noisy"].mse_mm2
    for case in cases:
        mse, share = case.mean("noisy", "mse_mm2"), case.mean("noisy", "mse_flips_pct")
        yield (
            f"{case.title}: the baseline is {format_number(mse)} mm², {mse / printed:.2f} of the "
            f"printed one; {share:.1f} % of it is in flipped pixels; the ratios of the filters are "
            f"within {largest_ratio_difference(case):.3f} of the printed ones."
        )
    nearest = min(cases, key=largest_ratio_difference)
    yield f"The printed ratios are nearest to those of {nearest.title}."
    row = PRINTED_FILTERS["noisy"]
    wanted = dissimilarity_per_mse(row.ssim, row.mse_mm2)
    known = {case.title: values for case in cases if (values := _dissimilarities(case, "noisy"))}
    if known:
        like = min(known, key=lambda title: abs(math.log(statistics.fmean(known[title]) / wanted)))
        yield f"The printed (1 - SSIM) / MSE of the baseline is nearest to that of {like}."
    scale = min(cases, key=_factor)
    yield (
        f"The printed baseline is nearest to that of {scale.title}: a factor {_factor(scale):.1f}."
    )


def _factor(case: PaperCase) -> float:
    """Return the factor between the MSE of the noisy input and the printed baseline, 1 or more."""
    ratio = case.mean("noisy", "mse_mm2") / PRINTED_FILTERS["noisy"].mse_mm2
    return max(ratio, 1 / ratio) if ratio else float("inf")
