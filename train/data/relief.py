"""Small relief that is laid on a clean and a noisy frame alike, so that surfaces hold surprises.

A network that is trained on embedded heads alone learns that skin is as smooth as they are, and
irons out what other faces have: lids, creases, nostrils. Bumps and creases of any size, drawn anew
for each frame, leave it nothing to rely on but the noise. By experiment (embedded heads, kinect-v2
at 0.8 to 1.0 m, scored on ICT-FaceKit): without relief the interior error there was 1.19 mm after
1,000 steps of 8 frames and 1.27 after 2,000, with it 1.14 after 500 and 1.17 after 1,000.

The noise of a pair was drawn for the surface without relief, which is right to first order: what
decides it, distance and tilt, changes little where the relief's slope is small.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

#: Sizes of the bumps, px (a Gaussian's sigma), and their heights over that of the largest: from
#: creases to cheekbones at 0.9 m, 2.5 mm a pixel, and about as steep as each other.
_SIZES_PX: Final = (1.2, 2.5, 5.0, 10.0)
_HEIGHTS: Final = (0.25, 0.5, 0.75, 1.0)
#: Relief comes in patches of about this sigma, px: a face is not rough all over.
_PATCH_PX: Final = 12.0
#: Of the frames, so many stay as they are; of the layers, so many are creased instead of bumpy.
_UNTOUCHED, _CREASED = 0.25, 0.5


def draw_relief(
    shape: tuple[int, int], height_mm: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """(H, W) float32 millimetres to add to depth; of the largest bumps ``height_mm`` is the most
    that their standard deviation can be.
    """
    relief = np.zeros(shape, np.float32)
    if rng.random() < _UNTOUCHED:
        return relief
    for size_px, height in zip(_SIZES_PX, _HEIGHTS, strict=True):
        bumps = _smooth_noise(shape, size_px, rng)
        if rng.random() < _CREASED:
            bumps = (1 - 1.5 * np.abs(bumps)).astype(np.float32)
        patches = np.clip(_smooth_noise(shape, _PATCH_PX, rng), 0, 2)
        relief += (height_mm * rng.random() ** 2 * height * bumps * patches).astype(np.float32)
    return relief


def _smooth_noise(
    shape: tuple[int, int], sigma_px: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Of variance 1."""
    white = rng.standard_normal(shape, dtype=np.float32)
    smooth: NDArray[np.float32] = cv2.GaussianBlur(white, (0, 0), sigma_px)
    return smooth / max(float(smooth.std()), 1e-6)
