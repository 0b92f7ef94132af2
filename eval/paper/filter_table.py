"""Write the paper's table 1, the scores of the filters: printed values beside ours."""

from __future__ import annotations

from typing import Final

from glsim.denoise import PAPER_FILTERS
from glsim.depth_protocol import MEANING
from glsim.eval.metrics.ssim import PRESETS
from glsim.eval.paper.printed_values import PRINTED_FILTERS
from glsim.eval.report.document import Document, TextTable
from glsim.eval.report.tables import ResultTable, format_number
from glsim.eval.scoring.aggregate import PSNR_OF_MEAN
from glsim.eval.scoring.run import Evaluation


def filter_table(evaluation: Evaluation, table: ResultTable) -> Document:
    """Return the page of table 1: values, relations that hold, and errors of the surface.

    Args:
        evaluation: the scores, with those of the trivial predictions.
        table: the scores by method.
    """
    trivial = trivial_rows(evaluation)
    shown = table | trivial
    ours = [*PAPER_FILTERS, *trivial]
    columns = [*(PRINTED_FILTERS[name].title for name in PAPER_FILTERS), *trivial]
    mse, psnr, psnr_mean, similar = (
        {name: shown[name][metric].mean for name in ours}
        for metric in ("mse_mm2", "psnr_db", PSNR_OF_MEAN.name, "ssim_paper")
    )
    absent = ["-"] * len(trivial)  # the paper prints none of them
    base = mse["noisy"]
    printed_base = PRINTED_FILTERS["noisy"].mse_mm2
    rows = [
        [
            "MSE, printed [mm²]",
            *(format_number(PRINTED_FILTERS[n].mse_mm2) for n in PAPER_FILTERS),
            *absent,
        ],
        ["MSE, ours [mm²]", *(format_number(mse[n]) for n in ours)],
        [
            "MSE over baseline, printed",
            *(f"{PRINTED_FILTERS[n].mse_mm2 / printed_base:.3f}" for n in PAPER_FILTERS),
            *absent,
        ],
        [
            "MSE over baseline, ours",
            *(f"{mse[n] / base:.3f}" if base else "n/a" for n in ours),
        ],
        [
            "PSNR, printed [dB]",
            *(f"{PRINTED_FILTERS[n].psnr_db:.2f}" for n in PAPER_FILTERS),
            *absent,
        ],
        ["PSNR per image, ours [dB]", *(f"{psnr[n]:.2f}" for n in ours)],
        ["PSNR of the mean MSE, ours [dB]", *(f"{psnr_mean[n]:.2f}" for n in ours)],
        ["SSIM, printed", *(f"{PRINTED_FILTERS[n].ssim:.4f}" for n in PAPER_FILTERS), *absent],
        ["SSIM with the printed constants, ours", *(f"{similar[n]:.4f}" for n in ours)],
        [
            "SSIM, K1=.01 K2=.03 L=65535, ours",
            *(f"{shown[n]['ssim_16bit'].mean:.4f}" for n in ours),
        ],
    ]
    worst_first = sorted(("median", "nlm", "bilateral"), key=lambda n: mse[n])
    relations: list[tuple[str, bool | None, bool]] = [
        ("Adaptive equals Baseline", True, mse["adaptive"] == base),
        ("NLM has the lowest MSE of the four", True, worst_first[0] == "nlm"),
        (
            "PSNR per image is above PSNR of the mean MSE",
            True,
            all(psnr[n] >= psnr_mean[n] for n in PAPER_FILTERS),
        ),
        (
            "every filter lowers the MSE",
            True,
            all(mse[n] < base for n in ("median", "nlm", "bilateral")),
        ),
    ]
    relations += [
        (f"every filter has a lower MSE than the {name}", None, all(mse[n] < mse[name]
         for n in PAPER_FILTERS)) for name in trivial
    ]  # fmt: skip
    return Document(
        "Table 1 of Kendrick, Yap and Tan: printed and measured",
        [
            f"{evaluation.frames} frames of {len(evaluation.summary.subjects)} subjects. Protocol "
            f"{evaluation.protocol}: {MEANING[evaluation.protocol]}.",
            TextTable(["", *columns], rows),
            f"SSIM with the printed constants: {PRESETS['paper']}. No single reading of the "
            "constants, range and types gives the paper's SSIM column (glsim paper ssim "
            "DATA): do not match it. Adaptive is Essmaeel's temporal filter, on single "
            "frames the identity.",
            TextTable(
                ["relation", "printed", "ours"],
                [
                    [name, "-" if printed is None else yes_or_no(printed), yes_or_no(holds)]
                    for name, printed, holds in relations
                ],
            ),
            *([_TRIVIAL] if trivial else []),
            "What these numbers do not show: " + _surface(table),
        ],
    )


#: Trivial predictions that no method may lose to, by their names among the trivial baselines.
NOTHING_LOSES_TO: Final = ("zero image", "mean face")


def trivial_rows(evaluation: Evaluation) -> ResultTable:
    """Return the scores of a map of zeros and of the mean face.

    Args:
        evaluation: the scores; without trivial predictions nothing is returned.
    """
    scored = evaluation.baselines
    return {name: scored.entries(name) for name in NOTHING_LOSES_TO if name in scored.methods}


def yes_or_no(value: bool) -> str:
    """Return "yes", or "no" in bold, for a cell of a table."""
    return "yes" if value else "**no**"


#: What the columns without a printed value are.
_TRIVIAL: Final = (
    "Zero image: a map without any depth. Mean face: the mean of the true maps where most of them "
    "have depth, the same map for every frame. A method that loses to one of them is worse than no "
    "method. Both are scored on at most 200 frames, evenly spread."
)


def _surface(table: ResultTable) -> str:
    parts = [
        f"{PRINTED_FILTERS[name].title} "
        f"{format_number(table[name]['both_interior_rmse_mm'].mean)} mm, "
        f"{format_number(table[name]['normal_mean_deg'].mean)}°, "
        f"{format_number(table[name]['flying_px'].mean)} flying pixels"
        for name in PAPER_FILTERS
        if name != "adaptive"
    ]
    return "interior RMSE, normals and pixels in mid-air are " + "; ".join(parts) + "."
