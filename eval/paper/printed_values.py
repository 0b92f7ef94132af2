"""Values that Kendrick, Yap and Tan print in "Synthetic Data Generation for Demonstrating Noise
Reduction in Facial Depth Imaging": table 1 (filters), tables 2 and 3 (networks).
"""

from __future__ import annotations

from typing import Final

from glsim.dataset.noise_statistics import PAPER_BASELINE_MSE
from glsim.eval.metrics.catalogue import PSNR_MAX_MM

#: Our name -> (the paper's name, printed MSE in mm^2, PSNR in dB, SSIM). Our notes hold MSE to
#: whole mm^2 and the SSIM of bilateral and NLM to two digits; None: not in our notes.
PRINTED_FILTERS: Final[dict[str, tuple[str, float, float, float | None]]] = {
    "noisy": ("Baseline", PAPER_BASELINE_MSE, 47.6132, 0.9986),
    "adaptive": ("Adaptive", PAPER_BASELINE_MSE, 47.6132, 0.9986),
    "median": ("Median", 1361.0, 47.7992, None),
    "nlm": ("NLM", 1147.0, 48.4857, 0.84),
    "bilateral": ("Bilateral", 1349.0, 47.8734, 0.77),
}
#: Row -> printed PSNR per image, dB, and PSNR of the printed MSE, dB (MAX 8000 mm): our notes of
#: the paper hold the MSE in this form. They hold SSIM as a range: 0.984 to 0.989.
PRINTED_PSNR: Final[dict[str, tuple[float, float]]] = {
    "Restormer": (29.1483, 29.0299),
    "UNet": (30.5461, 30.3465),
    "D7": (32.9725, 32.4701),
    "AR D7": (33.3941, 32.7853),
    "D20": (33.2791, 32.7168),
    "AR D20": (33.2898, 32.7170),
    "D64": (33.3734, 32.7591),
    "AR D64": (33.2267, 32.6887),
}
#: Printed MSE, mm^2, where our notes hold all digits.
_PRINTED_MSE: Final = {"D20": 34237.0065, "AR D20": 34235.7125}


def printed_mse_mm2(row: str) -> float:
    """Return the printed MSE of a row, computed from its PSNR if the digits are not noted."""
    from_psnr = PSNR_MAX_MM**2 / 10 ** (PRINTED_PSNR[row][1] / 10)
    return _PRINTED_MSE.get(row, round(from_psnr, 0))
