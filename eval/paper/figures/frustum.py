"""Figure 1: the viewing frustum with head, camera, projector and shadow, in 3D."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.dataset import Dataset
from glsim.errors import GlsimError
from glsim.eval.paper.figures.frames import FigureFrame, settings_of
from glsim.eval.paper.figures.solids import (
    Points,
    add_triangles,
    axes_3d,
    set_limits,
    to_figure_axes,
)
from glsim.eval.report.figures.cut_surface import cut_surface
from glsim.eval.report.figures.style import add_note, matplotlib, new_figure
from glsim.faces.base import BadFace, FaceKey
from glsim.geometry.camera import Intrinsics
from glsim.geometry.depth_map import lit_by_marching
from glsim.geometry.mesh import Mesh
from glsim.pipeline import open_sources

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEXT_SIZE: Final = 7
#: Colours: parts of the head that the camera does not see; seen and lit; seen in the shadow.
_UNSEEN, _LIT, _SHADOW = "#b4bcc6", "#e9b98a", "#7b1e3a"
_CAMERA, _PROJECTOR, _FRUSTUM, _WINDOW = "#1a1a1a", "#c0392b", "#5f6f7f", "#0072b2"
#: A point of the head is the one that a pixel measured if their depths differ by less, mm:
#: 2.5 mm of pixel at 0.9 m on a surface at 75 degrees.
_SAME_POINT_MM: Final = 9.0
#: Rays of light that are drawn to the shadow, and points of each, 1 to 2 mm apart near the head.
_RAYS, _RAY_STEPS = 9, 200


def frustum_figure(dataset: Dataset, frame: FigureFrame, note: str) -> Figure:
    """Draw the whole frustum, and beside it the head with the shadow; return the figure."""
    figure: Figure = new_figure(8.6, 4.6)
    head = _head(dataset, frame)
    corners = to_figure_axes(head.vertices_mm)[head.faces]
    colours = _face_colours(head, frame)
    valid = frame.clean > 0
    far = float(frame.clean[valid].max()) + 150.0
    places = to_figure_axes(head.vertices_mm)
    emitter = _emitter(frame)

    whole = axes_3d(figure, 1, 2, 22.0, -142.0)
    x, y, _ = _corners(frame.rig.intrinsics, far).T
    set_limits(
        whole, np.array([x.min(), -60.0, -y.max()]), np.array([x.max(), far, -y.min()]), zoom=1.0
    )
    _frustum(whole, frame.rig.intrinsics, far, _FRUSTUM, 0.9)
    add_triangles(whole, corners, colours, zorder=3)
    _frustum(whole, frame.window.intrinsics, far, _WINDOW, 0.7)
    _devices(whole, emitter)
    whole.set_title("viewing frustum", fontsize=_TEXT_SIZE + 1, y=1.02)

    near = axes_3d(figure, 2, 2, 14.0, -138.0)
    low, high = places.min(axis=0), places.max(axis=0)
    bottom = to_figure_axes(frame.window.intrinsics.unproject(frame.clean))[valid][:, 2].min()
    low = np.array([low[0], low[1] - 90.0, bottom - 40.0])
    high = np.array([high[0], high[1], high[2]]) + 15.0
    set_limits(near, low, high, zoom=1.0)
    inside = ((corners >= low) & (corners <= high)).all(axis=(1, 2))
    add_triangles(near, corners[inside], colours[inside], zorder=3)
    _rays(near, frame, emitter, low)
    near.set_title("the head, and the projector's shadow on it", fontsize=_TEXT_SIZE + 1, y=1.02)
    figure.legend(
        handles=_legend(frame), loc="outside upper center", ncols=4, fontsize=_TEXT_SIZE - 1,
        frameon=False,
    )  # fmt: skip
    add_note(figure, note)
    return figure


def _head(dataset: Dataset, frame: FigureFrame) -> Mesh:
    """Return the head in camera axes, mm: the whole mesh, or what was measured if it is not there.

    A data set may be drawn where its face files are not; of hair and glasses there is nothing.
    """
    settings, record = settings_of(dataset), frame.pair.record
    try:
        if "head_to_camera" in record:
            place = 0
            name = frame.pair.key.subject
            if len(settings.source) > 1:  # subjects of several sources begin with their number
                number, _, name = name.partition("-")
                place = int(number)
            key = FaceKey(name, frame.pair.key.sequence, frame.pair.key.frame, path=record["path"])
            face = next(iter(open_sources(settings)[place].load([key])))
            if not isinstance(face, BadFace):
                view = np.array(record["head_to_camera"], np.float64)
                turned = face.mesh.vertices_mm @ view[:3, :3].T + 1000.0 * view[:3, 3]
                return Mesh(turned.astype(np.float32), face.mesh.faces)
    except (GlsimError, OSError, ValueError):
        pass
    seen = cut_surface(frame.clean, frame.window)
    if seen is None:
        raise GlsimError(f"{dataset.path}: {frame.pair!r} has no surface to draw")
    turn = np.array([1, -1, -1], np.float32)
    return Mesh(seen.vertices_mm * turn, seen.faces)


def _face_colours(head: Mesh, frame: FigureFrame) -> NDArray[np.float64]:
    """Colour the head's N triangles by what the camera sees: unseen, lit, in shadow; (N, 3) RGB."""
    rgb = matplotlib("colors").to_rgb
    camera = frame.window.intrinsics
    lit = lit_by_marching(frame.clean / np.float32(1000), frame.window)
    middles = head.vertices_mm[head.faces].mean(axis=1).astype(np.float64)
    column, row = np.floor(camera.project(middles)).astype(np.int64).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    column, row = column.clip(0, camera.width - 1), row.clip(0, camera.height - 1)
    measured = frame.clean[row, column]
    seen = inside & (measured > 0) & (np.abs(measured - middles[:, 2]) < _SAME_POINT_MM)
    colours = np.tile(np.array(rgb(_UNSEEN)), (len(middles), 1))
    colours[seen & (lit[row, column] > 0)] = rgb(_LIT)
    colours[seen & (lit[row, column] == 0)] = rgb(_SHADOW)
    return colours


