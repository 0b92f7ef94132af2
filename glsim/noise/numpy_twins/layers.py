"""NumPy twins of shaders/lib: layers, depth, disparity, random, kernel and correlated_noise.glsl.

Random numbers are functions of (pixel, seed, draw), bit for bit those of the shaders.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext, Layers

Image = NDArray[np.float32]
Words = NDArray[np.uint32]
#: Parameter values by their GLSL names.
Parameters = Mapping[str, np.float32]

#: The smallest depth that a pixel with depth can be moved to, m.
_LEAST_M = np.float32(1e-4)

#: libfreenect2's 3x3 Gaussian: |dx| + |dy| of a neighbour -> weight.
KERNEL = {0: np.float32(0.1195716), 1: np.float32(0.1131098), 2: np.float32(0.1069973)}
KERNEL_UNIT = np.float32(2.99791)


def pixels(window: Rect) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return columns (1, w) and rows (h, 1) of a window's pixels, counted in the whole frame."""
    x = np.arange(window.left, window.left + window.width)
    y = np.arange(window.top, window.top + window.height)
    return x[None, :], y[:, None]


def fetch(layer: Image, window: Rect, x: NDArray[np.int64], y: NDArray[np.int64]) -> Image:
    """Read a layer at integer pixels of the frame (x and y broadcast); 0 outside its window."""
    column, row = x - window.left, y - window.top
    inside = (column >= 0) & (column < window.width) & (row >= 0) & (row < window.height)
    nearest = np.clip(row, 0, window.height - 1), np.clip(column, 0, window.width - 1)
    return np.where(inside, layer[nearest], np.float32(0.0))


def beside(view: FrameContext, layer: Image, dx: int, dy: int, *, clamped: bool = False) -> Image:
    """Return each pixel's neighbour (dx, dy); 0 outside the window.

    Args:
        clamped: beyond the frame, take the frame's nearest pixel.
    """
    left, top, width, height = view.window
    x, y = np.arange(left + dx, left + dx + width), np.arange(top + dy, top + dy + height)
    if clamped:
        x, y = np.clip(x, 0, view.width - 1), np.clip(y, 0, view.height - 1)
    x, y = x - left, y - top
    part = layer[np.clip(y, 0, height - 1)][:, np.clip(x, 0, width - 1)]
    part[(y < 0) | (y >= height)] = 0.0
    part[:, (x < 0) | (x >= width)] = 0.0
    return part


def square(reach: int) -> Iterator[tuple[int, int]]:
    """Yield the offsets (dx, dy) of the pixels within ``reach``, in reading order."""
    side = range(-reach, reach + 1)
    return ((dx, dy) for dy in side for dx in side)


def mix(a: Image, b: Image, t: Image) -> Image:
    """Interpolate linearly from ``a`` at t = 0 to ``b`` at t = 1."""
    mixed: Image = a + t * (b - a)
    return mixed


def reasons_of_taken(layers: Layers, depth_m: Image, lost: Reason) -> Image:
    """Return the reason codes of pixels with new depth; code ``lost`` where the new depth is 0."""
    here, reason = layers["depth"], layers["reason"]
    new = np.where(layers["clean"] > 0, np.float32(Reason.MOVED), np.float32(Reason.GROWN))
    reason = np.where((depth_m <= 0) & (here > 0), np.float32(lost), reason)
    return np.where((depth_m > 0) & (here <= 0), new, reason)


def moved_by_mm(depth_m: Image, by_mm: Image) -> Image:
    """Add millimetres to depth (metres); 0, no depth, stays 0."""
    moved = np.maximum(depth_m + np.float32(0.001) * by_mm, _LEAST_M)
    return np.where(depth_m > 0, moved, np.float32(0.0))


def disparity_px(depth_m: Image, focal_baseline_px_m: float) -> Image:
    """Convert depth, m, to disparity, px, or disparity to depth; undefined where depth is 0."""
    known = np.where(depth_m > 0, depth_m, np.float32(1.0))
    return np.divide(np.float32(focal_baseline_px_m), known, dtype=np.float32)


