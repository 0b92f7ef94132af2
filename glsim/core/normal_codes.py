"""Unit normals as 16-bit images, for the layer "normals"."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Code of a component of 0, and steps from 0 to 1: -1 becomes 1, so that 0 is free for "none".
_ZERO, _STEPS = 32768, 32767


def encode_normals(normals: NDArray[np.floating], seen: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """Return (..., 3) uint16 codes of (..., 3) unit normals; 0, 0, 0 where ``seen`` is False."""
    codes = np.rint(np.clip(normals, -1, 1) * _STEPS) + _ZERO
    return np.where(seen[..., None], codes, 0).astype(np.uint16)


def decode_normals(codes: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Invert ``encode_normals``: (..., 3) float32 unit normals, 0 where there is none."""
    seen = codes.any(axis=-1, keepdims=True)
    normals = (codes.astype(np.float32) - _ZERO) / _STEPS
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.where(seen, normals / np.where(seen, length, 1), 0).astype(np.float32)
