"""Registration of a noisy frame to its rig's colour camera, as its driver aligns depth.

A depth pixel covers the pixels of the colour image that its four corners span at its depth, as in
librealsense, or the one of its centre. The nearest surface wins; uncovered pixels stay empty.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from glsim.core.array_types import Array, Floats, Whole
from glsim.core.camera import ColourCamera, Intrinsics
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import Layers

#: Most colour pixels that one depth pixel covers along an axis. Chosen: far more than cameras need.
_MOST_PX: Final = 64


def register(
    noisy: Layers, window: Rect, image: Intrinsics, colour: ColourCamera, true: Layers, crop: Rect
) -> dict[str, Floats]:
    """Return the layers of a frame in the colour camera's view.

    Args:
        noisy: (h, w) layers of ``window``: depth and clean, metres along the depth camera's axis,
            reason, and optionally infrared.
        window: a part of the depth camera's image, whose intrinsics are ``image``.
        true: layers of ``crop`` in the colour camera's view: clean, maybe normal and region.
        crop: the delivered part of the colour image.

    Returns:
        ``true`` with depth (metres along the colour camera's axis), reason and infrared. A surface
        that the depth camera does not see has the reason SHADOW.
    """
    measured = noisy["depth"]
    found, depth = _land(measured, window, image, colour, crop)
    lost, _ = _land(np.where(measured > 0, 0, noisy["clean"]), window, image, colour, crop)
    source = np.where(found >= 0, found, lost)
    unseen = np.where(true["clean"] > 0, np.float32(Reason.SHADOW), np.float32(Reason.NO_SURFACE))
    layers = {**true, "depth": depth, "reason": _taken(noisy["reason"], source, unseen)}
    if "infrared" in noisy:
        layers["infrared"] = _taken(noisy["infrared"], source, np.zeros_like(depth))
    return layers


def _taken(layer: Floats, source: Whole, other: Floats) -> Floats:
    """Return the layer's values at flat indices ``source``, and ``other`` where an index is -1."""
    return np.where(source >= 0, layer.ravel()[source], other)


def _land(
    depth_m: Floats, window: Rect, image: Intrinsics, colour: ColourCamera, crop: Rect
) -> tuple[Whole, Floats]:
    """Find the nearest depth pixel for each pixel of ``crop``: its flat index, or -1, and depth.

    The depth is along the colour camera's axis, metres; 0 = none.
    """
    source = np.flatnonzero(depth_m)
    row, column = np.divmod(source, depth_m.shape[1])
    z = depth_m.ravel()[source].astype(np.float64)
    matrix, seen = colour.from_depth(), colour.intrinsics
    ends = []
    for side in (0.0, 1.0) if colour.covers == "corners" else (0.5, 0.5):
        x = (column + (window.left + side - image.cx)) * (z / image.fx)
        y = (row + (window.top + side - image.cy)) * (z / image.fy)
        px, py, pz = (a * x + b * y + c * z + d for a, b, c, d in matrix[:3])
        np.maximum(pz, 1e-6, out=pz)  # behind the colour camera: moved far outside its image
        u, v = px * (seen.fx / pz) + seen.cx, py * (seen.fy / pz) + seen.cy
        ends.append((u - crop.left, v - crop.top, pz))
    (u0, v0, near), (u1, v1, far) = ends
    left, right = _span(u0, u1, crop.width)
    top, bottom = _span(v0, v1, crop.height)
    area = (right - left) * (bottom - top)
    along = (0.5 * (near + far)).astype(np.float32)
    kept = np.flatnonzero(area)
    kept = kept[np.argsort(-along[kept], kind="stable")]  # NumPy keeps the last of several values
    each = np.repeat(kept, area[kept])
    starts = np.cumsum(area[kept]) - area[kept]
    down, across = np.divmod(
        np.arange(len(each)) - np.repeat(starts, area[kept]), (right - left)[each]
    )
    pixel = (top[each] + down) * crop.width + left[each] + across
    index = np.full(crop.width * crop.height, -1, np.int64)
    depth = np.zeros(index.shape, np.float32)
    index[pixel], depth[pixel] = source[each], along[each]
    return index.reshape(crop.height, crop.width), depth.reshape(crop.height, crop.width)


def _span(one: Array, other: Array, size: int) -> tuple[Whole, Whole]:
    """Return the first pixel that each span touches along an axis, and the pixel after its last."""
    first = np.floor(np.minimum(one, other)).clip(0, size).astype(np.int64)
    end = np.floor(np.maximum(one, other)).clip(-1, size - 1).astype(np.int64) + 1
    return first, np.clip(end, first, first + _MOST_PX)
