"""Parts of the face mesh by the 68 Multi-PIE landmarks, as the neutral face is seen from the front.

The landmarks are points; how far a part reaches about them is chosen so that parts of one name
cover the same place as those of the embedded faces (``glsim.faces.procedural.regions``).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

#: Of the face mesh, later ones over earlier ones; what is in none stays "face".
FACE_PARTS: Final = ("forehead", "cheek", "chin", "lids", "nose", "brow", "lips")

BROW_HALF: Final = 0.35  # cm; a brow is about 7 mm high
LIDS_OF_EYE: Final = 1.3  # half the width of what the lids cover, in half widths of the eye
LIDS_FLATTER: Final = 1.25  # width over height of the same
BELOW_EYE: Final = 1.1  # cm from the eyes' level to the upper end of the cheek
BESIDE_NOSE: Final = 2.2  # cm from the middle to the cheek
CHIN_HALF: Final = 2.4  # cm
BELOW_LIPS: Final = 0.6  # cm from the lower lip to the chin
WING: Final = 1.4  # half the width of the nose over its base's corner (landmark 35)


def face_parts(points: _Array, landmarks: _Array) -> dict[str, NDArray[np.bool_]]:
    """FACE_PARTS: (V,) which points belong to each; they overlap.

    points: (V, 3) centimetres, +x the subject's left, +y up. landmarks: (68, 3).
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
    wing = WING * float(np.abs(landmarks[[31, 35], 0]).mean())
    heights = landmarks[[33, 30, 28, 27], 1]  # base, tip, bridge, root: upwards
    nose_half = np.interp(y, heights, (wing, wing, inner / 2, inner / 2), left=0.0, right=0.0)
    lids, brow = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for eye in eyes:
        centre, half = eye.mean(axis=0), np.ptp(eye[:, 0]) / 2
        lids |= np.hypot(x - centre[0], (y - centre[1]) * LIDS_FLATTER) < LIDS_OF_EYE * half
    for line in brows:
        arch = np.interp(x, line[:, 0], line[:, 1], left=np.inf, right=np.inf)
        brow |= np.abs(y - arch) < BROW_HALF
    return {
        "forehead": y > brow_level,
        "cheek": above_jaw & (y < eye_level - BELOW_EYE) & (side > BESIDE_NOSE),
        "chin": above_jaw & (y < lower_lip - BELOW_LIPS) & (side < CHIN_HALF),
        "lids": lids,
        "nose": side < nose_half,
        "brow": brow,
        "lips": _inside(x, y, landmarks[48:60, :2]),
    }


def _inside(x: _Array, y: _Array, outline: _Array) -> NDArray[np.bool_]:
    """Which points a polygon encloses (even-odd rule)."""
    inside = np.zeros(len(x), dtype=bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > y) != (y1 > y)
            inside ^= crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return inside
