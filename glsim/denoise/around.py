"""Denoise only around the nearest head of a frame, which needs no detector: for live streams.

The nearest piece of surface that is large enough is taken for a person, and what is within a
head's height of its top for the head. The rest of the frame stays as it was measured.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise.filters.led3d import pieces
from glsim.denoise.interface import Depth, Mask, Method
from glsim.denoise.tiles import Box, box_around
from glsim.errors import ConfigError, did_you_mean

#: What ``around`` may be.
AROUND: Final = ("face",)
#: Height and width of the part that is denoised, mm: a head of the 99th percentile is 255 mm high
#: (ANSUR II, stature less chin height) and 165 mm wide; the rest is for hair and a turned head.
HEAD_MM: Final = (280.0, 220.0)
#: Focal length over the width of the image: Kinect V2 0.71, Azure Kinect 0.79, D435 0.60 to 0.67,
#: TrueDepth 0.68. A wrong one makes the box a little too large or too small.
FOCAL_SHARE: Final = 0.7
#: Least area of a person, of a box of HEAD_MM at its distance: smaller pieces are hands and noise.
#: Chosen.
_LEAST_SHARE: Final = 0.15
#: Smallest piece that is looked at, coarse pixels. Chosen: a face is larger up to 5 m.
_LEAST_PX: Final = 20
#: Frames are divided by this for the search, px.
_COARSE_PX: Final = 4
#: Surface around the head that is denoised too, px. Chosen: with it, cutting the frame there moves
#: no depth of the head by more than 0.1 mm.
_MARGIN_PX: Final = 32


def head_box(depth_mm: Depth) -> Box | None:
    """Return the box of the nearest head and some of its surroundings; None without any.

    Args:
        depth_mm: (H, W) millimetres, 0 = no depth.
    """
    coarse = np.ascontiguousarray(depth_mm[::_COARSE_PX, ::_COARSE_PX])
    labels = pieces(coarse, coarse > 0)
    focal_px = FOCAL_SHARE * depth_mm.shape[1]
    nearest: tuple[float, Mask] | None = None
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    for label in np.flatnonzero(areas >= _LEAST_PX):
        piece = labels == label
        distance_mm = float(np.percentile(coarse[piece], 10))
        height, width = (focal_px / distance_mm / _COARSE_PX * size for size in HEAD_MM)
        if areas[label] < _LEAST_SHARE * height * width:
            continue
        if nearest is None or distance_mm < nearest[0]:
            nearest = distance_mm, _head(piece, height, width)
    if nearest is None:
        return None
    head = cv2.resize(
        nearest[1].astype(np.uint8), depth_mm.shape[::-1], interpolation=cv2.INTER_NEAREST
    )
    return box_around(head > 0, _MARGIN_PX)


def _head(piece: Mask, height: float, width: float) -> Mask:
    """Mark the box of a head's size, pixels, at the top of a piece."""
    rows = np.flatnonzero(piece.sum(axis=1) >= max(1.0, 0.15 * width))
    top = int(rows[0]) if rows.size else int(np.flatnonzero(piece.any(axis=1))[0])
    upper = piece[top : top + max(1, round(0.6 * height))]
    middle = int(np.median(np.nonzero(upper)[1]))
    head = np.zeros_like(piece)
    left = max(0, middle - round(width / 2))
    head[top : top + round(height), left : middle + round(width / 2) + 1] = True
    return head


def only_around(method: Method, what: str | None) -> Method:
    """Return a denoiser that works around the nearest head; None: the denoiser itself.

    Raises ConfigError for another word than "face".
    """
    if what is None:
        return method
    if what not in AROUND:
        raise ConfigError(f"--around {what}: {did_you_mean(what, AROUND)}")
    return replace(method, function=_Around(method))


class _Around:
    """Runs a denoiser on a box of a frame; outside, depth stays as it was measured."""

    uncertain = False  # there is none outside

    def __init__(self, method: Method) -> None:
        self._method = method

    def __call__(
        self, noisy_mm: Depth, valid: Mask, *now: int, **images: NDArray[Any] | None
    ) -> tuple[Depth, NDArray[Any]]:
        """Denoise a frame, or frame ``now`` of a sequence; arguments as of the denoiser's own."""
        frame, seen = (noisy_mm[now[0]], valid[now[0]]) if now else (noisy_mm, valid)
        box = head_box(frame)
        if box is None:
            return frame, seen
        cropped = {
            name: None if image is None else np.ascontiguousarray(image[box])
            for name, image in images.items()
        }
        part = np.ascontiguousarray(noisy_mm[..., *box])
        result, kept = self._method.function(part, valid[..., *box], *now, **cropped)
        depth_mm, validity = frame.copy(), seen.astype(np.asarray(kept).dtype)
        depth_mm[box], validity[box] = result, kept
        return depth_mm, validity
