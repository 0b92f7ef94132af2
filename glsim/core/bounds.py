"""Bounds of a mesh: the image window that it can touch, and the frustum that an emitter lights."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from glsim.core.array_types import Array, Floats, Reals
from glsim.core.camera import SensorRig
from glsim.core.errors import MeshError
from glsim.core.products import product
from glsim.core.rect import Rect
from glsim.core.units import MM_PER_M

#: Margin on each side of a window, pixels, because stages can move and grow silhouettes. Shipped
#: shaders reach at most 8 px (lateral jitter is cut there); array stages declare their reach.
MARGIN_PX = 8

#: Windows start and end at multiples of this number of pixels. Few windows then change from frame
#: to frame (a changed window must be cleared), and layers at 1/3 of the size divide them evenly.
_ALIGN_PX = 12


class Frustum(NamedTuple):
    """A view frustum: bounds of the directions x/z and y/z, and of the depth z in metres."""

    left: float
    top: float
    right: float
    bottom: float
    near_m: float
    far_m: float

    def widened(self, by: float) -> Frustum:
        """Return the frustum whose directions x/z and y/z are widened by ``by`` on each side."""
        return self._replace(
            left=self.left - by, top=self.top - by, right=self.right + by, bottom=self.bottom + by
        )


@dataclass(frozen=True, eq=False)
class FieldOfView:
    """The range of x/z in each column, (W, 2), and of y/z in each row, (H, 2), of a rig's image."""

    rig: SensorRig
    columns: Array
    rows: Array

    @staticmethod
    def of(rig: SensorRig) -> FieldOfView:
        """Compute the field of view of a rig, with a margin of 0.5 px (1 px with a lens)."""
        rays, image = rig.rays().astype(np.float64), rig.intrinsics
        spread = np.array([-1.0, 1.0]) if rig.keeps_distortion else np.array([-0.5, 0.5])
        x, y = rays[..., 0], rays[..., 1]
        return FieldOfView(
            rig,
            np.stack([x.min(axis=0), x.max(axis=0)], axis=1) + spread / image.fx,
            np.stack([y.min(axis=1), y.max(axis=1)], axis=1) + spread / image.fy,
        )

    def window(self, box: Frustum) -> Rect:
        """Return the window of pixels whose rays enter ``box``; its size is 0 if no ray does."""
        spans = []
        for directions, low, high in (
            (self.columns, box.left, box.right),
            (self.rows, box.top, box.bottom),
        ):
            inside = np.flatnonzero((directions[:, 1] > low) & (directions[:, 0] < high))
            spans.append((int(inside[0]), len(inside)) if len(inside) else (0, 0))
        (left, width), (top, height) = spans
        return Rect(left, top, width, height)


def bounding_corners(vertices_mm: Floats, view: Floats) -> Array:
    """Compute the (8, 3) corners, camera frame, metres, of the bounding box of a mesh.

    ``vertices_mm`` is (V, 3), canonical frame. ``view`` is the (4, 4) matrix from canonical
    millimetres to camera-frame metres. Raises MeshError for NaN and infinity.
    """
    # Reduce each column alone: NumPy reduces (V, 3) along its long axis ten times slower.
    columns = np.ascontiguousarray(vertices_mm.T)
    low, high = columns.min(axis=1), columns.max(axis=1)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        bad = int((~np.isfinite(vertices_mm).all(axis=1)).sum())
        raise MeshError(f"{bad} vertices are NaN or infinite: repair the mesh")
    box = np.array(list(itertools.product(*zip(low, high, strict=True))), dtype=np.float64)
    return np.asarray(product(box, view[:3, :3].T.astype(np.float64)) + view[:3, 3])


def vertex_frustum(vertices_mm: Floats, view: Floats, near_m: float) -> Frustum | None:
    """Compute a mesh's frustum, arguments as above; None for a vertex nearer than ``near_m``."""
    return _frustum(product(view[:3, :3], vertices_mm.T) + view[:3, 3:], near_m)


def bounding_frustum(
    corners_m: Array, origin_m: tuple[float, float, float], near_m: float
) -> Frustum | None:
    """Compute the frustum of (N, 3) points seen from ``origin_m``; None if a point is too near."""
    return _frustum((corners_m - np.asarray(origin_m)).T, near_m)


def _frustum(points_m: Reals, near_m: float) -> Frustum | None:
    """Compute the frustum of (3, N) points; None if a point is nearer than ``near_m``."""
    x, y, z = points_m
    if z.min() <= near_m:
        return None
    x, y = x / z, y / z
    return Frustum(*(float(v) for v in (x.min(), y.min(), x.max(), y.max(), z.min(), z.max())))


