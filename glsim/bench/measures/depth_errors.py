"""Depth errors of a data set: noisy against clean, lost and added pixels, reasons."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from glsim.core.depth_frame import DepthFrame
from glsim.core.files.markdown import markdown_table
from glsim.core.reason import Reason

#: Mean squared difference of noisy and clean over all pixels of the paper's 128x128 crops, mm^2.
#: Source: Kendrick, Yap and Tan, table 1, row "baseline".
PAPER_BASELINE_MSE = 1410.8397


@dataclass
class DepthErrors:
    """Sums over pairs of frames, from which the properties are computed.

    Attributes:
        frames: number of frames.
        pixels: number of pixels.
        both: pixels with clean and noisy depth.
        lost: pixels with clean depth only.
        grown: pixels with noisy depth only.
        sum_mm: sum of noisy - clean over ``both``.
        sum_squared_mm2: sum of its squares.
        sum_all_squared_mm2: sum of squares over all pixels, holes as depth 0.
        reasons: pixels by reason code.

    """

    frames: int = 0
    pixels: int = 0
    both: int = 0
    lost: int = 0
    grown: int = 0
    sum_mm: float = 0.0
    sum_squared_mm2: float = 0.0
    sum_all_squared_mm2: float = 0.0
    reasons: Counter[Reason] = field(default_factory=Counter)

    def add(self, frame: DepthFrame) -> None:
        """Add one frame."""
        clean, noisy = frame.clean_mm.astype(np.float64), frame.noisy_mm.astype(np.float64)
        both = (clean > 0) & (noisy > 0)
        error = (noisy - clean)[both]
        self.frames += 1
        self.pixels += clean.size
        self.both += int(both.sum())
        self.lost += int(((clean > 0) & (noisy == 0)).sum())
        self.grown += int(((clean == 0) & (noisy > 0)).sum())
        self.sum_mm += float(error.sum())
        self.sum_squared_mm2 += float((error**2).sum())
        self.sum_all_squared_mm2 += float(((noisy - clean) ** 2).sum())
        if "reason" in frame:
            codes, counts = np.unique(frame.reason, return_counts=True)
            for code, count in zip(codes, counts, strict=True):
                self.reasons[Reason(int(code))] += int(count)

    @property
    def bias_mm(self) -> float:
        """Mean of noisy - clean where both have depth, mm; NaN without such pixels."""
        return self.sum_mm / self.both if self.both else float("nan")

    @property
    def rms_mm(self) -> float:
        """RMS of noisy - clean where both have depth, mm; NaN without such pixels."""
        return (self.sum_squared_mm2 / self.both) ** 0.5 if self.both else float("nan")

    @property
    def mse_all_mm2(self) -> float:
        """Mean squared difference over all pixels, mm^2, holes as depth 0, as in table 1."""
        return self.sum_all_squared_mm2 / self.pixels if self.pixels else float("nan")


def measure_errors(frames: Iterable[DepthFrame]) -> DepthErrors:
    """Sum the errors of noisy depth over pairs of clean and noisy maps."""
    errors = DepthErrors()
    for frame in frames:
        errors.add(frame)
    return errors


def recording_table(frames: Iterable[DepthFrame], sensor: str) -> str:
    """Return a Markdown table of frames without clean maps."""
    count = pixels = known = 0
    nearest, farthest = [], []
    for frame in frames:
        depth = frame.noisy_mm
        valid = depth[depth > 0]
        count, pixels, known = count + 1, pixels + depth.size, known + valid.size
        if valid.size:
            low, high = np.percentile(valid, (1, 99))
            nearest.append(float(low))
            farthest.append(float(high))
    rows = [
        ("sensor", sensor),
        ("frames measured", f"{count}"),
        ("pixels with depth", f"{100 * known / max(pixels, 1):.2f} %"),
    ]
    if nearest:
        text = f"{min(nearest):.0f} to {max(farthest):.0f} mm"
        rows.append(("depth, percentiles 1 to 99 of the frames", text))
    rows.append(("noisy - clean", "not known: the data set has no clean maps"))
    return "\n".join(markdown_table(("quantity", "value"), rows)) + "\n"


def noise_table(noise: DepthErrors, sensor: str) -> str:
    """Return a Markdown table of the errors."""
    surface = noise.both + noise.lost
    rows = [
        ("sensor", sensor),
        ("frames measured", f"{noise.frames}"),
        ("surface pixels per frame", f"{surface / max(noise.frames, 1):.0f}"),
        ("noisy - clean, mean", f"{noise.bias_mm:+.2f} mm"),
        ("noisy - clean, rms", f"{noise.rms_mm:.2f} mm"),
        ("surface lost", f"{100 * noise.lost / max(surface, 1):.2f} %"),
        (
            "depth where there is no surface",
            f"{noise.grown / max(noise.frames, 1):.1f} px per frame",
        ),
        (
            "mean squared difference, all pixels",
            f"{noise.mse_all_mm2:.0f} mm^2 (the paper's baseline on 128x128 crops: "
            f"{PAPER_BASELINE_MSE:.0f})",
        ),
    ]
    rows += [
        (f"{code.name.lower()}: {code.help}", f"{count / noise.frames:.1f} px per frame")
        for code, count in sorted(noise.reasons.items())
        if code != Reason.NO_SURFACE
    ]
    return "\n".join(markdown_table(("quantity", "value"), rows)) + "\n"
