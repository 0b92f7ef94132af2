"""Draw docs/figures/stereo_*.png: python scripts/stereo_figures.py.

How a stereo camera errs, each picture from frames that glsim renders: the two infrared images and
what is found in them, the waves of its noise, the steps of its depth, and what the filters of
librealsense do. Takes under a minute.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from glsim import Frame, load_settings, open_context, open_sources
from glsim.files.atomic import write_atomic
from glsim.measures.disparity import LAGS_PX, measure_disparity_noise, to_disparity
from glsim.pipeline import Simulator
from glsim.plan.tasks import make_tasks
from glsim.preview import shaded
from glsim.reason import Reason
from glsim.sensors.sensor import load_sensor
from glsim.validate import VirtualCamera, scenes

FIGURES: Final = Path(__file__).resolve().parents[1] / "docs" / "figures"
SENSOR: Final = "realsense-d435"
#: Correlation of errors along rows at LAGS_PX, measured on recordings of two real D435s.
_MEASURED: Final = (
    (0.94, 0.87, 0.78, 0.68, 0.46, 0.24, -0.06),
    (0.96, 0.91, 0.84, 0.77, 0.60, 0.42, 0.12),
)
#: librealsense's filters in its order: title -> the stages that run.
_FILTERS: Final[Mapping[str, tuple[str, ...]]] = {
    "as delivered": (),
    "spatial_filter": ("spatial_filter",),
    "temporal_filter": ("temporal_filter",),
    "hole_filling": ("hole_filling",),
    "all three": ("spatial_filter", "temporal_filter", "hole_filling"),
}


def frame_of(stages: Mapping[str, Mapping[str, Any]] | None = None) -> Frame:
    """Render a person at 0.6 m before a wall at 1.2 m, with both images and the disparity."""
    settings = load_settings(
        overrides={
            "sensor": SENSOR,
            "seed": 5,
            "stage": dict(stages or {}),
            "pose": {"distance_mm": 600, "yaw_deg": 15},
            "scene": {"wall_mm": 1200},
            "strict": True,
        },
        source={"subjects": 1, "frames_per_subject": 1},
    )
    sources = open_sources(settings)
    layers = ("clean", "noisy", "infrared", "infrared_right", "reason")
    simulator = Simulator(settings, sources, open_context(), ("disparity",), layers)
    (frame,) = simulator.frames(make_tasks(settings, sources))
    assert isinstance(frame, Frame)
    return frame


def search() -> Figure:
    """Draw both images with one place in each, the disparity, and where nothing was found."""
    frame = frame_of()
    rows, columns = slice(110, 430), slice(230, 650)
    extent = (columns.start, columns.stop, rows.stop, rows.start)
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.1), layout="constrained")
    brightest = np.percentile(frame.infrared, 99.5)
    disparity = np.asarray(frame.extra["disparity"])
    seen = np.where(disparity > 0, disparity, np.nan)
    row, column = 252, 446
    for axis, image, name, at in (
        (axes[0], frame.infrared, "left", float(column)),
        (axes[1], frame.infrared_right, "right", column - float(disparity[row, column])),
    ):
        share = np.sqrt(np.clip(image / brightest, 0, 1))[rows, columns]
        axis.imshow(share, cmap="gray", extent=extent, interpolation="nearest")
        axis.set_title(f"infrared, {name}: the nose at x = {at:.1f} px", fontsize=9)
        axis.axvline(column, color="#e69f00", lw=0.8, ls=":")
        axis.plot([at], [row], "o", mfc="none", mec="#e69f00", ms=13, mew=1.5)
    shown = axes[2].imshow(seen[rows, columns], cmap="viridis", vmin=15, extent=extent)
    axes[2].set_title("disparity: how far the right image is moved", fontsize=9)
    figure.colorbar(shown, ax=axes[2], label="px", shrink=0.85)
    _holes(axes[3], frame, rows, columns, extent)
    for axis in axes:
        axis.set_xticks([])
        axis.set_yticks([])
    return figure


def _holes(axis: Axes, frame: Frame, rows: slice, columns: slice, extent: Any) -> None:
    """Draw the reasons of lost pixels, and the predicted width of the shadow."""
    colours = {
        Reason.VALID: ("#d8dade", "measured"),
        Reason.SHADOW: ("#0072b2", "not seen by the right imager"),
        Reason.WINDOW: ("#d55e00", "not found"),
        Reason.MOVED: ("#009e73", "another surface"),
    }
    image = np.ones((*frame.reason.shape, 3))
    for reason, (colour, _) in colours.items():
        image[frame.reason == reason] = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    axis.imshow(image[rows, columns], extent=extent, interpolation="nearest")
    axis.set_title("shadow of the second imager, on the left", fontsize=9)
    row = 185
    head = np.flatnonzero((frame.clean[row] > 0) & (frame.clean[row] < 1000))
    rig = load_sensor(SENSOR).rig
    fb = 1000.0 * rig.intrinsics.fx * rig.baseline_m
    near_mm, far_mm = float(frame.clean[row, head[0]]), 1200.0
    wide = fb * (1 / near_mm - 1 / far_mm)
    axis.annotate("", (head[0], row), (head[0] - wide, row), arrowprops={"arrowstyle": "<->"})
    axis.text(
        head[0] - wide - 6, row + 3, f"f B (1/z₁ - 1/z₂)\n= {wide:.0f} px", ha="right", fontsize=7
    )
    handles = [Patch(color=colour, label=word) for colour, word in colours.values()]
    axis.legend(handles=handles, fontsize=6, loc="lower left", framealpha=0.9)


def waves() -> Figure:
    """Draw walls as reliefs under a lamp: waves, a Kinect V2's noise, white noise; correlations."""
    context = open_context()
    reliefs: dict[str, tuple[NDArray[np.float64], str]] = {}
    sigmas: dict[str, float] = {}
    curves: dict[str, tuple[float, ...]] = {}
    for sensor, title in ((SENSOR, "RealSense D435"), ("kinect-v2", "Kinect V2")):
        camera = VirtualCamera(sensor, context, frames=2)
        captured = camera.capture(scenes.wall(1000.0), crop=200).fine_mm
        deep = captured[0] - np.nanmedian(captured[0])
        sigmas[sensor] = float(np.nanstd(deep))
        reliefs[title] = deep, f"{title}: {sigmas[sensor]:.1f} mm"
        noise = measure_disparity_noise([to_disparity(image) for image in captured])
        curves[title] = noise.rows
    sigma = sigmas[SENSOR]
    white = np.random.default_rng(0).normal(0, sigma, (200, 200))
    reliefs["white"] = white, f"white noise of the same {sigma:.1f} mm"
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.4), layout="constrained")
    for axis, (deep, title) in zip(axes, reliefs.values(), strict=False):
        axis.imshow(_relief(deep), cmap="gray", vmin=0, vmax=1)
        axis.set_title(f"wall at 1 m, {title}", fontsize=9)
        axis.axis("off")
    axes[3].plot(LAGS_PX, curves["RealSense D435"], "o-", label="RealSense D435, glsim")
    axes[3].fill_between(LAGS_PX, *_MEASURED, color="0.8", label="two real D435s")
    axes[3].plot(LAGS_PX, curves["Kinect V2"], "s-", label="Kinect V2, glsim")
    axes[3].axhline(0, color="0.6", lw=0.8)
    axes[3].set_xlabel("distance along a row, px")
    axes[3].set_ylabel("correlation of errors")
    axes[3].legend(fontsize=7)
    return figure


