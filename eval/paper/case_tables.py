"""Tables of every row in the four cases: filters, networks, and what no method may lose to."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from typing import Final

from glsim.eval.paper.cases import NetworkScores, PaperCase
from glsim.eval.paper.filter_table import NOTHING_LOSES_TO
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS
from glsim.eval.report.document import Document, TextTable

#: Rows of table 1, without the input itself.
_FILTERS: Final = ("median", "nlm", "adaptive", "bilateral")
_MSE, _INTERIOR = "mse_mm2", "both_interior_rmse_mm"


def add_case_tables(document: Document, cases: Sequence[PaperCase]) -> None:
    """Add the MSE and the interior error of every row in every case to a page.

    Args:
        document: the page.
        cases: the four cases; what was not scored is "-".
    """
    document.parts += [
        "MSE over the noisy input's on the same frames, mean ± standard deviation over seeds, and "
        "the number of seeds. Above 1, a row loses to the noisy input in this case. Networks were "
        "trained in each case anew, on its own clean maps; a row with artefact removal is its "
        "partner's network. Of networks that know which pixels are holes, the composite `input "
        "mask` is shown: depth where the noisy map has depth.",
        _with_printed(_table(cases, _MSE)),
        "Interior RMSE (away from rims, valid in both maps) over the noisy input's: the error of "
        "the surface, which the MSE of all pixels hides.",
        _table(cases, _INTERIOR),
    ]
    if sizes := _sizes(cases):
        document.parts += ["Sizes of the networks, steps of training:", sizes]


def _table(cases: Sequence[PaperCase], metric: str) -> TextTable:
    """Return the rows of both tables: a title, and a cell per case."""
    rows = []
    for name in (*_FILTERS, *NOTHING_LOSES_TO):
        printed = PRINTED_FILTERS.get(name)
        title = printed.title if printed else name
        rows.append([title, *(_cell(_filter_ratios(case, name, metric)) for case in cases)])
    for row in PRINTED_NETWORKS:
        rows.append([row, *_network_cells(cases, metric, _of_row(row))])
    for title in dict.fromkeys(title for case in cases for title in case.others):
        rows.append([title, *_network_cells(cases, metric, _of_title(title))])
    return TextTable(["row", *(case.title for case in cases)], rows)


def _with_printed(table: TextTable) -> TextTable:
    """Return a table of MSE with a column of the printed ratios after that of the titles."""
    base = PRINTED_FILTERS["noisy"].mse_mm2
    printed = {row.title: f"{row.mse_mm2 / base:.3f}" for row in PRINTED_FILTERS.values()}
    printed |= {name: f"{row.mse_mm2 / base:.1f}" for name, row in PRINTED_NETWORKS.items()}
    rows = [[title, printed.get(title, "-"), *cells] for title, *cells in table.rows]
    return TextTable([table.head[0], "printed", *table.head[1:]], rows)


_Choose = Callable[[PaperCase], NetworkScores | None]


def _of_row(row: str) -> _Choose:
    return lambda case: case.networks.get(row)


def _of_title(title: str) -> _Choose:
    return lambda case: case.others.get(title)


def _filter_ratios(case: PaperCase, name: str, metric: str) -> list[float]:
    values, noisy = (case.values.get(one, {}).get(metric, []) for one in (name, "noisy"))
    if len(values) != len(noisy):  # zeros and the mean face were scored on some sets only
        return []
    return [value / of_input for value, of_input in zip(values, noisy, strict=True) if of_input > 0]


def _network_cells(cases: Sequence[PaperCase], metric: str, choose: _Choose) -> list[str]:
    cells = []
    for case in cases:
        scores = choose(case)
        noisy = scores.baseline[metric] if scores else 0.0
        ratios = [value / noisy for value in scores.values[metric]] if scores and noisy > 0 else []
        cells.append(_cell(ratios))
    return cells


def _cell(ratios: Sequence[float]) -> str:
    if not ratios or not all(map(math.isfinite, ratios)):  # zeros have no interior
        return "-"
    mean = statistics.fmean(ratios)
    digits = 3 if mean < 10 else 1
    text = f"{mean:.{digits}f}"
    if len(ratios) > 1:
        text += f" ± {statistics.stdev(ratios):.{digits}f} ({len(ratios)})"
    return text


def _sizes(cases: Sequence[PaperCase]) -> list[str]:
    """Return a line for each network that was trained: its size and steps."""
    found: dict[str, str] = {}
    for case in cases:
        for scores in (*case.networks.values(), *case.others.values()):
            group = scores.group
            if group.twin:
                continue
            run = group.members[0]
            found.setdefault(
                group.title, f"{group.title}: {run.steps:,} steps, {run.parameters:,} weights"
            )
    return [*found.values()]
