"""Which part of an image, or of an emitter's field of view, a mesh can touch."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.camera import Intrinsics
from glsim.errors import MeshError
from glsim.frame import Rect

#: Windows are widened by this many pixels, so that stages can move and grow silhouettes; the
#: shipped ones reach 8 px at most (lateral jitter is cut there).
MARGIN_PX = 8

#: Windows start and end at multiples of this, so that they seldom change from frame to frame
#: (a changed window costs clearing) and so that stages at 1/3 size divide them evenly.
_ALIGN_PX = 12


class Tangents(NamedTuple):
    """A box of directions x/z, y/z, and the range of z in metres that it holds."""

    left: float
    top: float
    right: float
    bottom: float
    near_m: float
    far_m: float


def corners(vertices_mm: NDArray[np.float32], view: NDArray[np.float32]) -> NDArray[np.float64]:
    """(8, 3) camera-frame metres: the corners of the mesh's bounding box. Raises MeshError."""
    # Column by column: NumPy reduces (V, 3) along its long axis ten times slower.
    columns = np.ascontiguousarray(vertices_mm.T)
    low, high = columns.min(axis=1), columns.max(axis=1)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        bad = int((~np.isfinite(vertices_mm).all(axis=1)).sum())
        raise MeshError(f"{bad} vertices are NaN or infinite: repair the mesh")
    box = np.array(list(itertools.product(*zip(low, high, strict=True))), dtype=np.float64)
    moved: NDArray[np.float64] = box @ view[:3, :3].T.astype(np.float64) + view[:3, 3]
    return moved


def tangents(
    corners_m: NDArray[np.float64], origin_m: tuple[float, float, float], near_m: float
) -> Tangents | None:
    """The directions in which points lie seen from ``origin_m``; None if not all lie in front."""
    seen = corners_m - np.asarray(origin_m)
    z = seen[:, 2]
    if z.min() <= near_m:
        return None
    x, y = seen[:, 0] / z, seen[:, 1] / z
    return Tangents(*(float(v) for v in (x.min(), y.min(), x.max(), y.max(), z.min(), z.max())))


def image_window(
    corners_m: NDArray[np.float64], image: Intrinsics, near_m: float, visible: Rect | None
) -> Rect:
    """The window of the image that a mesh can touch, with margin; the whole image if unsure.

    visible: the crop that is delivered, or None for all. Raises MeshError if nothing is in view.
    """
    whole = Rect(0, 0, image.width, image.height)
    if visible is not None:
        whole = _grown(visible, whole)
    z = corners_m[:, 2]
    if z.max() <= near_m:
        raise MeshError(
            f"the mesh lies behind the camera or nearer than {near_m * 1000:.0f} mm "
            f"(z {z.min() * 1000:.0f} to {z.max() * 1000:.0f} mm): check units, axes and distance"
        )
    box = tangents(corners_m, (0.0, 0.0, 0.0), near_m)
    if box is None:
        return whole
    left, top = box.left * image.fx + image.cx, box.top * image.fy + image.cy
    right, bottom = box.right * image.fx + image.cx, box.bottom * image.fy + image.cy
    if right <= 0 or bottom <= 0 or left >= image.width or top >= image.height:
        raise MeshError(
            f"the mesh is out of view: it would span columns {left:.0f} to {right:.0f} and rows "
            f"{top:.0f} to {bottom:.0f} of {image.width}x{image.height}"
        )
    exact = Rect(
        math.floor(left), math.floor(top),
        math.ceil(right) - math.floor(left), math.ceil(bottom) - math.floor(top),
    )  # fmt: skip
    return _grown(exact, whole)


def emitter_view(
    corners_m: NDArray[np.float64],
    window: Rect,
    image: Intrinsics,
    origin_m: tuple[float, float, float],
    near_m: float,
) -> Tangents:
    """What an emitter must see to light ``window``: directions, and the range of all depths.

    Whatever throws a shadow into the window lies, seen from the emitter, in the direction of a
    point that the camera sees there. Raises MeshError if the emitter is inside the scene.
    """
    all_of_it = tangents(corners_m, origin_m, near_m)
    if all_of_it is None:
        raise MeshError(
            f"the mesh reaches behind the emitter at {origin_m} m or nearer than "
            f"{near_m * 1000:.0f} mm: check units, axes and distance"
        )
    z = np.clip([corners_m[:, 2].min(), corners_m[:, 2].max()], near_m, None)
    columns = np.array([window.left, window.left + window.width])
    rows = np.array([window.top, window.top + window.height])
    x, y = (columns - image.cx) / image.fx, (rows - image.cy) / image.fy
    seen = np.array([(a * d, b * d, d) for d in z for a in x for b in y])
    lit = tangents(seen, origin_m, 0.0)
    if lit is None:
        return all_of_it
    return Tangents(
        max(lit.left, all_of_it.left), max(lit.top, all_of_it.top),
        min(lit.right, all_of_it.right), min(lit.bottom, all_of_it.bottom),
        all_of_it.near_m, all_of_it.far_m,
    )  # fmt: skip


def union(windows: list[Rect]) -> Rect:
    """The smallest window that covers all of them."""
    left, top = min(w.left for w in windows), min(w.top for w in windows)
    right = max(w.left + w.width for w in windows)
    bottom = max(w.top + w.height for w in windows)
    return Rect(left, top, right - left, bottom - top)


def _grown(rect: Rect, limit: Rect) -> Rect:
    """``rect`` with margin, aligned, within ``limit``."""
    left = math.floor((rect.left - MARGIN_PX) / _ALIGN_PX) * _ALIGN_PX
    top = math.floor((rect.top - MARGIN_PX) / _ALIGN_PX) * _ALIGN_PX
    right = math.ceil((rect.left + rect.width + MARGIN_PX) / _ALIGN_PX) * _ALIGN_PX
    bottom = math.ceil((rect.top + rect.height + MARGIN_PX) / _ALIGN_PX) * _ALIGN_PX
    return Rect(left, top, right - left, bottom - top).intersection(limit)
