"""Composites: depth maps made of a denoised depth and the probability that a pixel has depth.

The default, "measured", leaves it to the sensor where there is depth: it keeps measured pixels,
drops those in mid-air and closes small holes. The probability alone ("hard") drops 58 % of the
outermost ring of things before a background in real frames of a Kinect V2, a third of the second
ring, and fills a third of the shadows with single pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise.interface import MIN_DEPTH_MM, Denoised, Depth, Mask, Probability
from glsim.errors import ConfigError, did_you_mean

#: Ways to turn a soft validity into a depth map: name -> meaning.
COMPOSITES: Final = {
    "measured": "depth where the input has depth: mid-air pixels dropped, holes of 2 px closed",
    "soft": "depth times probability, which minimises the squared error",
    "hard": "depth where the probability exceeds 1/2",
    "input mask": "depth where the input has depth: surface quality without guessing silhouettes",
}
#: The composite of ``glsim denoise``, ``glsim.load_denoiser`` and the model card.
DEFAULT_COMPOSITE: Final = "measured"

#: A denoiser doubts that a pixel has depth if the probability is at most this.
DOUBT: Final = 0.5
#: Two pixels lie on one surface if their depths differ by at most this, mm and mm per m of
#: distance; as in ``glsim.measures.silhouettes``. At 0.9 m the last pixel of a head's rim lies
#: 21 mm behind its neighbour (radius 90 mm, 2.5 mm a pixel), and this allows 28 mm.
SAME_SURFACE_MM, SAME_SURFACE_MM_PER_M = 15.0, 15.0
#: Surfaces are looked for this far around a pixel: the width of the widest hole that is closed.
REACH_PX: Final = 2
#: A pixel that is in doubt lies on a surface if so many of the 24 pixels around lie on the same
#: surface and are in no doubt; or if this share of those in the image lie on it at all, as on a
#: straight edge. Chosen by experiment: docs/denoise.md.
LEAST_SURE, LEAST_PATCH = 3, 0.5
#: A filled pixel touches at least so many measured ones: those in a gap 2 px wide touch 3. So no
#: single pixel appears in a shadow.
LEAST_TOUCHING: Final = 3


def check_composite(name: str, where: str) -> None:
    """Raise ConfigError for an unknown composite; where: names the option in the message."""
    if name not in COMPOSITES:
        raise ConfigError(f"{where} {name}: no such composite ({did_you_mean(name, COMPOSITES)})")


def compose(denoised: Denoised, noisy_mm: Depth) -> dict[str, NDArray[Any]]:
    """Return depth maps with 0 = no depth: key "" for a bool validity, else those of COMPOSITES.

    noisy_mm: (H, W) the input. A soft product below half a millimetre becomes 0.
    """
    names = ("",) if denoised[1].dtype.kind == "b" else COMPOSITES
    return {name: composed(denoised, noisy_mm, name) for name in names}


def composed(denoised: Denoised, noisy_mm: Depth, composite: str) -> NDArray[Any]:
    """Return one depth map as ``compose`` does. A bool validity is used whatever the composite."""
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
    """Return the composite "measured", (H, W) millimetres of the type of ``depth_mm``, 0 = none.

    depth_mm, probability: (H, W) result of a denoiser; the probability is 0 where its depth is not
    to be trusted (``glsim.denoise.safeguards``). noisy_mm: (H, W) the input, 0 = no return.

    A measured pixel in doubt stays if it lies on a surface (LEAST_SURE, LEAST_PATCH), with its
    denoised depth, or its measured one if the denoised depth is not on the same surface. A hole
    that is nowhere wider than REACH_PX and does not touch the border gets its denoised depth where
    the denoiser is in no doubt and all depths around lie on one surface.
    """
    measured = noisy_mm > 0
    sure = probability > DOUBT
    kept = measured & (sure | _on_surface(noisy_mm, measured & ~sure, measured & sure))
    same = np.abs(depth_mm - noisy_mm) <= tolerance_mm(noisy_mm)
    surface = np.where(sure | same, depth_mm, noisy_mm.astype(depth_mm.dtype))
    filled = _closed_holes(noisy_mm, np.where(sure, depth_mm, 0), kept)
    return np.where(filled, depth_mm, np.where(kept, surface, depth_mm.dtype.type(0)))


def tolerance_mm(depth_mm: Depth) -> Depth:
    """Return the largest difference of depths on one surface, mm, of the shape of ``depth_mm``."""
    return np.asarray(SAME_SURFACE_MM + SAME_SURFACE_MM_PER_M * 0.001 * depth_mm, np.float32)


def _on_surface(noisy_mm: Depth, asked: Mask, sure: Mask) -> Mask:
    """Return the pixels of ``asked`` that lie on a surface. sure: measured, in no doubt."""
    own = noisy_mm[asked]
    allowed = tolerance_mm(own)
    alike, surely, places = (np.zeros(own.shape, np.uint8) for _ in range(3))
    images = (noisy_mm, sure, np.ones_like(asked))
    for depth, known, inside in zip(*(_around(i, asked, REACH_PX) for i in images), strict=True):
        near = (depth > 0) & (np.abs(depth - own) <= allowed)
        alike += near
        surely += near & known
        places += inside
    found = np.zeros_like(asked)
    found[asked] = (surely >= LEAST_SURE) | (alike >= LEAST_PATCH * places)
    return found


def _closed_holes(noisy_mm: Depth, sure_mm: Depth, kept: Mask) -> Mask:
    """Return the holes to close.

    sure_mm: (H, W) denoised depth, 0 where in doubt. kept: measured pixels that keep their depth.
    """
    asked = _narrow_holes(noisy_mm == 0) & (sure_mm > 0)
    own = sure_mm[asked]
    allowed = tolerance_mm(own)
    one = np.ones(own.shape, np.bool_)
    for depth in _around(noisy_mm, asked, REACH_PX):
        one &= (depth == 0) | (np.abs(depth - own) <= allowed)
    touching = np.zeros(own.shape, np.uint8)
    for neighbour in _around(kept, asked, 1):
        touching += neighbour
    asked[asked] = one & (touching >= LEAST_TOUCHING)
    return asked


def _narrow_holes(empty: Mask) -> Mask:
    """Return the connected holes that are nowhere wider than REACH_PX and inside the image."""
    count, labels = cv2.connectedComponents(empty.astype(np.uint8), connectivity=4)
    side = REACH_PX + 1
    wide = cv2.erode(empty.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    narrow = np.ones(count, np.bool_)
    narrow[0] = False  # what is no hole
    for outside in (labels[wide], labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        narrow[outside] = False
    return np.asarray(narrow[labels])


def _around(image: NDArray[Any], asked: Mask, reach_px: int) -> Iterator[NDArray[Any]]:
    """Yield the neighbours of N pixels, (N,) for each place within reach_px; 0 outside."""
    padded = np.pad(image, reach_px)
    rows, columns = np.nonzero(asked)
    for down in range(2 * reach_px + 1):
        for right in range(2 * reach_px + 1):
            if (down, right) != (reach_px, reach_px):
                yield padded[rows + down, columns + right]
