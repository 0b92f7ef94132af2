"""Folds of cloth: rounded crests that run across its pull, where there is room for them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array
from glsim.appearance.noise import smooth_noise
from glsim.settings.seeds import keyed_rng

#: Half the width of a crest as a value of noise whose standard deviation is 0.3; chosen: a quarter
#: of a draped cloth is crest.
_CREST: Final = 0.33


def crests(places: Array, seed: int) -> NDArray[np.float32]:
    """Return (N,) float32 in [-0.6, 0.85]: rounded crests with broad valleys between them.

    Args:
        places: (N, 3) mm over the distance between crests.
        seed: of the noise.
    """
    value = smooth_noise(places, seed) / np.float32(_CREST)
    return np.asarray(1.6 / (1 + value * value) - 0.75, np.float32)


def trunk_folds(local: Array, share: Array, armpits: Array, seed: int) -> Array:
    """Return (N,) heights of folds on a trunk, about -0.5 to 1.5.

    Flutes fall to the hem, short folds lie where cloth piles up at the waist, and tension draws
    lines from the armpits to the opposite hip.

    Args:
        local: (N, 3) mm: to the side, down, to the front.
        share: (N,) 0 at the neck and 1 at the hem.
        armpits: (2, 3) mm in the same axes.
        seed: of the noise.
    """
    warp = 22.0 * smooth_noise(local / 120.0, seed + 6)[:, None]
    flutes = crests((local + warp) / (85.0, 380.0, 85.0), seed)
    leaning = local + 0.45 * local[:, [1, 0, 2]] + warp
    piled = crests(leaning / (170.0, 58.0, 170.0), seed + 1)
    soft = smooth_noise(local / (80.0, 60.0, 80.0), seed + 2)
    height = 0.5 * soft + 0.9 * flutes * np.clip(1.6 * share - 0.2, 0, 1)
    height += 0.7 * piled * np.exp(-(((share - 0.72) / 0.22) ** 2))
    for side, armpit in zip((1, -1), armpits, strict=True):
        away = local - armpit
        near = np.exp(-((np.linalg.norm(away, axis=1) / 190.0) ** 2))
        draw = keyed_rng(seed, f"pull {side}")
        amount, turn = draw.uniform(0.3, 1.5), draw.uniform(0.4, 1.1)
        # The crest runs down and to the middle: places are stretched along that line.
        along = np.sin(turn) * side * away[:, 0] - np.cos(turn) * away[:, 1]
        across = np.cos(turn) * side * away[:, 0] + np.sin(turn) * away[:, 1]
        pulled = np.stack([along / 190.0, across / 50.0, away[:, 2] / 130.0], axis=1)
        height += amount * near * crests(pulled, seed + 4 + side)
    return np.asarray(height)


def limb_folds(local: Array, share: Array, joint: float, piled_to: float, seed: int) -> Array:
    """Return (N,) heights of folds on a sleeve or a leg of trousers, about -0.5 to 1.5.

    Folds lie across the bend of the joint and pile up at the cuff; between them they wind around
    the limb.

    Args:
        local: (N, 3) mm: across the limb, down, across.
        share: (N,) 0 at the root of the limb and 1 at its end.
        joint: share of elbow or knee.
        piled_to: share of the cuff.
        seed: of the noise.
    """
    wound = local + 0.5 * local[:, [1, 0, 2]] * (1.0, 0.0, 0.0)
    height = 0.6 * crests(wound / (85.0, 85.0, 85.0), seed)
    bent = crests(local / (90.0, 40.0, 90.0), seed + 1)
    height += 1.0 * bent * np.exp(-(((share - joint) / 0.13) ** 2))
    heap = crests(local / (110.0, 32.0, 110.0), seed + 2)
    height += 0.8 * heap * np.exp(-(((share - piled_to + 0.06) / 0.09) ** 2))
    return np.asarray(height)