def displaced(depth_m: Image, by_mm: Image, by_px: Image, focal_baseline_px_m: float) -> Image:
    """Add millimetres to depth (metres), and pixels to its disparity."""
    if by_px.any():
        shifted = disparity_px(depth_m, focal_baseline_px_m) + by_px
        moved = np.float32(focal_baseline_px_m) / np.maximum(shifted, np.float32(1e-3))
        depth_m = np.where((depth_m > 0) & (by_px != 0), moved, depth_m)
    return moved_by_mm(depth_m, by_mm)


def without(layers: Layers, lost: NDArray[np.bool_], reason: Reason | Image) -> dict[str, Image]:
    """Return depth and reason after the pixels ``lost`` lost their depth."""
    depth = layers["depth"]
    lost = lost & (depth > 0)
    return {
        "depth": np.where(lost, np.float32(0.0), depth),
        "reason": np.where(lost, np.asarray(reason, np.float32), layers["reason"]),
    }


def random_bits(
    x: ArrayLike, y: ArrayLike, seed: int, draw: ArrayLike
) -> tuple[Words, Words, Words, Words]:
    """Return four 32-bit random words per pixel, seed and draw; the arguments broadcast."""
    a, b, c, d = _scramble(_word(x), _word(y), _word(seed), _word(draw))
    sixteen = np.uint32(16)
    return _scramble(a ^ (a >> sixteen), b ^ (b >> sixteen), c ^ (c >> sixteen), d ^ (d >> sixteen))


def _word(numbers: ArrayLike) -> Words:
    """Map integers of any sign to 32-bit words by one step of a linear congruential generator."""
    # Always an array: NumPy warns when scalars overflow.
    word = np.atleast_1d(np.asarray(numbers, dtype=np.int64)).astype(np.uint32)
    stepped: Words = word * np.uint32(1664525) + np.uint32(1013904223)
    return stepped


def _scramble(a: Words, b: Words, c: Words, d: Words) -> tuple[Words, Words, Words, Words]:
    a = a + b * d
    b = b + c * a
    c = c + a * b
    return a, b, c, d + b * c


def pcg_word(word: Words) -> Words:
    """Return the next 32-bit word of the random generator PCG (RXS-M-XS 32)."""
    state = word * np.uint32(747796405) + np.uint32(2891336453)
    mixed: Words = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(
        277803737
    )
    return (mixed >> np.uint32(22)) ^ mixed


def uniform01(bits: Words) -> NDArray[np.float32]:
    """Convert 32-bit words to uniform numbers in the open interval (0, 1), with 23 bits."""
    return ((bits >> np.uint32(9)).astype(np.float32) + np.float32(0.5)) * np.float32(
        1.0 / 8388608.0
    )


def normal_pair(first: Words, second: Words) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Convert two random words to two independent standard normal numbers (Box-Muller)."""
    radius = np.sqrt(np.float32(-2.0) * np.log(uniform01(first)))
    angle = np.float32(6.28318530718) * uniform01(second)
    return radius * np.cos(angle), radius * np.sin(angle)


def correlated_noise(window: Rect, seed: int) -> NDArray[np.float32]:
    """Draw (h, w) noise of variance 1, smoothed by the 3x3 filter of the Kinect's decoder."""
    x, y = pixels(window)
    noise = np.zeros((window.height, window.width), np.float32)
    for dx, dy in square(1):
        row = pcg_word(np.uint32(seed) ^ pcg_word((y + dy).astype(np.uint32)))
        bits = pcg_word(row + (x + dx).astype(np.uint32))
        halves = (bits >> np.uint32(16)).astype(np.int64) + (bits & np.uint32(0xFFFF))
        noise += KERNEL[abs(dx) + abs(dy)] * (halves - 0xFFFF).astype(np.float32)
    return KERNEL_UNIT * np.float32(3.73772e-5) * noise
