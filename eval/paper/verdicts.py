"""A verdict on each value that the paper prints, from the scores of a reproduction's four cases."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from glsim.eval.paper.cases import PaperCase
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS, PrintedRow
from glsim.eval.paper.runs import SeedGroup

VerdictName = Literal[
    "reproduced", "direction reproduced", "refuted", "not comparable", "not trained yet"
]
#: Each verdict and what it says.
VERDICTS: Final[dict[VerdictName, str]] = {
    "reproduced": "within two standard deviations of our seeds, in the nearest case",
    "direction reproduced": "another size, but in some case all seeds lie on the printed side of "
    "the noisy input",
    "refuted": "in no case do all seeds lie on the printed side of the noisy input",
    "not comparable": "ours can neither confirm nor refute it, for the reason beside it",
    "not trained yet": "this folder has no scores of the row",
}
#: The printed metrics: our metric -> its name. Of the readings of SSIM the one with L of 16-bit
#: maps stands for all: under it the printed Baseline, Median and networks have values like ours.
PRINTED_METRICS: Final = {"mse_mm2": "MSE", "psnr_db": "PSNR", "ssim_16bit": "SSIM"}
#: Rows of the tables, as printed. Table 3 has D7 to D64 with artefact removal, too.
ROWS: Final = {
    1: tuple(PRINTED_FILTERS),
    2: ("Restormer", "UNet"),
    3: ("D7", "D20", "D64", "AR D7", "AR D20", "AR D64"),
}
#: Standard deviations of our seeds within which a value is reproduced: 95 % of a normal one.
_SPREADS: Final = 2.0
#: Half of the last printed digit: a smaller difference from the noisy input is none.
_ROUNDING: Final = 5e-5
#: A printed difference from the noisy input that is this many times our largest is no difference of
#: filters, but of the way of scoring. Chosen.
_OTHER_SCORING: Final = 10.0


@dataclass(frozen=True)
class Verdict:
    """The verdict on one printed value.

    Attributes:
        table: number of the table.
        row: title of the row.
        metric: MSE, PSNR or SSIM.
        printed: the value in the paper: mm^2, dB, 1.
        ours: our mean over seeds under the nearest case; None without scores.
        spread: standard deviation over seeds; None of fewer than two.
        case: the nearest case; None without scores.
        name: the verdict.
        reason: a sentence.
        decides: what would decide it.
    """

    table: int
    row: str
    metric: str
    printed: float
    ours: float | None
    spread: float | None
    case: PaperCase | None
    name: VerdictName
    reason: str
    decides: str


@dataclass(frozen=True)
class _Ours:
    """Our values of a row in a case, by seed, and the noisy input's of the same frames."""

    case: PaperCase
    values: Sequence[float]
    noisy: Sequence[float]
    group: SeedGroup | None = None

    @property
    def mean(self) -> float:
        return statistics.fmean(self.values)

    @property
    def spread(self) -> float | None:
        return statistics.stdev(self.values) if len(self.values) > 1 else None

    def sides(self) -> set[int]:
        """Return on which sides of the noisy input the seeds lie: -1, 0 (equal), 1."""
        return {_side(v, noisy) for v, noisy in zip(self.values, self.noisy, strict=True)}

    def largest_step(self) -> float:
        """Return the largest difference of a seed from the noisy input."""
        return max(abs(v - noisy) for v, noisy in zip(self.values, self.noisy, strict=True))


def verdicts(cases: Sequence[PaperCase]) -> list[Verdict]:
    """Return the verdicts on all 39 values: tables in order, rows as printed."""
    return [
        _judge(table, name, metric, cases)
        for table, rows in ROWS.items()
        for name in rows
        for metric in PRINTED_METRICS
    ]


def printed_row(table: int, name: str) -> PrintedRow:
    """Return a printed row by the number of its table and its name in ROWS."""
    return PRINTED_FILTERS[name] if table == 1 else PRINTED_NETWORKS[name]


def _printed(row: PrintedRow, metric: str) -> float:
    return {"mse_mm2": row.mse_mm2, "psnr_db": row.psnr_db, "ssim_16bit": row.ssim}[metric]


def _side(value: float, noisy: float) -> int:
    difference = value - noisy
    return 0 if abs(difference) < _ROUNDING else int(math.copysign(1, difference))


def _candidates(table: int, name: str, metric: str, cases: Sequence[PaperCase]) -> Iterator[_Ours]:
    """Yield our values of a row in each case that has any."""
    for case in cases:
        if table == 1 and name in case.values:
            yield _Ours(case, case.values[name][metric], case.values["noisy"][metric])
        elif table != 1 and name in case.networks:
            row = case.networks[name]
            values = row.values[metric]
            yield _Ours(case, values, [row.baseline[metric]] * len(values), row.group)


