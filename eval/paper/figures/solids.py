"""Figures 1 and 3 of the paper: surfaces in Matplotlib's 3D axes, mm (x right, y away, z up)."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.depth_frame import DepthFrame
from glsim.core.depth_map import lit_by_marching, normals, surface
from glsim.core.errors import DatasetError
from glsim.core.units import MM_PER_M, to_metres
from glsim.data.reader import Dataset
from glsim.denoise.frames import moved_frames
from glsim.eval.report.figures.side_view import STEEPEST_DEG
from glsim.eval.report.figures.style import add_note, matplotlib, new_figure
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings

Points = NDArray[np.floating[Any]]
_TEXT_SIZE: Final = 7
#: Direction to the light in figure axes: from the upper left, behind the camera.
_LIGHT: Final = np.array([-0.4, -0.75, 0.55]) / np.linalg.norm([-0.4, -0.75, 0.55])
#: Brightness of a triangle that the light does not reach.
_AMBIENT: Final = 0.35
#: Colours of a surface: lit by the projector, in the projector's shadow, and skin.
_LIT, _SHADOW, _SKIN = "#e9b98a", "#7b1e3a", "#dbccbd"
_CAMERA, _PROJECTOR, _FRUSTUM, _WINDOW = "#1a1a1a", "#c0392b", "#5f6f7f", "#0072b2"
#: Size of a box in its axes: at 1, labels are cut.
_ZOOM: Final = 0.88
#: Margin around a head, mm.
_MARGIN_MM: Final = 15.0


def choose_frame(dataset: Dataset, kind: str | None = None, is_moved: bool = False) -> DepthFrame:
    """Return the middle frame of the test split, from the given kind of face source if possible.

    With ``is_moved``, its nearest point is at 1 mm. Raises DatasetError for a data set without test
    frames or clean maps.
    """
    split = dataset.split("test")
    if not len(split):
        raise DatasetError(f"{dataset.path}: has no test frames to draw")
    numbers = [n for n, pair in enumerate(split) if pair.record["source"] == kind]
    chosen = numbers or range(len(split))
    number = chosen[len(chosen) // 2]
    return moved_frames(split).load(number) if is_moved else split[number]


def rig_of(dataset: Dataset) -> SensorRig:
    """Return the imagers and emitters of a data set's sensor."""
    return sensor_of(Settings.model_validate(dataset.header["settings"])).rig


def frustum_figure(frame: DepthFrame, rig: SensorRig, note: str) -> Any:
    """Draw figure 1: the viewing frustum (left), the head with the projector's shadow (right)."""
    figure = new_figure(8.6, 4.6)
    lit = lit_by_marching(frame.in_metres("clean_mm"), replace(rig, intrinsics=frame.intrinsics))
    far = float(frame.clean_mm.max()) + 150.0
    x, y, _ = _image_corners(rig.intrinsics, far).T
    emitters = to_figure_axes(
        MM_PER_M * np.array([e.position_m for e in rig.emitters[:1]]).reshape(-1, 3)
    )
    whole = np.array([x.min(), -60.0, -y.max()]), np.array([x.max(), far, -y.min()])
    boxes = {"viewing frustum": whole, "the head, and the projector's shadow on it": _bounds(frame)}
    for column, (title, (start, end)) in enumerate(boxes.items()):
        axis = _axes_3d(figure, column, start, end, 18.0, -140.0)
        axis.set_title(title, fontsize=_TEXT_SIZE + 1, y=1.02)
        _draw_surface(axis, frame.clean_mm, frame, (start, end), lit)
        if column == 0:
            _draw_frustum(axis, rig.intrinsics, far, _FRUSTUM)
            _draw_frustum(axis, frame.intrinsics, far, _WINDOW)
            axis.plot([0], [0], [0], marker="s", color=_CAMERA, markersize=5, linestyle="")
            axis.plot(*emitters.T, marker="D", color=_PROJECTOR, markersize=5, linestyle="")
    figure.legend(
        handles=_legend(frame, rig), loc="outside upper center", ncols=3, fontsize=_TEXT_SIZE - 1,
        frameon=False,
    )  # fmt: skip
    add_note(figure, note)
    return figure


def surfaces_figure(frame: DepthFrame, note: str) -> Any:
    """Draw figure 3: the surfaces of a frame's clean and noisy depth maps."""
    figure = new_figure(7.6, 4.3)
    bounds = _bounds(frame)
    for column, title in enumerate(("clean", "noisy")):
        # The view is from a little above the head and from the side without shadow.
        axis = _axes_3d(figure, column, *bounds, 12.0, -62.0)
        axis.set_title(title, fontsize=_TEXT_SIZE + 1, y=1.0, pad=-4)
        _draw_surface(axis, frame.layer(f"{title}_mm"), frame, bounds)
    add_note(figure, note)
    return figure


def to_figure_axes(points_mm: Points) -> NDArray[np.float64]:
    """Convert (..., 3) camera axes (x right, y down, z forward) to figure axes (z up)."""
    points = np.asarray(points_mm, np.float64)
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def _bounds(frame: DepthFrame) -> tuple[Points, Points]:
    """Compute two opposite corners of a box around the clean surface, figure axes, mm."""
    points = frame.intrinsics.unproject(frame.clean_mm)
    seen = to_figure_axes(points)[frame.clean_mm > 0]
    return seen.min(axis=0) - _MARGIN_MM, seen.max(axis=0) + _MARGIN_MM


