"""Write verdicts.html: each value that the paper prints beside ours, judged, with a reason."""

from __future__ import annotations

import shlex
import statistics
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from glsim.eval.paper.cases import FILTERS_FOLDER, PaperCase, case_folder, mask_folder, read_cases
from glsim.eval.paper.filter_table import NOTHING_LOSES_TO
from glsim.eval.paper.printed_values import PRINTED_NETWORKS
from glsim.eval.paper.verdicts import VERDICTS, Verdict, verdicts
from glsim.eval.report.document import Document, Heading, TextTable
from glsim.eval.report.page import html_page
from glsim.eval.report.tables import format_number
from glsim.files.atomic import write_atomic

#: Names of the page's files in the folder of a reproduction.
VERDICT_FILES: Final = ("verdicts.md", "verdicts.html")
_TITLE: Final = "The paper, value by value"
#: Unit of each printed metric, for ``format_number``.
_UNITS: Final = {"MSE": "mm", "PSNR": "dB", "SSIM": "1"}
#: Equations of the paper whose print cannot be meant: what it is, printed, meant, why.
_EQUATIONS: Final = (
    (
        "3, SSIM",
        "`C1` in both factors of the denominator; K1 = 0.001, K2 = 0.003",
        "`C2` in the second factor; K1 = 0.01, K2 = 0.03",
        "Wang et al. 2004, equation 13; as printed, values above 1 occur",
    ),
    (
        "5, angle of incidence",
        "a denominator of `|N| |O|`",
        "`cos a = N . D / (|N| |D|)`",
        "a cosine divides a product of two vectors by the lengths of the same two",
    ),
    (
        "6, width of the shadow",
        "`b = b f (1/Zo - 1/Zb)`",
        "`ds = b f (1/Zo - 1/Zb)`, ds in px, b the baseline in m, f in px",
        "b stands on both sides; by similar triangles the left side is the width",
    ),
)


def write_verdicts(folder: Path) -> list[Path]:
    """Write verdicts.md and verdicts.html to the folder of a reproduction.

    Args:
        folder: of ``glsim paper reproduce``. Values of rows without scores get the verdict *not
            trained yet*.

    Returns:
        The written files.

    Raises:
        DatasetError: for a table that cannot be read.
        GlsimError: without Jinja2.
    """
    document = verdict_document(read_cases(folder), folder)
    written = [folder / name for name in VERDICT_FILES]
    texts = (document.markdown(), html_page(_TITLE, [document]))
    for path, text in zip(written, texts, strict=True):
        write_atomic(text.encode(), path)
    return written


def verdict_document(cases: Sequence[PaperCase], folder: Path) -> Document:
    """Return the page of verdicts.

    Args:
        cases: the four cases with their scores.
        folder: of the reproduction, which the printed commands name.
    """
    found = verdicts(cases)
    counts = Counter(verdict.name for verdict in found)
    document = Document(
        f"Verdicts on the {len(found)} printed values",
        [
            'Kendrick, Yap and Tan, "Synthetic Data Generation for Demonstrating Noise Reduction '
            'in Facial Depth Imaging", tables 1 to 3. Ours is the mean over seeds ± their standard '
            "deviation, under the case that comes nearest: depth as measured or with the nearest "
            "point at 1 mm, dense clean maps or BlenSor's mask. The case is chosen for each value "
            "alone, which favours the paper. The command beside a value scores it again in that "
            "case (of table 1 the first seed), into the folder that this page reads; "
            f"`{shlex.join(['glsim', 'paper', 'page', str(folder)])}` then judges anew.",
            TextTable(
                ["verdict", "values", "it says"],
                [[name, str(counts[name]), text] for name, text in VERDICTS.items()],
            ),
            Heading("What no method may lose to"),
            "MSE of the noisy input, of a map of zeros and of the mean face, mm²; and how many "
            "times the zeros' the printed networks have. Above 1, the printed network would be "
            "worse than a map without any depth.",
            _trivial_table(cases),
        ],
    )
    for table in dict.fromkeys(verdict.table for verdict in found):
        of_table = [verdict for verdict in found if verdict.table == table]
        document.parts += [
            Heading(f"Table {table}"),
            _table(of_table),
            [_line(verdict, folder) for verdict in of_table],
        ]
    document.parts += [
        Heading("Misprinted equations"),
        TextTable(["equation", "printed", "meant", "because"], [list(row) for row in _EQUATIONS]),
    ]
    return document


def _trivial_table(cases: Sequence[PaperCase]) -> TextTable:
    printed = [row.mse_mm2 for row in PRINTED_NETWORKS.values()]
    rows = []
    for case in cases:
        cells = []
        for name in ("noisy", *NOTHING_LOSES_TO):
            values = case.values.get(name)
            cells.append(_mean_and_spread(values["mse_mm2"], "MSE") if values else "not scored")
        zeros = case.values.get(NOTHING_LOSES_TO[0])
        if zeros and (mean := statistics.fmean(zeros["mse_mm2"])) > 0:
            cells.append(f"{min(printed) / mean:.2f} to {max(printed) / mean:.2f}")
        else:
            cells.append("not scored")
        rows.append([case.title, *cells])
    return TextTable(
        ["case", "noisy input", *NOTHING_LOSES_TO, "printed networks over zeros"], rows
    )


def _mean_and_spread(values: Sequence[float], metric: str) -> str:
    text = format_number(statistics.fmean(values), _UNITS[metric])
    if len(values) < 2:
        return text
    return f"{text} ± {format_number(statistics.stdev(values), _UNITS[metric])}"


def _table(found: Sequence[Verdict]) -> TextTable:
    rows = []
    for verdict in found:
        ours = "-"
        if verdict.ours is not None:
            unit = _UNITS[verdict.metric]
            ours = format_number(verdict.ours, unit)
            ours += "" if verdict.spread is None else f" ± {format_number(verdict.spread, unit)}"
        rows.append(
            [
                f"{verdict.row}, {verdict.metric}",
                f"**{verdict.name}**",
                format_number(verdict.printed, _UNITS[verdict.metric]),
                ours,
            ]
        )
    return TextTable(["value", "verdict", "printed", "ours"], rows)


def _line(verdict: Verdict, folder: Path) -> str:
    """Return a verdict in words: its reason, what would decide it, and the command to check it."""
    case = "" if verdict.case is None else f" (nearest: {verdict.case.title})"
    return (
        f"**{verdict.row}, {verdict.metric}**: {verdict.name}{case}. {verdict.reason} To decide: "
        f"{verdict.decides} `{_command(verdict, folder)}`"
    )


def _command(verdict: Verdict, folder: Path) -> str:
    """Return the command line that scores a value again in its nearest case.

    Without scores it is the one that trains and scores all rows.
    """
    case = verdict.case
    if case is None:
        return shlex.join(["glsim", "paper", "reproduce", "-o", str(folder)])
    if verdict.table == 1:
        first = min((folder / FILTERS_FOLDER / case.mask).glob("*/data"), default=None)
        data = first or folder / FILTERS_FOLDER / case.mask / "1" / "data"
        more = ["--table", "1", "-o", str(data.parent / case.protocol)]
    else:
        data = mask_folder(folder, case.mask) / "data"
        place = case_folder(folder, case.protocol, case.mask)
        # One table alone would leave the rows of the other out of the folder's scores.
        more = ["--table", "2", "--table", "3", "--runs", str(place / "runs"), "-o", str(place)]
    words = ["glsim", "paper", "tables", str(data), "--no-figures", "--protocol", case.protocol]
    return shlex.join([*words, *more])
