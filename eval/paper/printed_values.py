"""The values that the paper prints in table 1 (filters) and tables 2 and 3 (networks).

Kendrick, Yap and Tan, "Synthetic Data Generation for Demonstrating Noise Reduction in Facial Depth
Imaging".
"""

from __future__ import annotations

from typing import Final, NamedTuple

#: Mean squared difference of noisy and clean over all pixels of the 128x128 crops, mm^2.
_BASELINE_MSE: Final = 1410.8397


class PrintedRow(NamedTuple):
    """A row of a table in the paper: title as printed, MSE in mm^2, PSNR in dB."""

    title: str
    mse_mm2: float
    psnr_db: float
    ssim: float


#: Table 1: our name of a filter -> its row.
PRINTED_FILTERS: Final = {
    "noisy": PrintedRow("Baseline", _BASELINE_MSE, 47.6132, 0.9986),
    "adaptive": PrintedRow("Adaptive", _BASELINE_MSE, 47.6132, 0.9986),
    "median": PrintedRow("Median", 1361.1435, 47.7992, 0.9986),
    "nlm": PrintedRow("NLM", 1147.3265, 48.4857, 0.8373),
    "bilateral": PrintedRow("Bilateral", 1349.4505, 47.8734, 0.7704),
}
#: Tables 2 (Restormer, UNet) and 3 (DnCNN by depth; AR: with artefact removal).
PRINTED_NETWORKS: Final = {
    row.title: row
    for row in (
        PrintedRow("Restormer", 80017.7539, 29.1483, 0.9733),
        PrintedRow("UNet", 59091.5583, 30.5461, 0.9673),
        PrintedRow("D7", 36238.2963, 32.9725, 0.9861),
        PrintedRow("D20", 34237.0065, 33.2791, 0.9852),
        PrintedRow("D64", 33905.1296, 33.3734, 0.9885),
        PrintedRow("AR D7", 33701.7603, 33.3941, 0.9838),
        PrintedRow("AR D20", 34235.7125, 33.2898, 0.9838),
        PrintedRow("AR D64", 34459.7883, 33.2267, 0.9881),
    )
}