def _axes_3d(
    figure: Any, column: int, low: Points, high: Points, elevation_deg: float, azimuth_deg: float
) -> Any:
    """Add 3D axes with equal scales and the limits of a box to a figure with two columns."""
    axis = figure.add_subplot(1, 2, column + 1, projection="3d", computed_zorder=False)
    axis.view_init(elev=elevation_deg, azim=azimuth_deg)
    axis.set_proj_type("persp", focal_length=2.0)
    ticker = matplotlib("ticker")
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axis, f"set_{name}lim")(a, b)
        getattr(axis, f"{name}axis").set_major_locator(ticker.MaxNLocator(4))
        axis.tick_params(axis=name, labelsize=_TEXT_SIZE - 1, pad=-2)
    axis.set_xlabel("x [mm]", fontsize=_TEXT_SIZE, labelpad=-4)
    axis.set_ylabel("distance [mm]", fontsize=_TEXT_SIZE, labelpad=-2)
    axis.set_zlabel("up [mm]", fontsize=_TEXT_SIZE, labelpad=-4)
    axis.set_box_aspect(np.asarray(high) - np.asarray(low), zoom=_ZOOM)
    return axis


def _draw_surface(
    axis: Any, depth_mm: Depth, frame: DepthFrame, bounds: tuple[Points, Points],
    lit: NDArray[np.floating] | None = None,
) -> None:  # fmt: skip
    """Draw the surface of a depth map within a box; ``lit``: (H, W), 0 = in the shadow."""
    mesh = surface(to_metres(depth_mm), SensorRig(frame.intrinsics), STEEPEST_DEG)
    if mesh is None:
        return
    points = mesh.vertices_mm * np.array([1.0, -1.0, -1.0])  # mesh axes to camera axes
    corners = to_figure_axes(points)[mesh.faces]
    inside = ((corners >= bounds[0]) & (corners <= bounds[1])).all(axis=(1, 2))
    # Normals are computed from the map; normals of triangles would show each mm as a step.
    towards = to_figure_axes(normals(to_metres(depth_mm), frame.rays))
    column, row = np.floor(frame.intrinsics.project(points)).astype(np.int64).T
    row, column = row.clip(0, depth_mm.shape[0] - 1), column.clip(0, depth_mm.shape[1] - 1)
    smooth = towards[row, column][mesh.faces].mean(axis=1)
    rgb = matplotlib("colors").to_rgb
    colours = np.tile(np.array(rgb(_SKIN if lit is None else _LIT)), (len(mesh.faces), 1))
    if lit is not None:
        colours[(lit[row, column][mesh.faces] == 0).all(axis=1)] = rgb(_SHADOW)
    shade = _AMBIENT + (1 - _AMBIENT) * np.clip(smooth @ _LIGHT, 0, 1)
    shaded = np.clip(colours * shade[:, None], 0, 1)[inside]
    collection = importlib.import_module("mpl_toolkits.mplot3d.art3d").Poly3DCollection
    # Edges in the colour of the face close the seams between triangles.
    faces = collection(corners[inside], facecolors=shaded, edgecolors=shaded, linewidths=0.2)
    axis.add_collection3d(faces)


def _image_corners(camera: Intrinsics, distance_mm: float) -> Points:
    """Compute the (4, 3) corners of the image at a distance, camera axes, mm."""
    x = (np.array([0, camera.width, camera.width, 0]) - camera.cx) / camera.fx
    y = (np.array([0, 0, camera.height, camera.height]) - camera.cy) / camera.fy
    return np.stack([x, y, np.ones(4)], axis=1) * distance_mm


def _draw_frustum(axis: Any, camera: Intrinsics, far_mm: float, colour: str) -> None:
    ends = to_figure_axes(_image_corners(camera, far_mm))
    for end in ends:
        axis.plot(*np.stack([np.zeros(3), end]).T, color=colour, linewidth=0.8)
    axis.plot(*np.concatenate([ends, ends[:1]]).T, color=colour, linewidth=0.8)


def _legend(frame: DepthFrame, rig: SensorRig) -> list[Any]:
    patch, line = matplotlib("patches").Patch, matplotlib("lines").Line2D
    handles = [
        line([], [], color=colour, linewidth=1, label=f"{name}, {c.width}x{c.height} px")
        for colour, name, c in ((_FRUSTUM, "frustum", rig.intrinsics),
                                (_WINDOW, "crop", frame.intrinsics))
    ]  # fmt: skip
    handles.append(line([], [], color=_CAMERA, marker="s", linestyle="", label="camera"))
    if rig.emitters:
        text = f"projector, {MM_PER_M * rig.baseline_m:.0f} mm beside"
        handles.append(line([], [], color=_PROJECTOR, marker="D", linestyle="", label=text))
    handles.append(patch(facecolor=_LIT, label="seen and lit"))
    return [*handles, patch(facecolor=_SHADOW, label="seen, in the projector's shadow")]
