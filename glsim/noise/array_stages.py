"""Shipped stages that run on arrays after the shaders, since no fragment shader can do them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.stage import array_stage
from glsim.noise.stereo_matching import is_other_surface
from glsim.noise.twins.layers import random_bits

__all__ = ["despeckle", "fill_from_points"]


@array_stage(
    lambda p: int(p["min_area_px"]) - 1,  # largest width or height of an island that goes, px
    min_area_px=("int", 20, 1, 100000, "px", "smallest connected island that is kept"),
    max_step_mm=("float", 20, 0.1, 5000, "mm", "depth difference that still connects neighbours"),
)
def despeckle(
    view: FrameContext, layers: Layers, p: Mapping[str, float]
) -> dict[str, NDArray[np.float32]]:
    """Removes small islands of depth, as structured-light drivers do."""
    import cv2

    # filterSpeckles takes signed 16-bit numbers: steps of 1/4 of max_step_mm separate 20 mm from
    # 25 mm and reach 8191 times max_step_mm.
    unit_m = p["max_step_mm"] / 4000.0
    steps = np.rint(np.clip(layers["depth"] / unit_m, 0, 32767)).astype(np.int16)
    kept = steps.copy()
    cv2.filterSpeckles(kept, 0, int(p["min_area_px"]) - 1, 4)
    removed = (kept == 0) & (steps > 0)
    depth, reason = layers["depth"].copy(), layers["reason"].copy()
    depth[removed] = 0.0
    reason[removed] = float(Reason.DROPPED)
    return {"depth": depth, "reason": reason}


Image = NDArray[np.float64]

#: Standard deviations after which the weight of a point ends. Derived: the square of its last
#: digit's weight in float32; a surface ten times nearer still wins there.
_REACH_SIGMAS = 6.0
#: Weight of the points of a scale against those of the next finer one: only where these are missing
#: does it count. Chosen: smaller than any weight within the finer scale's reach.
_COARSER = 1e-12
#: Nearest distance, which weighs 1: weights stay finite, m.
_NEAREST_M = 0.05
#: Steps of the inverse depth: sums over windows are exact wherever the window lies. A step is
#: 0.01 mm at 3 m.
_STEPS = 2.0**24


def _reach_px(p: Mapping[str, float]) -> int:
    """Return the largest distance, pixels, from which a pixel can take its depth."""
    coarsest = 2 ** int(p["doublings"])
    return int(np.ceil(_REACH_SIGMAS * p["sigma_px"] + 2) * coarsest + p["spacing_px"])


@array_stage(
    _reach_px,
    (),
    spacing_px=("int", 8, 2, 64, "px", "side of the cells that hold one point each"),
    sigma_px=("float", 3.8, 1, 32, "px", "Gaussian weight of a point over distance, sigma"),
    nearer_power=(
        "float", 8.0, 0, 16, "1", "points weigh with this power of 1/z: near surfaces grow over "
        "far ones, by sigma_px times the root of twice this times the logarithm of their ratio",
    ),
    mean_px=("int", 7, 1, 31, "px", "side of the window whose mean is a point's depth", "step 2"),
    doublings=(
        "int", 2, 0, 6, "1", "where there is no point, the distance is doubled up to so many times",
    ),
    unit_mm=("float", 0.1, 0, 100, "mm", "step of the depth that is delivered; 0: none"),
)  # fmt: skip
def fill_from_points(
    view: FrameContext, layers: Layers, p: Mapping[str, float]
) -> dict[str, NDArray[np.float32]]:
    """Rebuilds depth from sparse points: fills holes, smooths, and enlarges near surfaces.

    Apple's TrueDepth delivers such depth unless an app switches its filtering off. How it is made
    is not published. Seen in delivered frames of heads: no holes; silhouettes that grow round lobes
    of 10 to 20 px; a ramp where the unfiltered depth has a step; far surfaces like a field of
    blobs. All four come about if only sparse points are known and each pixel is a mean of those
    around it, in which nearer ones weigh more. A model of the result, not of Apple's code.
    """
    depth_m = layers["depth"]
    nearness = np.rint(
        np.where(depth_m > 0, _STEPS * _NEAREST_M / np.maximum(depth_m, _NEAREST_M), 0)
    )
    known, value = _points(nearness, view, int(p["spacing_px"]), int(p["mean_px"]) | 1)
    weight = np.where(known, value ** p["nearer_power"], 0.0)
    total, weights = _spread(
        weight * value, weight, view.window, p["sigma_px"], int(p["doublings"])
    )
    found = total > 0  # far from all points both sums may vanish, one before the other
    filled_m = np.where(found, _NEAREST_M * weights / np.where(found, total, 1.0), 0.0)
    if p["unit_mm"] > 0:
        unit_m = 0.001 * p["unit_mm"]
        filled_m = np.where(found, np.maximum(np.rint(filled_m / unit_m), 1.0) * unit_m, 0.0)
    made = filled_m.astype(np.float32)
    clean, reason = layers["clean"], layers["reason"].copy()
    reason[made > 0] = float(Reason.VALID)
    reason[is_other_surface(view, clean, made)] = float(Reason.MOVED)
    reason[(made > 0) & (clean <= 0)] = float(Reason.GROWN)
    return {"depth": made, "reason": reason}


def _points(
    nearness: Image, view: FrameContext, spacing_px: int, mean_px: int
) -> tuple[NDArray[np.bool_], Image]:
    """Place one point per cell, fixed by the device; return where points are and their 1/z.

    A point's value is the mean over the window around it, of the pixels that have a depth.
    """
    import cv2

    window = view.window
    left, top = window.left // spacing_px, window.top // spacing_px
    right, bottom = (
        -(-(window.left + window.width) // spacing_px),
        -(-(window.top + window.height) // spacing_px),
    )
    y, x = np.mgrid[top:bottom, left:right]
    across, down, _, _ = random_bits(x, y, view.device_seed, 0)
    column = x * spacing_px + across % np.uint32(spacing_px) - window.left
    row = y * spacing_px + down % np.uint32(spacing_px) - window.top
    inside = (column >= 0) & (row >= 0) & (column < window.width) & (row < window.height)
    at = row[inside].astype(np.int64), column[inside].astype(np.int64)
    size = (mean_px, mean_px)
    seen = (nearness > 0).astype(np.float64)
    sums, count = (
        cv2.boxFilter(v, cv2.CV_64F, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for v in (nearness, seen)
    )
    known = np.zeros(nearness.shape, np.bool_)
    known[at] = count[at] > 0.5
    value: Image = np.zeros_like(nearness)
    value[known] = sums[known] / (_STEPS * count[known])
    return known, value


def _spread(
    total: Image, weights: Image, window: Rect, sigma_px: float, doublings: int
) -> tuple[Image, Image]:
    """Sum over the points around each pixel; coarse scales count only where finer ones have none.

    A coarser scale has pixels of twice the size, so that the same kernel reaches twice as far. They
    lie on one grid of the frame for all windows.
    """
    import cv2

    before = window.top % 2**doublings, window.left % 2**doublings
    reach = int(np.ceil(_REACH_SIGMAS * sigma_px))
    side = np.arange(-reach, reach + 1, dtype=np.float64)
    kernel = np.exp(-0.5 * (side / sigma_px) ** 2)
    layers = [np.pad(layer, [(n, 0) for n in before]) for layer in (total, weights)]
    height, width = layers[0].shape
    summed, share = [np.zeros_like(layer) for layer in layers], 1.0
    for scale in range(doublings + 1):
        for whole, layer in zip(summed, layers, strict=True):
            near = cv2.sepFilter2D(layer, -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
            size_px = (near.shape[1] << scale, near.shape[0] << scale)
            fine = cv2.resize(near, size_px, interpolation=cv2.INTER_LINEAR) if scale else near
            whole += share * fine[:height, :width]
        layers, share = [_halved(layer) for layer in layers], share * _COARSER
    sums, of_weights = (whole[before[0] :, before[1] :] for whole in summed)
    return sums, of_weights


def _halved(image: Image) -> Image:
    """Sum an image over squares of 2x2 pixels."""
    rows, columns = (-(-side // 2) for side in image.shape)
    even = np.zeros((2 * rows, 2 * columns))
    even[: image.shape[0], : image.shape[1]] = image
    halved: Image = even.reshape(rows, 2, columns, 2).sum(axis=(1, 3))
    return halved
