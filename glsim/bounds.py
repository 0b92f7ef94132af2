"""Which part of an image, or of an emitter's field of view, a mesh can touch."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.camera import SensorRig
from glsim.errors import MeshError
from glsim.frame import Rect

#: Windows are widened by this many pixels, so that stages can move and grow silhouettes; the
#: shipped shaders reach 8 px at most (lateral jitter is cut there). Array stages declare theirs.
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

    def widened(self, by: float) -> Tangents:
        """The same box with ``by`` more on each side."""
        return self._replace(
            left=self.left - by, top=self.top - by, right=self.right + by, bottom=self.bottom + by
        )


@dataclass(frozen=True, eq=False)
class Sight:
    """Where a rig's pixels look, lens included.

    columns: (W, 2) least and largest x/z that a column sees; rows: (H, 2) the same of y/z.
    """

    rig: SensorRig
    columns: NDArray[np.float64]
    rows: NDArray[np.float64]

    @staticmethod
    def of(rig: SensorRig) -> Sight:
        """Half a pixel is added around the rays; a whole one where a lens stretches them."""
        rays, image = rig.rays().astype(np.float64), rig.intrinsics
        spread = np.array([-1.0, 1.0]) if rig.is_raw else np.array([-0.5, 0.5])
        x, y = rays[..., 0], rays[..., 1]
        return Sight(
            rig,
            np.stack([x.min(axis=0), x.max(axis=0)], axis=1) + spread / image.fx,
            np.stack([y.min(axis=1), y.max(axis=1)], axis=1) + spread / image.fy,
        )

    def window(self, box: Tangents) -> Rect:
        """The pixels that look into ``box``; of width or height 0 if none does."""
        spans = []
        for seen, low, high in (
            (self.columns, box.left, box.right),
            (self.rows, box.top, box.bottom),
        ):
            inside = np.flatnonzero((seen[:, 1] > low) & (seen[:, 0] < high))
            spans.append((int(inside[0]), len(inside)) if len(inside) else (0, 0))
        (left, width), (top, height) = spans
        return Rect(left, top, width, height)


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
    corners_m: NDArray[np.float64], sight: Sight, visible: Rect | None, reach_px: int = 0
) -> Rect:
    """The window of the image that a mesh can touch, with margin; the whole image if unsure.

    visible: the crop that is delivered, or None for all; reach_px: how far around it stages look
    besides the margin. Raises MeshError if nothing is in view.
    """
    image, near_m = sight.rig.intrinsics, sight.rig.near_m
    whole = Rect(0, 0, image.width, image.height)
    if visible is not None:
        whole = _grown(visible, whole, MARGIN_PX + reach_px)
    z = corners_m[:, 2]
    if z.max() <= near_m:
        raise MeshError(
            f"the mesh lies behind the camera or nearer than {near_m * 1000:.0f} mm "
            f"(z {z.min() * 1000:.0f} to {z.max() * 1000:.0f} mm): check units, axes and distance"
        )
    box = tangents(corners_m, (0.0, 0.0, 0.0), near_m)
    if box is None:
        return whole
    exact = sight.window(box)
    if 0 in exact.intersection(visible or whole)[2:]:
        left, top = box.left * image.fx + image.cx, box.top * image.fy + image.cy
        right, bottom = box.right * image.fx + image.cx, box.bottom * image.fy + image.cy
        seen = f"{image.width}x{image.height}"
        if visible is not None:
            seen = f"the crop of {visible.width}x{visible.height} at {visible.left}, {visible.top}"
        raise MeshError(
            f"the mesh is out of view: it would span columns {left:.0f} to {right:.0f} and rows "
            f"{top:.0f} to {bottom:.0f} of {seen}"
        )
    return _grown(exact, whole, MARGIN_PX)


def emitter_view(
    corners_m: NDArray[np.float64], sight: Sight, origin_m: tuple[float, float, float]
) -> Tangents:
    """What an emitter must see to light the image: directions, and the range of all depths.

    Whatever throws a shadow into the image lies, seen from the emitter, in the direction of a
    point that the camera sees there. It is not cut to a crop, or the shadows' edges, drawn on
    another grid, would not be those of the whole frame. Raises MeshError if the emitter is inside
    the scene.
    """
    near_m = sight.rig.near_m / 2  # an emitter may stand before the camera
    all_of_it = tangents(corners_m, origin_m, near_m)
    if all_of_it is None:
        raise MeshError(
            f"the mesh reaches behind the emitter at {origin_m} m or nearer than "
            f"{near_m * 1000:.0f} mm: check units, axes and distance"
        )
    z = np.clip([corners_m[:, 2].min(), corners_m[:, 2].max()], near_m, None)
    x, y = ((seen.min(), seen.max()) for seen in (sight.columns, sight.rows))
    seen = np.array([(a * d, b * d, d) for d in z for a, b in itertools.product(x, y)])
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


def _grown(rect: Rect, limit: Rect, by_px: int) -> Rect:
    """``rect`` with ``by_px`` more on each side, aligned, within ``limit``."""
    left = math.floor((rect.left - by_px) / _ALIGN_PX) * _ALIGN_PX
    top = math.floor((rect.top - by_px) / _ALIGN_PX) * _ALIGN_PX
    right = math.ceil((rect.left + rect.width + by_px) / _ALIGN_PX) * _ALIGN_PX
    bottom = math.ceil((rect.top + rect.height + by_px) / _ALIGN_PX) * _ALIGN_PX
    return Rect(left, top, right - left, bottom - top).intersection(limit)
