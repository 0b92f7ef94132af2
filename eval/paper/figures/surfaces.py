"""Figure 3: a depth map in 3D, left clean, right noisy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from glsim.denoise.interface import Depth
from glsim.eval.paper.figures.frames import FigureFrame
from glsim.eval.paper.figures.solids import (
    Points,
    add_triangles,
    axes_3d,
    set_limits,
    to_figure_axes,
)
from glsim.eval.report.figures.cut_surface import cut_surface
from glsim.eval.report.figures.style import add_note, new_figure
from glsim.geometry.depth_map import normals

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEXT_SIZE: Final = 8
#: Where the reader looks from: a little above the head, and from the side where no shadow falls.
_ELEVATION_DEG, _AZIMUTH_DEG = 12.0, -62.0
_SKIN: Final = np.array([0.86, 0.80, 0.74])
_MARGIN_MM: Final = 10.0
#: Turns the axes of ``surface`` (y up, z towards the camera) back into those of the camera.
_TO_CAMERA: Final = np.array([1.0, -1.0, -1.0])


def surfaces_figure(frame: FigureFrame, note: str) -> Figure:
    """Draw the surfaces of the clean and the noisy map of a frame; return the figure."""
    figure: Figure = new_figure(7.6, 4.3)
    seen = to_figure_axes(_points(frame.clean, frame))[frame.clean > 0]
    low, high = seen.min(axis=0) - _MARGIN_MM, seen.max(axis=0) + _MARGIN_MM
    for place, (title, depth) in enumerate({"clean": frame.clean, "noisy": frame.noisy}.items()):
        axis = axes_3d(figure, place + 1, 2, _ELEVATION_DEG, _AZIMUTH_DEG)
        set_limits(axis, low, high, zoom=0.95)
        axis.set_title(title, fontsize=_TEXT_SIZE, y=1.0, pad=-4)
        _draw_surface(axis, depth, frame, low, high)
    add_note(figure, note)
    return figure


def _points(depth_mm: Depth, frame: FigureFrame) -> Points:
    return frame.window.intrinsics.unproject(depth_mm)


def _draw_surface(
    axis: Any, depth_mm: Depth, frame: FigureFrame, low: Points, high: Points
) -> None:
    """Draw what lies between ``low`` and ``high``; pixels in mid-air beyond are left out."""
    mesh = cut_surface(depth_mm, frame.window)
    if mesh is None:
        return
    points = mesh.vertices_mm * _TO_CAMERA
    corners = to_figure_axes(points)[mesh.faces]
    inside = ((corners >= low) & (corners <= high)).all(axis=(1, 2))
    # Normals of the map are those of its pixels: triangles alone show each millimetre as a step.
    towards = to_figure_axes(normals(depth_mm / np.float32(1000), frame.window.rays()))
    pixel = np.floor(frame.window.intrinsics.project(points)).astype(np.int64)
    shape = np.array(depth_mm.shape)
    column, row = pixel[:, 0].clip(0, shape[1] - 1), pixel[:, 1].clip(0, shape[0] - 1)
    smooth = towards[row, column][mesh.faces].mean(axis=1)
    add_triangles(axis, corners[inside], _SKIN, smooth[inside])
