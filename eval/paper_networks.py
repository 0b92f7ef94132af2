"""Tables 2 and 3 of Kendrick, Yap and Tan, "Synthetic Data Generation for Demonstrating Noise
Reduction in Facial Depth Imaging": its networks, the printed values beside ours.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Final

from .denoisers import COMPOSITES, PAPER
from .metrics.catalogue import PSNR_MAX_MM
from .page import Grid, Heading, Page
from .paper import PRINTED, yes
from .run import Evaluation
from .statistics import student_t
from .tables import ALL, Table, number
from .trained import Group, Trained, grouped

#: Row -> printed PSNR per image, dB, and PSNR that belongs to the printed MSE, dB (MAX 8000 mm):
#: our notes of the paper hold the MSE in this form. Its SSIM is noted as a range: 0.984 to 0.989.
_PRINTED_PSNR: Final[dict[str, tuple[float, float]]] = {
    "Restormer": (29.1483, 29.0299),
    "UNet": (30.5461, 30.3465),
    "D7": (32.9725, 32.4701),
    "AR D7": (33.3941, 32.7853),
    "D20": (33.2791, 32.7168),
    "AR D20": (33.2898, 32.7170),
    "D64": (33.3734, 32.7591),
    "AR D64": (33.2267, 32.6887),
}
#: Printed MSE, mm^2, where our notes hold all its digits.
_PRINTED_MSE: Final = {"D20": 34237.0065, "AR D20": 34235.7125}
#: Table -> rows. Table 2 compares architectures, table 3 each depth with and without AR.
ROWS: Final = {
    2: ("Restormer", "UNet", "D7", "D20", "D64"),
    3: ("D7", "AR D7", "D20", "AR D20", "D64", "AR D64"),
}
#: Shown of every network: metric -> its name in these tables.
_PAPER_BLOCK: Final = {
    "mse_mm2": "MSE [mm²]",
    "psnr_db": "PSNR per image [dB]",
    "ssim_paper": "SSIM, printed constants",
}
_HONEST_BLOCK: Final = {
    "both_interior_rmse_mm": "interior RMSE [mm]",
    "both_rmse_mm": "RMSE, valid in both [mm]",
    "normal_mean_deg": "normals [°]",
    "flips_px": "flipped pixels",
    "flying_px": "flying pixels",
}


def printed_mse_mm2(row: str) -> float:
    """Of a row of table 2 or 3; from the PSNR to four decimals where the digits are not noted."""
    from_psnr = PSNR_MAX_MM**2 / 10 ** (_PRINTED_PSNR[row][1] / 10)
    return _PRINTED_MSE.get(row, round(from_psnr, 0))


class _Scores:
    """Means over frames of each seed of a network, by metric; ``part`` of a soft validity or ""."""

    def __init__(self, group: Group, part: str, table: Table) -> None:
        self.group, self.part = group, part
        labels = [f"{one.label} [{part}]" if part else one.label for one in group.members]
        self._entries = [table[label] for label in labels if label in table]

    def __bool__(self) -> bool:
        return bool(self._entries)

    @property
    def name(self) -> str:
        """For tables."""
        return f"{self.group.title} [{self.part}]" if self.part else self.group.title

    def values(self, metric: str) -> list[float]:
        """One a seed."""
        return [entries[metric].mean for entries in self._entries]

    def mean(self, metric: str) -> float:
        """Over seeds; NaN if a seed has none."""
        return statistics.fmean(self.values(metric))

    def cell(self, metric: str) -> str:
        """Mean and standard deviation over seeds."""
        values, unit = self.values(metric), ALL[metric].unit
        text = number(statistics.fmean(values), unit)
        if len(values) < 2 or not all(map(math.isfinite, values)):  # a seed may have no depth
            return text
        return f"{text} ± {number(statistics.stdev(values), unit)}"


def _scored(groups: Sequence[Group], table: Table) -> list[_Scores]:
    every = [_Scores(group, part, table) for group in groups for part in ("", *COMPOSITES)]
    return [scores for scores in every if scores]


def network_table(
    which: int,
    evaluation: Evaluation,
    table: Table,
    trained: Sequence[Trained],
    refused: Sequence[str] = (),
) -> Page:
    """Table 2 or 3, and which of its relations hold here.

    trained: the networks that were scored under their labels. refused: why others were not.
    The networks without a row in the paper stand below its rows.
    """
    groups = grouped(trained)
    of_paper = [group for row in ROWS[which] for group in groups if group.row == row]
    of_others = [group for group in groups if group.row is None]
    scored, own = _scored(of_paper, table), _scored(of_others, table)
    labels = {one.label for one in trained}
    filters = [n for n in table if n.split(" [")[0] not in labels and n != "adaptive"]
    page = Page(f"Table {which} of Kendrick, Yap and Tan: printed and measured")
    page.parts += [
        f"{evaluation.frames} frames of {len(evaluation.summary.subjects)} subjects. Ours are "
        "means over seeds ± their standard deviation; one seed has none. Nothing is extrapolated: "
        "a row that was trained smaller says so, and its numbers stand for that size only.",
        _paper_grid(which, scored, own, table),
        "Printed MSE: from the PSNR that belongs to it in our notes, to four decimals; SSIM: noted "
        "only as 0.984 to 0.989 for all networks, and not comparable between the paper's rows.",
        Heading("What all-pixel metrics hide"),
        _honest_grid([*scored, *own], filters, table),
        Heading("Relations"),
    ]
    if which == 3:
        page.parts += [
            "AR, artefact removal, maps the input back through the adjoint of the measurement "
            "operator before the network. For denoising that operator is the identity: AR and no "
            "AR are the same network, and differ as two seeds do. t is the difference over its "
            "standard error (pooled over seeds); the last column asks whether |t| stays below what "
            "chance exceeds in 1 % of cases.",
            _same_network(scored),
        ]
    page.parts.append(_against_filters([*scored, *own], table))
    if own and scored:
        page.parts += [
            "Networks that know which pixels are holes, against the best of all other rows:",
            _own_against_all([s for s in own if s.part != "input mask"], scored, filters, table),
        ]
    missing = [row for row in ROWS[which] if not any(s.group.row == row for s in scored)]
    notes = [f"{row}: missing, no checkpoint of it was found" for row in missing]
    notes += [note for group in (*of_paper, *of_others) for note in _training_notes(group)]
    notes += [f"left out: {why}" for why in refused]
    if notes:
        page.parts += [Heading("What is missing or less than published"), notes]
    return page


def _paper_grid(which: int, scored: list[_Scores], own: list[_Scores], table: Table) -> Grid:
    head = ["row", "network", "size", "seeds", "minutes of training"]
    for heading in _PAPER_BLOCK.values():
        head += [f"{heading}, printed", f"{heading}, ours"]
    rows: list[list[str]] = []
    for row in ROWS[which]:
        printed = [number(printed_mse_mm2(row)), f"{_PRINTED_PSNR[row][0]:.2f}", "not noted"]
        of_row = [scores for scores in scored if scores.group.row == row]
        for scores in of_row:
            rows.append([row, *_facts(scores, of_row), *_beside(printed, scores)])
        if not of_row:
            rows.append([row, "**missing**", "", "", "", *_beside(printed, None)])
    rows += [["-", *_facts(scores, []), *_beside(["-"] * 3, scores)] for scores in own]
    for name in (name for name in PAPER if name in table and name != "adaptive"):
        title, mse, psnr, _ = PRINTED[name]
        ours = [number(table[name][metric].mean, ALL[metric].unit) for metric in _PAPER_BLOCK]
        cells = [number(mse), ours[0], f"{psnr:.2f}", ours[1], "see table 1", ours[2]]
        rows.append([title, "filter", "", "", "", *cells])
    return Grid(head, rows)


def _facts(scores: _Scores, of_row: Sequence[_Scores]) -> list[str]:
    group = scores.group
    size = group.size
    if group.row and size == "small" and not any(other.group.size == "full" for other in of_row):
        size = "small; **not run at full size**"
    minutes = statistics.fmean(one.minutes for one in group.members)
    return [scores.name, size, str(len(scores.values("mse_mm2"))), f"{minutes:.1f}"]


def _beside(printed: list[str], scores: _Scores | None) -> list[str]:
    ours = [scores.cell(metric) if scores else "" for metric in _PAPER_BLOCK]
    return [cell for pair in zip(printed, ours, strict=True) for cell in pair]


def _honest_grid(networks: list[_Scores], filters: list[str], table: Table) -> Grid:
    rows = [[s.name, s.group.size, *map(s.cell, _HONEST_BLOCK)] for s in networks]
    for name in filters:
        cells = [number(table[name][metric].mean) for metric in _HONEST_BLOCK]
        rows.append([_filter(name), "filter", *cells])
    head = [f"{heading} ↓" for heading in _HONEST_BLOCK.values()]
    return Grid(["network", "size", *head], rows)


def _filter(name: str) -> str:
    return PRINTED[name][0] if name in PRINTED else f"`{name}`"


def _same_network(scored: list[_Scores]) -> Grid:
    rows: list[list[str]] = []
    metric = "mse_mm2"
    for plain in scored:
        for other in scored:
            pair = (f"AR {plain.group.row}", plain.group.size, plain.part)
            if (other.group.row, other.group.size, other.part) != pair:
                continue
            row = str(plain.group.row)
            printed = printed_mse_mm2(f"AR {row}") - printed_mse_mm2(row)
            t, chance = student_t(other.values(metric), plain.values(metric))
            verdict = "one seed: unknown" if math.isnan(t) else yes(abs(t) < chance)
            difference = other.mean(metric) - plain.mean(metric)
            cells = [
                f"{printed:+.0f}",
                f"{difference:+.1f}",
                plain.cell(metric),
                other.cell(metric),
            ]
            rows.append([row, plain.group.size, *cells, f"{t:.2f}", verdict])
    return Grid(
        [
            *("depth", "size", "MSE of AR less no AR, printed", "ours", "no AR, ours", "AR, ours"),
            *("t", "as between seeds"),
        ],
        rows,
    )


def _against_filters(networks: list[_Scores], table: Table) -> Grid:
    filters = [name for name in PAPER if name in table and name not in ("noisy", "adaptive")]
    lowest = {m: min(table[n][m].mean for n in filters) for m in ("mse_mm2", *_HONEST_BLOCK)}
    rows = []
    for scores in networks:
        row = scores.group.row
        mse = scores.mean("mse_mm2")
        printed = f"{printed_mse_mm2(row) / PRINTED['noisy'][1]:.1f}" if row else "-"
        rows.append(
            [
                scores.name,
                scores.group.size,
                printed,
                _ratio(mse, table["noisy"]["mse_mm2"].mean),
                _ratio(mse, table["median"]["mse_mm2"].mean),
                yes(mse > table["median"]["mse_mm2"].mean) if row else "-",
                _ratio(
                    scores.mean("both_interior_rmse_mm"),
                    table["noisy"]["both_interior_rmse_mm"].mean,
                ),
                _ratio(scores.mean("both_interior_rmse_mm"), lowest["both_interior_rmse_mm"]),
            ]
        )
    head = ["network", "size", "MSE over noisy, printed", "ours", "MSE over median's, ours"]
    head += ["loses to the median in MSE, as printed", "interior RMSE over noisy, ours"]
    return Grid([*head, "over the paper's best filter"], rows)


def _ratio(value: float, base: float) -> str:
    return f"{value / base:.2f}" if base > 0 else "n/a"


def _own_against_all(
    own: list[_Scores], networks: list[_Scores], filters: list[str], table: Table
) -> Grid:
    rows = []
    for scores in own:
        for metric, heading in {"mse_mm2": _PAPER_BLOCK["mse_mm2"], **_HONEST_BLOCK}.items():
            others = {s.name: s.mean(metric) for s in networks}
            others |= {_filter(name): table[name][metric].mean for name in filters}
            known = {name: value for name, value in others.items() if not math.isnan(value)}
            if not known:
                continue
            best = min(known, key=lambda name: known[name])
            ratio = _ratio(scores.mean(metric), known[best])
            rows.append([scores.name, heading, scores.cell(metric), best,
                         number(known[best]), ratio])  # fmt: skip
    return Grid(
        ["network", "metric", "its value", "best of the others", "that one's", "ratio"], rows
    )


def _training_notes(group: Group) -> list[str]:
    """On what is less than published, and seeds whose training was interrupted."""
    notes = [f"{group.title}, {group.size}: {group.members[0].description}"]
    if unfinished := [one.label for one in group.members if not one.finished]:
        stopped = f"training was interrupted, scored as far as it came: {', '.join(unfinished)}"
        notes.append(f"{group.title}: {stopped}")
    return notes if group.members[0].description else notes[1:]