def _relief(deep_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the brightness of a relief under a lamp at the upper left, 0 to 1."""
    pitch_mm = 2.5  # of a pixel at 1 m; the height is taken twice, so that waves are seen
    down, across = np.gradient(2.0 * np.nan_to_num(deep_mm), pitch_mm)
    light = np.array([-0.5, -0.5, 0.7])
    light /= np.linalg.norm(light)
    length = np.sqrt(1 + across**2 + down**2)
    shade: NDArray[np.float64] = (across * light[0] + down * light[1] + light[2]) / length
    return np.where(np.isfinite(deep_mm), np.clip(shade, 0, 1), np.nan)


def steps() -> Figure:
    """Draw a row across slanted walls near 1 m and 2 m: whole numbers of 1/32 px."""
    context = open_context()
    camera = VirtualCamera(SENSOR, context, frames=1)
    rig = camera.rig
    constant = 32 * 1000.0 * rig.intrinsics.fx * rig.baseline_m
    figure, axes = plt.subplots(1, 2, figsize=(12, 3.4), layout="constrained")
    for axis, z_mm in zip(axes, (1000.0, 2000.0), strict=True):
        mesh = scenes.depth_ramp(z_mm, 0.3 * z_mm, 0.015 * z_mm)
        # In steps of 0.1 mm, so that rounding to the camera's 1 mm does not hide those of 1/32 px.
        fine = {"match_stereo": {"depth_unit_mm": 0.1}}
        captured = camera.capture(mesh, crop=220, changes=fine)
        part = np.s_[110, 110:190]
        row, true = captured.fine_mm[0][part], captured.clean_mm[part]
        column = np.arange(row.size)
        low, high = np.nanmin(row), np.nanmax(row)
        counts = np.arange(np.ceil(constant / high), np.floor(constant / low) + 1)
        axis.hlines(constant / counts, 0, row.size, color="0.85", lw=0.7)
        axis.plot(column, true, color="#e69f00", lw=1, label="true")
        axis.plot(column, row, ".", ms=3, color="#0072b2", label="measured")
        step = z_mm**2 / constant
        axis.set_title(f"slanted wall near {z_mm / 1000:g} m: steps of {step:.1f} mm", fontsize=9)
        axis.set_xlabel("column, px")
        axis.set_ylabel("depth, mm")
        axis.legend(fontsize=7)
    return figure


def filters() -> Figure:
    """Draw a face as delivered and after the filters."""
    figure, axes = plt.subplots(1, len(_FILTERS), figsize=(15, 3.6), layout="constrained")
    rows, columns = slice(120, 360), slice(300, 540)
    for axis, (title, running) in zip(axes, _FILTERS.items(), strict=True):
        frame = frame_of({stage: {"enabled": True} for stage in running})
        picture = shaded((0.001 * frame.noisy).astype(np.float32), frame.intrinsics)
        axis.imshow(picture[rows, columns, ::-1])
        found = (frame.noisy > 0) & (frame.clean > 0) & (frame.clean < 700)
        error = (frame.noisy.astype(float) - frame.clean)[found]
        spread = float(error[np.abs(error) < 25].std())
        holes = 100.0 * float((frame.noisy == 0)[rows, columns].mean())
        axis.set_title(f"{title}\nhead {spread:.1f} mm, holes {holes:.1f} %", fontsize=9)
        axis.axis("off")
    return figure


def main() -> None:
    """Render and write the figures."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for draw in (search, waves, steps, filters):
        drawn = io.BytesIO()
        figure = draw()
        figure.savefig(drawn, format="png", dpi=110, metadata={"Software": "glsim"})
        plt.close(figure)
        write_atomic(drawn.getvalue(), FIGURES / f"stereo_{draw.__name__}.png")


if __name__ == "__main__":
    main()