def _corners(camera: Intrinsics, distance_mm: float) -> Points:
    """Return the (4, 3) corners of the image at a distance, camera axes, mm."""
    x = (np.array([0, camera.width, camera.width, 0]) - camera.cx) / camera.fx
    y = (np.array([0, 0, camera.height, camera.height]) - camera.cy) / camera.fy
    return np.stack([x, y, np.ones(4)], axis=1) * distance_mm


def _frustum(axis: Any, camera: Intrinsics, far_mm: float, colour: str, width: float) -> None:
    """Draw the pyramid from the camera to the image's corners, and the image at its end."""
    ends = to_figure_axes(_corners(camera, far_mm))
    for end in ends:
        axis.plot(*np.stack([np.zeros(3), end]).T, color=colour, linewidth=width, zorder=2)
    axis.plot(*np.concatenate([ends, ends[:1]]).T, color=colour, linewidth=width, zorder=2)
    face = importlib.import_module("mpl_toolkits.mplot3d.art3d").Poly3DCollection
    axis.add_collection3d(face([ends], facecolors=colour, alpha=0.07, zorder=1))


def _emitter(frame: FigureFrame) -> NDArray[np.float64] | None:
    """Return the projector's place, figure axes, mm; None for a sensor without one."""
    if not frame.rig.emitters:
        return None
    return to_figure_axes(1000.0 * np.array(frame.rig.emitters[0].position_m))


def _devices(axis: Any, emitter: Points | None) -> None:
    for place, colour, marker in ((np.zeros(3), _CAMERA, "s"), (emitter, _PROJECTOR, "D")):
        if place is not None:
            axis.plot(
                *place[:, None], marker=marker, color=colour, markersize=5, linestyle="", zorder=5
            )


def _rays(axis: Any, frame: FigureFrame, emitter: Points | None, low: Points) -> None:
    """Draw rays from the projector to points in its shadow, dotted behind what blocks them."""
    if emitter is None:
        return
    lit = lit_by_marching(frame.clean / np.float32(1000), frame.window)
    rows, columns = np.nonzero((frame.clean > 0) & (lit == 0))
    if not len(rows):
        return
    points = to_figure_axes(frame.window.intrinsics.unproject(frame.clean))[rows, columns]
    order = np.argsort(points[:, 2])
    for point in points[order[np.linspace(0, len(order) - 1, _RAYS).astype(int)]]:
        share = (low[1] - emitter[1]) / (point[1] - emitter[1])  # where the ray enters the box
        ray = emitter + np.linspace(share, 1.0, _RAY_STEPS)[:, None] * (point - emitter)
        stop = _first_hidden(ray, frame)
        axis.plot(*ray[: stop + 1].T, color=_PROJECTOR, linewidth=0.7, zorder=4)
        axis.plot(*ray[stop:].T, color=_PROJECTOR, linewidth=0.5, linestyle=":", zorder=4)


def _first_hidden(ray: Points, frame: FigureFrame) -> int:
    """Return the number of the first point behind the measured surface. ray: figure axes, mm."""
    camera = frame.window.intrinsics
    points = ray[:, [0, 2, 1]] * (1.0, -1.0, 1.0)  # back to camera axes
    column, row = np.floor(camera.project(points)).astype(np.int64).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    seen = frame.clean[row.clip(0, camera.height - 1), column.clip(0, camera.width - 1)]
    hidden = inside & (seen > 0) & (seen < points[:, 2])
    return int(np.argmax(hidden)) if hidden.any() else len(ray) - 1


def _legend(frame: FigureFrame) -> list[Any]:
    patch, line = matplotlib("patches").Patch, matplotlib("lines").Line2D
    image, window = frame.rig.intrinsics, frame.window.intrinsics
    handles = [
        line(
            [], [], color=_FRUSTUM, linewidth=1, label=f"frustum, {image.width}x{image.height} px"
        ),
        line([], [], color=_WINDOW, linewidth=1, label=f"crop, {window.width}x{window.height} px"),
        line([], [], color=_CAMERA, marker="s", markersize=4, linestyle="", label="camera"),
    ]
    if frame.rig.emitters:
        baseline = f"projector, {1000 * frame.rig.baseline_m:.0f} mm beside; its rays"
        handles.append(line([], [], color=_PROJECTOR, marker="D", markersize=4, label=baseline))
    for colour, text in ((_LIT, "seen and lit"), (_SHADOW, "seen, in the projector's shadow"),
                         (_UNSEEN, "not seen, or outside the crop")):  # fmt: skip
        handles.append(patch(facecolor=colour, label=text))
    return handles
