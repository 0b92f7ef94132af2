"""The page of the study of SSIM: readings beside the paper's column, and conclusions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from glsim.eval.metrics.prediction import psnr_db
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS
from glsim.eval.paper.ssim_readings import (
    COLUMNS,
    NLM_8_BIT,
    READINGS,
    ROW_TYPES,
    ReadingScores,
)
from glsim.eval.report.document import Document, Heading, TextTable

_PRINTED = {column: PRINTED_FILTERS[column].ssim for column in COLUMNS}


def largest_difference(values: Mapping[str, float]) -> float:
    """Return the largest difference from the paper's SSIM over its four rows."""
    return max(abs(values[column] - _PRINTED[column]) for column in COLUMNS)


def nearest_reading(scores: ReadingScores) -> str:
    """Return the name of the single reading with the smallest ``largest_difference``."""
    return min(scores.ssim, key=lambda name: largest_difference(scores.ssim[name]))


def ssim_document(cases: Mapping[str, ReadingScores]) -> Document:
    """Write the page; ``cases`` maps a set of frames, such as "protocol paper", to its scores."""
    titles = [PRINTED_FILTERS[column].title for column in COLUMNS]
    document = Document(
        "The SSIM column of table 1: which reading of the text gives it",
        [
            "The paper prints " + ", ".join(
                f"{PRINTED_FILTERS[column].title} {value:.4f}" for column, value in _PRINTED.items()
            )
            + f" (Adaptive equals Baseline). Below are {len(READINGS)} readings of its text on "
            "our frames: data type, range L, constants K1 and K2, and program. The last column is "
            "the largest difference from the four printed values.",
        ],
    )  # fmt: skip
    for title, scores in cases.items():
        rows = [
            [name, *(f"{values[column]:.4f}" for column in COLUMNS), _off(values)]
            for name, values in scores.ssim.items()
        ]
        mixed = scores.mixed()
        rows.append(
            [
                "**hypothesis**: each row in its filter's own type: "
                + ", ".join(f"{PRINTED_FILTERS[c].title} {data}" for c, data in ROW_TYPES.items()),
                *(f"{mixed[column]:.4f}" for column in COLUMNS),
                _off(mixed),
            ]
        )
        document.parts += [
            Heading(title),
            TextTable(["reading", *titles, "largest difference"], rows),
            _conclusion(scores),
        ]
        document.parts += _network_parts(scores)
    document.parts += [
        Heading("What this says"),
        _verdict(cases),
    ]
    return document


def _network_parts(scores: ReadingScores) -> list[str | list[str] | Heading | TextTable]:
    """Return the readings of the rows of tables 2 and 3 that were measured, the nearest first."""
    measured = [row for row in PRINTED_NETWORKS if row in scores.mse_mm2]
    if not measured:
        return []
    off = {
        name: max(abs(values[row] - PRINTED_NETWORKS[row].ssim) for row in measured)
        for name, values in scores.ssim.items()
    }
    rows = [
        [name, *(f"{scores.ssim[name][row]:.4f}" for row in measured), f"{off[name]:.4f}"]
        for name in sorted(off, key=lambda name: off[name])
    ]
    printed = ["printed", *(f"{PRINTED_NETWORKS[row].ssim:.4f}" for row in measured), ""]
    psnr = [
        "PSNR of the mean MSE [dB]",
        *(f"{psnr_db(scores.mse_mm2[row]):.2f}" for row in measured),
        "",
    ]
    head = ["reading", *measured, "largest difference"]
    return [
        f"Rows of tables 2 and 3: printed PSNR {_listed(measured)} dB.",
        TextTable(head, [printed, *rows, psnr]),
    ]


def _listed(rows: Sequence[str]) -> str:
    return ", ".join(f"{row} {PRINTED_NETWORKS[row].psnr_db:.2f}" for row in rows)


def _off(values: Mapping[str, float]) -> str:
    return f"{largest_difference(values):.4f}"


def _conclusion(scores: ReadingScores) -> str:
    name = nearest_reading(scores)
    text = (
        f"{scores.frames} frames. The nearest single reading, {name}, is off by "
        f"{_off(scores.ssim[name])}; the hypothesis by {_off(scores.mixed())}. Our SSIM and "
        f"scikit-image's differ by at most {scores.ours_off:.1e}."
    )
    if NLM_8_BIT in scores.mse_mm2:
        base = scores.mse_mm2["noisy"]
        printed = PRINTED_FILTERS["nlm"].mse_mm2 / PRINTED_FILTERS["noisy"].mse_mm2
        text += (
            f" MSE of NLM over the baseline's: {scores.mse_mm2[NLM_8_BIT] / base:.3f} in 8 bits, "
            f"{scores.mse_mm2['nlm'] / base:.3f} in 16 (printed {printed:.3f})."
        )
    return text


#: Largest difference from the four printed values of a confirmed reading. Chosen: the standard
#: error of a mean over some tens of frames.
_FOUND = 0.01


def _verdict(cases: Mapping[str, ReadingScores]) -> list[str]:
    single = {title: nearest_reading(scores) for title, scores in cases.items()}
    off = {title: largest_difference(cases[title].ssim[name]) for title, name in single.items()}
    best = min(off, key=lambda title: off[title])
    mixed = {title: largest_difference(scores.mixed()) for title, scores in cases.items()}
    nearest = min(mixed, key=lambda title: mixed[title])
    spreads = [
        max(values[column] for column in COLUMNS) - min(values[column] for column in COLUMNS)
        for scores in cases.values()
        for values in scores.ssim.values()
        if 0.99 < values["noisy"] <= 1
    ]
    above = sorted(
        {
            reading.program
            for scores in cases.values()
            for reading in READINGS
            if scores.ssim[reading.name]["noisy"] > 1
        }
    )
    found = "One reading gives the column" if off[best] < _FOUND else "No reading gives the column"
    lines = [
        f"{found}: the nearest is {single[best]} ({best}), whose largest difference is "
        f"{off[best]:.3f}."
    ]
    if spreads:
        printed = max(_PRINTED.values()) - min(_PRINTED.values())
        lines.append(
            "Readings under which the baseline is above 0.99 spread the four rows by at most "
            f"{max(spreads):.4f}; the printed rows spread by {printed:.4f}. An L that hides the "
            "error of the baseline hides those of the filters too."
        )
    if above:
        lines.append(
            f"Above 1, and so no SSIM: {', '.join(above)}. It has C1 where C2 belongs, and C2 is "
            "nine times C1."
        )
    comparison = "nearer than" if mixed[nearest] < off[best] else "no nearer than"
    lines.append(
        f"Rows of different data types come within {mixed[nearest]:.3f} ({nearest}), "
        f"{comparison} any single reading: uint16 for Baseline, Median and Adaptive, uint8 for "
        "NLM, float for Bilateral, each with the L that scikit-image takes from the type. This is "
        "a hypothesis: it fits what the functions of OpenCV take and return, and that depth at "
        "1 mm fits into 8 bits. Only the authors' program can confirm it; if it holds, the rows of "
        "the column cannot be compared with each other."
    )
    return lines
