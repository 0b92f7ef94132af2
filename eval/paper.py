"""Table 1 of Kendrick, Yap and Tan, "Synthetic Data Generation for Demonstrating Noise Reduction in
Facial Depth Imaging", with its printed values beside ours.
"""

from __future__ import annotations

from typing import Final

from .aggregate import PSNR_OF_MEAN
from .denoisers import PAPER
from .metrics.ssim import PRESETS
from .page import Grid, Page
from .run import Evaluation
from .tables import Table, number

#: Our name -> (the paper's, printed MSE in mm^2, PSNR in dB, SSIM). MSE to whole mm^2 and the SSIM
#: of bilateral and NLM to two digits, as our notes have them; None: not in our notes.
PRINTED: Final[dict[str, tuple[str, float, float, float | None]]] = {
    "noisy": ("Baseline", 1410.8, 47.6132, 0.9986),
    "adaptive": ("Adaptive", 1410.8, 47.6132, 0.9986),
    "median": ("Median", 1361.0, 47.7992, None),
    "nlm": ("NLM", 1147.0, 48.4857, 0.84),
    "bilateral": ("Bilateral", 1349.0, 47.8734, 0.77),
}


def paper_table(evaluation: Evaluation, table: Table) -> Page:
    """The paper's rows and columns, and which of its relations hold here."""
    columns = [PRINTED[name][0] for name in PAPER]
    mse, psnr, psnr_mean, similar = (
        {name: table[name][metric].mean for name in PAPER}
        for metric in ("mse_mm2", "psnr_db", PSNR_OF_MEAN.name, "ssim_paper")
    )
    base = mse["noisy"]
    printed_base = PRINTED["noisy"][1]
    rows = [
        ["MSE, printed [mm²]", *(number(PRINTED[n][1]) for n in PAPER)],
        ["MSE, ours [mm²]", *(number(mse[n]) for n in PAPER)],
        ["MSE over baseline, printed", *(f"{PRINTED[n][1] / printed_base:.3f}" for n in PAPER)],
        ["MSE over baseline, ours", *(f"{mse[n] / base:.3f}" if base else "n/a" for n in PAPER)],
        ["PSNR, printed [dB]", *(f"{PRINTED[n][2]:.2f}" for n in PAPER)],
        ["PSNR per image, ours [dB]", *(f"{psnr[n]:.2f}" for n in PAPER)],
        ["PSNR of the mean MSE, ours [dB]", *(f"{psnr_mean[n]:.2f}" for n in PAPER)],
        ["SSIM, printed", *(_ssim(PRINTED[n][3]) for n in PAPER)],
        ["SSIM with the printed constants, ours", *(f"{similar[n]:.4f}" for n in PAPER)],
        [
            "SSIM, K1=.01 K2=.03 L=65535, ours",
            *(f"{table[n]['ssim_16bit'].mean:.4f}" for n in PAPER),
        ],
    ]
    worst_first = sorted(("median", "nlm", "bilateral"), key=lambda n: mse[n])
    relations = [
        ("Adaptive equals Baseline", True, mse["adaptive"] == base),
        ("NLM has the lowest MSE of the four", True, worst_first[0] == "nlm"),
        (
            "PSNR per image is above PSNR of the mean MSE",
            True,
            all(psnr[n] >= psnr_mean[n] for n in PAPER),
        ),
        (
            "every filter lowers the MSE",
            True,
            all(mse[n] < base for n in ("median", "nlm", "bilateral")),
        ),
    ]
    return Page(
        "Table 1 of Kendrick, Yap and Tan: printed and measured",
        [
            f"{evaluation.frames} frames of {len(evaluation.summary.subjects)} subjects.",
            Grid(["", *columns], rows),
            f"SSIM with the printed constants: {PRESETS['paper']}. The paper's SSIM column is not "
            "comparable between its rows (its constants, range and types are not known): do not "
            "match it. Adaptive is Essmaeel's temporal filter, on single frames the identity.",
            Grid(
                ["relation", "printed", "ours"],
                [[what, yes(printed), yes(ours)] for what, printed, ours in relations],
            ),
            "What these numbers do not show: " + _surface(table),
        ],
    )


def _ssim(value: float | None) -> str:
    return "not noted" if value is None else f"{value:g}"


def yes(value: bool) -> str:
    """In a cell."""
    return "yes" if value else "**no**"


def _surface(table: Table) -> str:
    parts = [
        f"{PRINTED[name][0]} {number(table[name]['both_interior_rmse_mm'].mean)} mm, "
        f"{number(table[name]['normal_mean_deg'].mean)}°, "
        f"{number(table[name]['flying_px'].mean)} flying pixels"
        for name in PAPER
        if name != "adaptive"
    ]
    return "interior RMSE, normals and pixels in mid-air are " + "; ".join(parts) + "."
