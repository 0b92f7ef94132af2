"""Shaded triangles in Matplotlib's 3D axes, millimetres: x right, z away from the camera, y up."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.eval.report.figures.style import matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Direction to the light in figure axes: from the upper left, behind the camera.
_LIGHT: Final = np.array([-0.4, -0.75, 0.55]) / np.linalg.norm([-0.4, -0.75, 0.55])
#: Brightness of a face that the light does not reach.
_AMBIENT: Final = 0.35
_TEXT_SIZE: Final = 7
#: Distances of ticks, mm; the first that needs at most so many.
_TICK_STEPS_MM: Final = (50, 100, 200, 500)
_MOST_TICKS: Final = 4

Points = NDArray[np.floating[Any]]


def to_figure_axes(points_mm: Points) -> NDArray[np.float64]:
    """Turn (..., 3) camera axes (x right, y down, z forward) into those of the figure."""
    points = np.asarray(points_mm, np.float64)
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def axes_3d(
    figure: Figure, place: int, columns: int, elevation_deg: float, azimuth_deg: float
) -> Any:
    """Add 3D axes in millimetres to a figure with one row of ``columns``."""
    axis = figure.add_subplot(1, columns, place, projection="3d", computed_zorder=False)
    axis.view_init(elev=elevation_deg, azim=azimuth_deg)
    axis.set_proj_type("persp", focal_length=2.0)
    for name in ("x", "y", "z"):
        axis.tick_params(axis=name, labelsize=_TEXT_SIZE - 1, pad=-2)
        getattr(axis, f"{name}axis").pane.set_alpha(0.25)
        getattr(axis, f"{name}axis")._axinfo["grid"]["linewidth"] = 0.3
    axis.set_xlabel("x [mm]", fontsize=_TEXT_SIZE, labelpad=-4)
    axis.set_ylabel("distance [mm]", fontsize=_TEXT_SIZE, labelpad=-2)
    axis.set_zlabel("up [mm]", fontsize=_TEXT_SIZE, labelpad=-4)
    return axis


def set_limits(axis: Any, low: Points, high: Points, zoom: float = 1.0) -> None:
    """Show the box from ``low`` to ``high``, figure axes, with equal scales."""
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axis, f"set_{name}lim")(a, b)
        step = next(
            s for s in _TICK_STEPS_MM if b - a <= _MOST_TICKS * s or s == _TICK_STEPS_MM[-1]
        )
        getattr(axis, f"set_{name}ticks")(np.arange(np.ceil(a / step), b / step + 1e-9) * step)
    axis.set_box_aspect(np.asarray(high) - np.asarray(low), zoom=zoom)


def add_triangles(
    axis: Any, corners_mm: Points, colours: Points, normals: Points | None = None, zorder: int = 1
) -> None:
    """Draw triangles as a matte surface.

    corners_mm: (N, 3, 3) in the axes of the figure. colours: (N, 3) or (3,) RGB, 0 to 1.
    normals: (N, 3) unit normals; default: those of the triangles, turned to the light.
    """
    if normals is None:
        sides = corners_mm[:, 1] - corners_mm[:, 0], corners_mm[:, 2] - corners_mm[:, 0]
        normals = np.cross(*sides)
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = _AMBIENT + (1 - _AMBIENT) * np.clip(normals @ _LIGHT, 0, 1)
    faces = np.clip(np.broadcast_to(colours, normals.shape) * light[:, None], 0, 1)
    axis.add_collection3d(_collection(corners_mm, faces, zorder))


def _collection(corners_mm: Points, faces: Points, zorder: int) -> Any:
    matplotlib("figure")  # raises the error that names the extra
    collection = importlib.import_module("mpl_toolkits.mplot3d.art3d").Poly3DCollection
    # Edges in the colour of the face close the seams between triangles.
    return collection(corners_mm, facecolors=faces, edgecolors=faces, linewidths=0.2, zorder=zorder)