def image_window(
    corners_m: Array,
    field_of_view: FieldOfView,
    visible: Rect | None,
    reach_px: int = 0,
    around: Frustum | None = None,
) -> Rect:
    """Compute the window of the image that a mesh can touch, with a margin.

    The whole image if the mesh crosses the near plane. Raises MeshError if none is in the image.

    Args:
        corners_m: (8, 3) corners of the mesh's bounding box, camera frame.
        visible: the crop of the image that is delivered, or None.
        reach_px: the distance around the crop at which stages read pixels, besides the margin.
        around: a frustum of the mesh that is smaller than its bounding box, or None.
    """
    image, near_m = field_of_view.rig.intrinsics, field_of_view.rig.near_m
    whole = Rect(0, 0, image.width, image.height)
    if visible is not None:
        whole = _grown(visible, whole, MARGIN_PX + reach_px)
    z = corners_m[:, 2]
    if z.max() <= near_m:
        raise MeshError(
            f"the mesh lies behind the camera or nearer than {near_m * MM_PER_M:.0f} mm "
            f"(z {z.min() * MM_PER_M:.0f} to {z.max() * MM_PER_M:.0f} mm): "
            "check units, axes and distance"
        )
    box = around or bounding_frustum(corners_m, (0.0, 0.0, 0.0), near_m)
    if box is None:
        return whole
    exact = field_of_view.window(box)
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


def emitter_frustum(
    corners_m: Array, field_of_view: FieldOfView, origin_m: tuple[float, float, float]
) -> Frustum:
    """Compute the frustum that an emitter must see to light everything in the image.

    It holds the directions to all points that the camera and the imagers see; the surfaces that
    shadow these points lie in the same directions. A crop does not narrow it, because the edges of
    shadows depend on the grid of the shadow map. The mesh can reach the camera, e.g. with the legs
    of a person who looks up. The emitter is then inside the mesh's box, and the frustum is the
    camera's view beyond the near plane. Raises MeshError for an emitter inside the scene.
    """
    reached_m = field_of_view.rig.near_m
    near_m = reached_m / 2  # an emitter may stand in front of the camera
    low_m, high_m = float(corners_m[:, 2].min()), float(corners_m[:, 2].max())
    whole = bounding_frustum(corners_m, origin_m, near_m)
    inside = whole is None and low_m <= reached_m and origin_m[2] <= reached_m
    if whole is None and not inside:
        raise MeshError(
            f"the mesh reaches behind the emitter at {origin_m} m or nearer than "
            f"{near_m * MM_PER_M:.0f} mm: check units, axes and distance"
        )
    ends = (reached_m, max(high_m, 2 * reached_m)) if inside else (low_m, high_m)
    x, y = ((seen.min(), seen.max()) for seen in (field_of_view.columns, field_of_view.rows))
    eyes = [(0.0, 0.0, 0.0), *field_of_view.rig.imagers_m]
    points = [
        (e[0] + a * d, e[1] + b * d, d)
        for e, d, a, b in itertools.product(eyes, np.clip(ends, near_m, None), x, y)
    ]
    lit = bounding_frustum(np.array(points), origin_m, 0.0)
    if whole is None or lit is None:
        box = lit or whole
        assert box is not None  # an emitter behind the near plane sees all points
        return box
    return Frustum(
        max(lit.left, whole.left), max(lit.top, whole.top),
        min(lit.right, whole.right), min(lit.bottom, whole.bottom),
        whole.near_m, whole.far_m,
    )  # fmt: skip


def union(windows: list[Rect]) -> Rect:
    """Return the smallest window that contains all ``windows``."""
    left, top = min(w.left for w in windows), min(w.top for w in windows)
    right = max(w.left + w.width for w in windows)
    bottom = max(w.top + w.height for w in windows)
    return Rect(left, top, right - left, bottom - top)


def widened(window: Rect, field_of_view: FieldOfView, by_px: tuple[int, int, int, int]) -> Rect:
    """Widen a window inside the image by pixels at its left, top, right and bottom."""
    if not any(by_px):
        return window
    image = field_of_view.rig.intrinsics
    left, top, right, bottom = by_px
    moved = Rect(
        window.left - left, window.top - top,
        window.width + left + right, window.height + top + bottom,
    )  # fmt: skip
    return _grown(moved, Rect(0, 0, image.width, image.height), 0)


def _grown(rect: Rect, limit: Rect, by_px: int) -> Rect:
    """Widen ``rect`` by ``by_px`` on each side, align it to _ALIGN_PX, and clip it to ``limit``."""
    left = math.floor((rect.left - by_px) / _ALIGN_PX) * _ALIGN_PX
    top = math.floor((rect.top - by_px) / _ALIGN_PX) * _ALIGN_PX
    right = math.ceil((rect.left + rect.width + by_px) / _ALIGN_PX) * _ALIGN_PX
    bottom = math.ceil((rect.top + rect.height + by_px) / _ALIGN_PX) * _ALIGN_PX
    return Rect(left, top, right - left, bottom - top).intersection(limit)
