"""Pairs to train on, from a data set on disk or rendered while the network trains.

Each pair is ``(noisy_mm, clean_mm)``: (1, H, W) float32 millimetres, 0 = no return.
docs/training_data.md shows whole training scripts. Import the classes from ``glsim.train``; the
names below are kept for older scripts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glsim.train.data.checks import fingerprint
    from glsim.train.data.simulated import SimulatedPairs, randomised
    from glsim.train.data.stored import Augmentation, StoredPairs

__all__ = ["Augmentation", "SimulatedPairs", "StoredPairs", "fingerprint", "randomised"]


def __getattr__(name: str) -> Any:
    """Import a public name from its module, when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'glsim.train.data' has no attribute {name!r}")
    from glsim.train.data import checks, simulated, stored

    homes = (checks, simulated, stored)
    return next(getattr(home, name) for home in homes if hasattr(home, name))