def _distance(metric: str, ours: float, printed: float) -> float:
    """Return how far two values are from each other: a factor for MSE, else a difference."""
    if not math.isfinite(ours) or (metric == "mse_mm2" and ours <= 0):
        return math.inf
    return abs(math.log(ours / printed)) if metric == "mse_mm2" else abs(ours - printed)


def _judge(table: int, name: str, metric: str, cases: Sequence[PaperCase]) -> Verdict:
    row = printed_row(table, name)
    printed = _printed(row, metric)
    found = list(_candidates(table, name, metric, cases))
    if not found:
        return Verdict(
            table,
            row.title,
            PRINTED_METRICS[metric],
            printed,
            None,
            None,
            None,
            "not trained yet",
            "There are no scores of this row.",
            "The command beside it.",
        )
    nearest = min(found, key=lambda ours: _distance(metric, ours.mean, printed))
    name_of, reason = _reason(table, name, metric, nearest, found)
    return Verdict(
        table,
        row.title,
        PRINTED_METRICS[metric],
        printed,
        nearest.mean,
        nearest.spread,
        nearest.case,
        name_of,
        reason,
        _decides(table, name, metric, nearest),
    )


def _reason(
    table: int, name: str, metric: str, nearest: _Ours, found: Sequence[_Ours]
) -> tuple[VerdictName, str]:
    printed = _printed(printed_row(table, name), metric)
    printed_noisy = _printed(PRINTED_FILTERS["noisy"], metric)
    off = abs(nearest.mean - printed)
    if nearest.spread is not None and off <= _SPREADS * nearest.spread + _ROUNDING:
        return "reproduced", (
            f"Ours differs by {off:.2g}, two standard deviations over {len(nearest.values)} seeds "
            f"are {_SPREADS * nearest.spread:.2g}."
        )
    if (table, name) == (1, "noisy"):
        return "not comparable", (
            f"It is the noise of the paper's own frames; ours {_beside(metric, nearest, printed)}."
        )
    wanted = _side(printed, printed_noisy)
    step = max(ours.largest_step() for ours in found)
    if metric == "ssim_16bit" and abs(printed - printed_noisy) > _OTHER_SCORING * max(
        step, _ROUNDING
    ):
        return "not comparable", (
            f"Printed is {printed - printed_noisy:+.4f} from the noisy input; under one reading "
            f"for all rows ours is at most {step:.1g} from it, so that this row had another "
            "reading."
        )
    holding = [ours.case.title for ours in found if ours.sides() == {wanted}]
    where = f"{len(holding)} of {len(found)} scored cases"
    where += f" ({'; '.join(holding)})" if len(holding) < len(found) else ""
    side = {-1: "below", 0: "equal to", 1: "above"}[wanted]
    if holding:
        return "direction reproduced", (
            f"All seeds are {side} the noisy input, as printed, in {where}; "
            f"ours {_beside(metric, nearest, printed)}.{_smaller(nearest.group)}"
        )
    if nearest.group is not None and nearest.group.size != "full":
        return "not comparable", (
            f"Printed is {side} the noisy input, ours is not in any of {len(found)} scored cases; "
            f"but ours was trained smaller than published ({_steps(nearest.group)}), and what it "
            "does not show may hold at full size."
        )
    return "refuted", (
        f"Printed is {side} the noisy input; in none of {len(found)} scored cases is ours so in "
        "all seeds."
    )


def _smaller(group: SeedGroup | None) -> str:
    """Say that a network was trained smaller than published: one step, too, can go that way."""
    if group is None or group.size == "full":
        return ""
    return f" It was trained smaller than published ({_steps(group)})."


def _steps(group: SeedGroup) -> str:
    return f"{group.members[0].steps} steps, {group.members[0].parameters:,} weights"


def _beside(metric: str, nearest: _Ours, printed: float) -> str:
    """Say where our value of the nearest case lies beside the printed one."""
    if metric == "mse_mm2":
        return f"is {nearest.mean / printed:.2f} times the printed value in the nearest one"
    difference = nearest.mean - printed
    text = f"{difference:+.2f} dB" if metric == "psnr_db" else f"{difference:+.4f}"
    return f"is {text} from the printed value in the nearest one"


def _decides(table: int, name: str, metric: str, nearest: _Ours) -> str:
    if metric == "ssim_16bit":
        return "The authors' program, data type and L for this row."
    if table == 1:
        if name in ("noisy", "adaptive"):
            return "The authors' noisy and clean maps, or the settings of their noise."
        return "The authors' answer: was this table scored at 1 mm, with dense clean maps?"
    if nearest.group is not None and nearest.group.size != "full":
        return "Training at the printed size (glsim paper reproduce --size full, with a GPU)."
    return "One noisy map, the authors' output for it, and the clean map beside them."
