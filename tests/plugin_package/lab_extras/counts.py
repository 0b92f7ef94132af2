"""The export ``counts``."""

from __future__ import annotations

import glsim

COUNTS = glsim.Export(
    "counts",
    "number of pixels with depth",
    lambda frame: [("_count.txt", str(int((frame.noisy_mm > 0).sum())).encode())],
)
