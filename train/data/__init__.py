"""Pairs to train on, from a data set on disk or rendered while the network trains.

Each pair is ``(noisy_mm, clean_mm)``: (1, H, W) float32 millimetres, 0 = no return. Both classes
fit a plain ``torch.utils.data.DataLoader``; docs/training_data.md shows whole training scripts.
"""

from glsim.train.data.checks import fingerprint
from glsim.train.data.stored import StoredPairs

__all__ = ["StoredPairs", "fingerprint"]
