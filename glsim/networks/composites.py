"""Composites: depth maps made from a denoised depth and the probability that a pixel has depth.

The default, "measured", keeps the sensor's mask without flying pixels, unlikely rims and small
holes. A threshold ("hard") erodes silhouettes and fills shadows of real frames (howto/denoise.md).
"""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth, Mask, Probability
from glsim.core.depth_map import MEASURED_STEP, around
from glsim.core.errors import ConfigError, did_you_mean
from glsim.networks.interface import MIN_DEPTH_MM

#: Ways to turn a soft validity into a depth map: name -> meaning.
COMPOSITES: Final = {
    "measured": "depth where the input has depth: mid-air pixels and unlikely rims dropped, holes "
    "of 2 px closed",
    "soft": "depth times probability, which minimises the squared error",
    "hard": "depth where the probability exceeds 1/2",
    "input mask": "depth where the input has depth: surface quality without guessing silhouettes",
}
#: The composite of ``glsim denoise``, ``glsim.load_denoiser`` and the model card.
DEFAULT_COMPOSITE: Final = "measured"

#: A pixel is doubtful if its probability of depth is at most this.
DOUBT: Final = 0.5
#: Pixels beside holes are removed up to this probability. Chosen: `face` and `face-azure-kinect`
#: then lose at most 5 % of the outermost right pixels of bare heads (docs/howto/denoise.md).
UNLIKELY: Final = 0.17
#: Radius of the neighbourhood of a pixel, and width of the widest hole that is filled, px.
REACH_PX: Final = 2
#: A doubtful pixel counts as part of a surface if this number of the 24 pixels around it are sure
#: and lie on that surface, or this share of all around it do. Measured: docs/howto/denoise.md.
LEAST_SURE, LEAST_PATCH = 3, 0.5
#: A pixel is filled only if this number of its neighbours is measured; a gap 2 px wide has 3.
LEAST_TOUCHING: Final = 3
#: Pixels up to this distance from a hole are beside it, px. Measured: nine tenths of the wrong
#: pixels of simulated heads are within 2 px (Kinect V2), 3 px (TrueDepth) or 4 px (D435, D415).
BESIDE_PX: Final = 4


def check_composite(name: str, where: str) -> None:
    """Raise ConfigError for an unknown composite; ``where`` names the option in the message."""
    if name not in COMPOSITES:
        raise ConfigError(f"{where} {name}: no such composite ({did_you_mean(name, COMPOSITES)})")


def composed(
    denoised: tuple[Depth, Mask | Probability], noisy_mm: Depth, composite: str
) -> NDArray[Any]:
    """Compute a composite, (H, W) mm, 0 = none; a bool mask is applied in any case."""
    depth, valid = denoised
    none = depth.dtype.type(0)
    if valid.dtype.kind == "b":
        return np.where(valid, depth, none)
    if composite == "measured":
        return measured_surfaces(depth, valid, noisy_mm)
    if composite == "soft":
        soft = depth * valid
        return np.where(soft >= MIN_DEPTH_MM, soft, 0)
    return np.where(valid > DOUBT if composite == "hard" else noisy_mm > 0, depth, none)


def measured_surfaces(depth_mm: Depth, probability: Mask | Probability, noisy_mm: Depth) -> Depth:
    """Compute the composite "measured": depth where the input has depth, small holes closed.

    A measured pixel beside a hole is removed if it is UNLIKELY. Another doubtful pixel stays if it
    is part of a surface (LEAST_SURE, LEAST_PATCH), with its denoised depth if this is on the same
    surface, else its measured depth. A hole of at most REACH_PX inside the image is filled if the
    denoiser is sure and all depths around are on one surface. Depths are (H, W) mm, 0 = none.
    """
    measured = noisy_mm > 0
    sure = probability > DOUBT
    kept = measured & (sure | _on_surface(noisy_mm, measured & ~sure, measured & sure))
    kept &= ~_unlikely(probability, noisy_mm)
    same = np.abs(depth_mm - noisy_mm) <= MEASURED_STEP.limit_mm(noisy_mm)
    surface = np.where(sure | same, depth_mm, noisy_mm.astype(depth_mm.dtype))
    filled = _closed_holes(noisy_mm, np.where(sure, depth_mm, 0), kept)
    return np.where(filled, depth_mm, np.where(kept, surface, depth_mm.dtype.type(0)))


def _unlikely(probability: Mask | Probability, noisy_mm: Depth) -> Mask:
    """Mark measured pixels beside a hole to which the network gives a low probability of depth."""
    # The safeguards set 0 where the choice of surface is uncertain, not where depth is missing.
    doubted = (probability > 0) & (probability <= UNLIKELY)
    return np.asarray((noisy_mm > 0) & beside_holes(noisy_mm) & doubted)


def beside_holes(noisy_mm: Depth) -> Mask:
    """Mark the (H, W) pixels within BESIDE_PX of a hole, with the holes."""
    side = 2 * BESIDE_PX + 1
    holes = (noisy_mm == 0).astype(np.uint8)
    return np.asarray(cv2.dilate(holes, np.ones((side, side), np.uint8), borderValue=0) > 0)


def _on_surface(noisy_mm: Depth, asked: Mask, sure: Mask) -> Mask:
    """Select the pixels of ``asked`` whose neighbours in ``sure`` lie on the same surface."""
    own = noisy_mm[asked][:, None]
    depth = around(noisy_mm, REACH_PX, asked, 0)
    known, inside = (around(mask, REACH_PX, asked, 0) for mask in (sure, np.ones_like(asked)))
    alike = (depth > 0) & (np.abs(depth - own) <= MEASURED_STEP.limit_mm(own))
    surely, pixels, places = (np.sum(part, axis=1) for part in (alike & known, alike, inside))
    found = np.zeros_like(asked)
    # The pixel itself is not counted.
    found[asked] = (surely >= LEAST_SURE) | (pixels - 1 >= LEAST_PATCH * (places - 1))
    return found


def _closed_holes(noisy_mm: Depth, sure_mm: Depth, kept: Mask) -> Mask:
    """Select the hole pixels to fill; ``sure_mm`` is the denoised depth, 0 where doubtful."""
    closed = _narrow_holes(noisy_mm == 0) & (sure_mm > 0)
    own = sure_mm[closed][:, None]
    depth = around(noisy_mm, REACH_PX, closed, 0)
    one = ((depth == 0) | (np.abs(depth - own) <= MEASURED_STEP.limit_mm(own))).all(axis=1)
    closed[closed] = one & (around(kept, 1, closed, 0).sum(axis=1) >= LEAST_TOUCHING)
    return closed


def _narrow_holes(empty: Mask) -> Mask:
    """Select connected holes that are at most REACH_PX wide and do not touch the image border."""
    count, labels = cv2.connectedComponents(empty.astype(np.uint8), connectivity=4)
    side = REACH_PX + 1
    wide = cv2.erode(empty.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    narrow = np.ones(count, np.bool_)
    narrow[0] = False  # label 0: no hole
    for outside in (labels[wide], labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        narrow[outside] = False
    return np.asarray(narrow[labels])
