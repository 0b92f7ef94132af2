"""Define parts of the face mesh by the 68 Multi-PIE landmarks, in the frontal view.

The size of each part around its landmarks is chosen to cover the same area as the part of this name
in procedural faces (``tools/heads/regions.py``).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

#: Parts of the face mesh; a later one overrides an earlier one, the rest is "face".
FACE_PARTS: Final = ("forehead", "cheek", "chin", "lids", "nose", "brow", "lips")

BROW_HALF_HEIGHT_CM: Final = 0.35  # a brow is about 7 mm high
LIDS_WIDTH_RATIO: Final = 1.3  # width of the lids over width of the eye
LIDS_ASPECT_RATIO: Final = 1.25  # width over height of the lids
CHEEK_BELOW_EYES_CM: Final = 1.1  # from the level of the eyes to the upper end of the cheek
CHEEK_FROM_MIDLINE_CM: Final = 2.2
CHIN_HALF_WIDTH_CM: Final = 2.4
CHIN_BELOW_LIPS_CM: Final = 0.6
NOSE_WIDTH_RATIO: Final = 1.4  # half width of the nose over that of its base (landmark 35)


def face_parts(points: _Array, landmarks: _Array) -> dict[str, NDArray[np.bool_]]:
    """Return part -> (V,) whether each point belongs to it; parts overlap.

    Args:
        points: (V, 3) centimetres, +x the subject's left, +y up.
        landmarks: (68, 3).
    """
    x, y, side = points[:, 0], points[:, 1], np.abs(points[:, 0])
    eyes = (landmarks[36:42], landmarks[42:48])
    brows = (landmarks[17:22], landmarks[22:27])
    eye_level = float(np.mean([eye[:, 1].mean() for eye in eyes]))
    brow_level = float(np.mean([brow[:, 1].mean() for brow in brows]))
    jaw = landmarks[:17][np.argsort(landmarks[:17, 0])]
    above_jaw = y > np.interp(x, jaw[:, 0], jaw[:, 1])
    lower_lip = float(landmarks[57, 1])
    inner = float(np.abs(landmarks[[39, 42], 0]).mean())
    wing = NOSE_WIDTH_RATIO * float(np.abs(landmarks[[31, 35], 0]).mean())
    heights = landmarks[[33, 30, 28, 27], 1]  # base, tip, bridge, root: upwards
    nose_half = np.interp(y, heights, (wing, wing, inner / 2, inner / 2), left=0.0, right=0.0)
    lids, brow = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for eye in eyes:
        centre, half = eye.mean(axis=0), np.ptp(eye[:, 0]) / 2
        lids |= (
            np.hypot(x - centre[0], (y - centre[1]) * LIDS_ASPECT_RATIO) < LIDS_WIDTH_RATIO * half
        )
    for line in brows:
        arch = np.interp(x, line[:, 0], line[:, 1], left=np.inf, right=np.inf)
        brow |= np.abs(y - arch) < BROW_HALF_HEIGHT_CM
    return {
        "forehead": y > brow_level,
        "cheek": above_jaw & (y < eye_level - CHEEK_BELOW_EYES_CM) & (side > CHEEK_FROM_MIDLINE_CM),
        "chin": above_jaw & (y < lower_lip - CHIN_BELOW_LIPS_CM) & (side < CHIN_HALF_WIDTH_CM),
        "lids": lids,
        "nose": side < nose_half,
        "brow": brow,
        "lips": _inside(x, y, landmarks[48:60, :2]),
    }


def _inside(x: _Array, y: _Array, outline: _Array) -> NDArray[np.bool_]:
    """Return (V,) whether a polygon (K, 2) encloses each point (even-odd rule)."""
    inside = np.zeros(len(x), dtype=bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > y) != (y1 > y)
            inside ^= crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return inside
