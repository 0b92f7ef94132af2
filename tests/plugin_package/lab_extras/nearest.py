"""The denoiser ``nearest``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Nearest:
    """Every pixel gets the smallest depth of its row."""

    add_mm: float = 0.0

    def __call__(self, noisy_mm: Any, valid: Any) -> tuple[Any, Any]:
        least = np.where(valid, noisy_mm, np.inf).min(axis=1, keepdims=True)
        return np.where(valid, least + self.add_mm, 0).astype(np.float32), valid
