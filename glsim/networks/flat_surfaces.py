"""Walls: the network's depth is held to the plane around, which mends ghosts beside holes."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np

from glsim.core.array_types import Array, Depth, Mask, Probability
from glsim.core.depth_map import JUMP_MM
from glsim.measures.quadrics import local_planes
from glsim.networks.composites import DOUBT, UNLIKELY, beside_holes

#: Planes are fitted at half size, in windows of this side, px there, of which this share has depth
#: and is not beside holes. Measured: with half the side walls beside holes are a third worse.
_WINDOW_PX, _LEAST_SHARE = 21, 0.06
#: Pixels nearer than the farthest around by more are of another surface, mm: head and wall. Chosen.
_STEP_MM: Final = 200.0
#: Largest standard deviation of 1 / depth from a plane of a flat surface, 1e-6 / mm: 0.35 mm at 0.9
#: m. In 1 / depth a curve counts alike at all distances. Measured on 53 sets, beside holes: 1 % of
#: windows of heads are below 0.57 (D455) to 3.5; 90 % of those of walls below 0.18, without stereo.
_FLAT: Final = 0.43
#: The mean of 5x5 measured depths must be as near to the plane as this multiple of the noise of the
#: wall, else it is form: relief away from holes, ghosts and objects beside them.
_MEAN_PX, _AGREES, _AGREES_BESIDE = (5, 5), 0.5, 1.0
#: Beside holes the plane also holds what is behind it, since nothing lies behind a wall, and in
#: front of it what of a measured ghost the network left, at most this share. Measured: with 0.5
#: real plates of 3 to 16 px on a wall get 4 % worse instead of 2.
_GHOST_SHARE: Final = 0.3


def held_to_planes(
    depth_mm: Depth, probability: Probability, noisy_mm: Depth
) -> tuple[Depth, Probability]:
    """Replace depth on flat surfaces by their planes, (H, W) mm, 0 = none.

    Beside holes, pixels farther than the plane by over JUMP_MM get the probability UNLIKELY.
    """
    measured = noisy_mm > 0
    beside = measured & beside_holes(noisy_mm)
    base = measured & ~beside & (depth_mm > 0)
    around = np.ones((4 * _WINDOW_PX - 3,) * 2, np.uint8)
    base &= depth_mm > cv2.dilate(np.where(base, depth_mm, 0), around) - _STEP_MM
    plane_mm, flat, noise_mm = _planes(depth_mm, noisy_mm, base)
    flat &= measured
    off_mm, change_mm = noisy_mm - plane_mm, depth_mm - plane_mm
    near = (flat & (np.abs(off_mm) < JUMP_MM)).astype(np.float32)
    share, mean_mm = cv2.blur(near, _MEAN_PX), np.abs(cv2.blur(near * off_mm, _MEAN_PX))
    mean_mm /= np.maximum(share, 0.01)
    held = mean_mm < np.where(beside, _AGREES_BESIDE, _AGREES) * noise_mm
    held |= beside & (change_mm > -_GHOST_SHARE * mean_mm)
    held &= flat & (np.abs(change_mm) < JUMP_MM)
    seen_mm = np.where(probability > DOUBT, depth_mm, noisy_mm)
    behind = beside & flat & (seen_mm - plane_mm > JUMP_MM)
    held_mm: Depth = np.where(held, plane_mm, depth_mm)
    return held_mm, np.where(behind, np.float32(UNLIKELY), probability)


def _planes(depth_mm: Depth, noisy_mm: Depth, base: Mask) -> tuple[Depth, Mask, Depth]:
    """Fit planes in 1 / depth around each pixel: depth, mm, whether it is flat, noise, mm."""
    height, width = base.shape
    half = (-(-width // 2), -(-height // 2))

    def small(image: Any) -> Array:
        return np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), np.float64)

    def large(image: Any) -> Depth:
        return np.asarray(cv2.resize(image.astype(np.float32), (width, height)), np.float32)

    known = small(base * 1.0) > 0.99
    if not known.any():
        return depth_mm, np.zeros_like(base), depth_mm
    inverse = small(1e6 / np.where(base, depth_mm, 1.0).astype(np.float64))
    plane, deviation, share = local_planes(inverse, known, np.ones(_WINDOW_PX))
    flat = (share > _LEAST_SHARE) & (deviation < _FLAT)
    change = np.where(base, noisy_mm - depth_mm, 0).astype(np.float64)
    size, border = (_WINDOW_PX, _WINDOW_PX), cv2.BORDER_CONSTANT
    mean, square = (
        cv2.blur(known * small(image), size, borderType=border) / share
        for image in (change, change * change)
    )
    noise_mm = large(np.sqrt(np.maximum(square - mean * mean, 0)))
    plane_mm = np.asarray(1e6 / np.maximum(large(plane), 1), np.float32)
    return plane_mm, large(flat) > 0.99, noise_mm
