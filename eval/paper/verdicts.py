"""Judge each value that the paper prints by our scores in the four cases.

A case is a depth protocol and a mask of the clean maps (``glsim.eval.paper.cases``). A printed
value is compared with ours in the case where ours is nearest to it.
"""

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
    """Our values of a row in one case.

    Attributes:
        case: the case.
        values: one value per seed: mm^2, dB or 1.
        noisy: the same metric of the noisy input on the same frames, per seed.
        group: the trainings of a network; None for a filter.
    """

    case: PaperCase
    values: Sequence[float]
    noisy: Sequence[float]
    group: SeedGroup | None = None

    @property
    def mean(self) -> float:
        """Mean over the seeds."""
        return statistics.fmean(self.values)

    @property
    def spread(self) -> float | None:
        """Standard deviation over the seeds; None of fewer than two."""
        return statistics.stdev(self.values) if len(self.values) > 1 else None

    def sides(self) -> set[int]:
        """Compare each seed with the noisy input.

        Returns:
            The signs that occur: -1 (a seed is below the noisy input), 0 (equal), 1 (above).
        """
        return {_side(v, noisy) for v, noisy in zip(self.values, self.noisy, strict=True)}

    def largest_difference(self) -> float:
        """Return the largest absolute difference of a seed from the noisy input."""
        return max(abs(v - noisy) for v, noisy in zip(self.values, self.noisy, strict=True))


def verdicts(cases: Sequence[PaperCase]) -> list[Verdict]:
    """Judge all 39 printed values.

    Args:
        cases: the four cases, as ``read_cases`` returns them.

    Returns:
        A verdict per value, in the order of the tables and of their rows.
    """
    return [
        _judge(table, name, metric, cases)
        for table, rows in ROWS.items()
        for name in rows
        for metric in PRINTED_METRICS
    ]


def printed_row(table: int, name: str) -> PrintedRow:
    """Return the printed values of a row.

    Args:
        table: 1, 2 or 3.
        name: of the row, as in ROWS.
    """
    return PRINTED_FILTERS[name] if table == 1 else PRINTED_NETWORKS[name]


def _printed(row: PrintedRow, metric: str) -> float:
    """Return a printed value by the name of our metric."""
    return {"mse_mm2": row.mse_mm2, "psnr_db": row.psnr_db, "ssim_16bit": row.ssim}[metric]


def _side(value: float, noisy: float) -> int:
    """Return the sign of value - noisy: 0 where the printed digits could not show it."""
    difference = value - noisy
    return 0 if abs(difference) < _ROUNDING else int(math.copysign(1, difference))


def _candidates(table: int, name: str, metric: str, cases: Sequence[PaperCase]) -> Iterator[_Ours]:
    """Yield our values of a metric of a row, case by case; cases without scores are left out."""
    for case in cases:
        if table == 1 and name in case.values:
            yield _Ours(case, case.values[name][metric], case.values["noisy"][metric])
        elif table != 1 and name in case.networks:
            row = case.networks[name]
            values = row.values[metric]
            yield _Ours(case, values, [row.baseline[metric]] * len(values), row.group)


def _distance(metric: str, ours: float, printed: float) -> float:
    """Measure how far ours is from the printed value.

    Returns:
        The absolute logarithm of their ratio for MSE, their absolute difference for PSNR and SSIM;
        infinite if ours is not finite, or no MSE above 0.
    """
    if not math.isfinite(ours) or (metric == "mse_mm2" and ours <= 0):
        return math.inf
    return abs(math.log(ours / printed)) if metric == "mse_mm2" else abs(ours - printed)


def _judge(table: int, name: str, metric: str, cases: Sequence[PaperCase]) -> Verdict:
    """Judge one printed value: find the nearest case, then the reason."""
    row = printed_row(table, name)
    printed = _printed(row, metric)
    found = list(_candidates(table, name, metric, cases))
    if not found:
        return Verdict(
            table=table,
            row=row.title,
            metric=PRINTED_METRICS[metric],
            printed=printed,
            ours=None,
            spread=None,
            case=None,
            name="not trained yet",
            reason="There are no scores of this row.",
            decides="The command beside it.",
        )
    nearest = min(found, key=lambda ours: _distance(metric, ours.mean, printed))
    verdict, reason = _reason(table, name, metric, nearest, found)
    return Verdict(
        table=table,
        row=row.title,
        metric=PRINTED_METRICS[metric],
        printed=printed,
        ours=nearest.mean,
        spread=nearest.spread,
        case=nearest.case,
        name=verdict,
        reason=reason,
        decides=_decides(table, name, metric, nearest),
    )


def _reason(
    table: int, name: str, metric: str, nearest: _Ours, found: Sequence[_Ours]
) -> tuple[VerdictName, str]:
    """Apply the rules of VERDICTS to one printed value.

    Args:
        table: number of the table.
        name: of the row, as in ROWS.
        metric: our name of the metric.
        nearest: ours in the case that comes nearest.
        found: ours in all cases with scores.

    Returns:
        The verdict, and the sentence that explains it.
    """
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
    step = max(ours.largest_difference() for ours in found)
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
    count = len(nearest.values)
    seeds = f"All {count} seeds are" if count > 1 else "The only seed is"
    if holding:
        return "direction reproduced", (
            f"{seeds} {side} the noisy input, as printed, in {where}; "
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
    """Return a sentence for a network smaller than published, whose direction proves little."""
    if group is None or group.size == "full":
        return ""
    return f" It was trained smaller than published ({_steps(group)})."


def _steps(group: SeedGroup) -> str:
    """Describe the size of a network and its training."""
    return f"{group.members[0].steps} steps, {group.members[0].parameters:,} weights"


def _beside(metric: str, nearest: _Ours, printed: float) -> str:
    """Compare our value in the nearest case with the printed one, in words."""
    if metric == "mse_mm2":
        return f"is {nearest.mean / printed:.2f} times the printed value in the nearest one"
    difference = nearest.mean - printed
    text = f"{difference:+.2f} dB" if metric == "psnr_db" else f"{difference:+.4f}"
    return f"is {text} from the printed value in the nearest one"


def _decides(table: int, name: str, metric: str, nearest: _Ours) -> str:
    """Return what would decide whether a printed value is right, in a sentence."""
    if metric == "ssim_16bit":
        return "The authors' program, data type and L for this row."
    if table == 1:
        if name in ("noisy", "adaptive"):
            return "The authors' noisy and clean maps, or the settings of their noise."
        return "The authors' answer: was this table scored at 1 mm, with dense clean maps?"
    if nearest.group is not None and nearest.group.size != "full":
        return "Training at the printed size (glsim paper reproduce --size full, with a GPU)."
    return "One noisy map, the authors' output for it, and the clean map beside them."
