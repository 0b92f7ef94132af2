"""Pairs to train on, from a data set on disk or rendered while the network trains.

Each pair is ``(noisy_mm, clean_mm)``: (1, H, W) float32 millimetres, 0 = no return. Both classes
fit a plain ``torch.utils.data.DataLoader``; docs/training_data.md shows whole training scripts.
"""

from .checks import fingerprint
from .simulated import SimulatedPairs, randomised
from .stored import Augmentation, StoredPairs

__all__ = ["Augmentation", "SimulatedPairs", "StoredPairs", "fingerprint", "randomised"]
