"""Depth errors of a data set, noisy minus clean: lost and added pixels, and reasons."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from glsim.core.depth_frame import DepthFrame
from glsim.core.depth_map import BAND_PX, interior, jumps
from glsim.core.files.markdown import markdown_table
from glsim.core.reason import Reason


def recording_table(frames: Iterable[DepthFrame], sensor: str) -> str:
    """Return a Markdown table that describes frames without clean maps."""
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


def noise_table(frames: Iterable[DepthFrame], sensor: str) -> str:
    """Return a Markdown table of depth errors over pairs of clean and noisy maps."""
    # Rows: inside surfaces and at their rims. Number of pixels with both depths, sum of the error
    # and of its square.
    sums, lost_px, grown_px = np.zeros((2, 3)), 0, 0
    number, reasons = 0, Counter[Reason]()
    for frame in frames:
        clean, noisy = frame.clean_mm.astype(np.float64), frame.noisy_mm.astype(np.float64)
        inside = interior(clean > 0, jumps(clean))
        both, error = (clean > 0) & (noisy > 0), noisy - clean
        for place, where in enumerate((inside, ~inside)):
            seen = error[both & where]
            sums[place] += [seen.size, seen.sum(), (seen**2).sum()]
        lost_px += ((clean > 0) & (noisy == 0)).sum()
        grown_px += ((clean == 0) & (noisy > 0)).sum()
        number += 1
        if "reason" in frame:
            codes, counts = np.unique(frame.reason, return_counts=True)
            reasons.update(dict(zip(map(Reason, codes.tolist()), counts.tolist(), strict=True)))
    with np.errstate(invalid="ignore"):
        bias, rms = sums[:, 1] / sums[:, 0], (sums[:, 2] / sums[:, 0]) ** 0.5
    surface = sums[:, 0].sum() + lost_px
    rows = [
        ("sensor", sensor), ("frames measured", f"{number}"),
        ("errors and shares", "over the pixels of all frames together"),
        ("surface pixels per frame", f"{surface / number:.0f}"),
        ("noisy - clean inside surfaces", f"mean {bias[0]:+.2f} mm, rms {rms[0]:.2f} mm"),
        (f"within {BAND_PX} px of rims and holes", f"mean {bias[1]:+.2f} mm, rms {rms[1]:.2f} mm"),
        ("surface lost", f"{100 * lost_px / max(surface, 1):.2f} %"),
        ("depth where there is no surface", f"{grown_px / number:.1f} px per frame"),
    ]  # fmt: skip
    rows += [
        (f"{code.name.lower()}: {code.help}", f"{count / number:.1f} px per frame")
        for code, count in sorted(reasons.items())
        if code != Reason.NO_SURFACE
    ]
    return "\n".join(markdown_table(("quantity", "value"), rows)) + "\n"
