"""Checks of triangulating cameras: D4xx stereo, TrueDepth, and the Kinect V1 by its dots.

The measures are those of real frames in docs/explanation/stereo.md: disparity noise of planes, its
static share and correlation, the lattice of depths, gaps beside a foreground, holes, and pixels
with depth in some frames only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from glsim.bench import scenes
from glsim.bench.validate.captures import Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.array_types import Array
from glsim.core.mesh import Mesh
from glsim.core.units import MM_PER_M
from glsim.measures.disparity import find_tiles, measure_disparity_noise, power_share, to_disparity
from glsim.measures.disparity_steps import between_share, border_band, find_steps, measure_gaps
from glsim.measures.lattice import on_lattice
from glsim.measures.validity import flip_share, hole_share_beside_band
from glsim.noise.realsense_filters import decimate

#: Distances between pixels at which correlation is compared: LAGS_PX without 12 px.
_LAGS = (1, 2, 3, 4, 6, 8)
#: Number of captured frames per plane, enough to measure its noise in time.
_FRAMES = 4
#: Tilt of the planes, degrees; the disparity on a plane then crosses several whole pixels.
_TILT_DEG = 10.0
_ALBEDO = 0.6


def _focal_baseline_px_mm(captures: Captures) -> float:
    """Return focal length times baseline in delivered pixels, px mm."""
    return captures.focal_baseline_px_mm / captures.decimated_by


def _shot(captures: Captures, mesh: Mesh, frames: int, scene: str) -> tuple[Array, Array]:
    """Capture (T, H, W) depth, mm, 0 = none, and its disparity, px."""
    shot = captures.camera.capture(mesh, frames, None, scene=scene)
    depth = decimate(np.nan_to_num(shot.measured_mm), captures.decimated_by)
    return depth, to_disparity(depth, _focal_baseline_px_mm(captures))


def _plane(captures: Captures, z_mm: float) -> tuple[Array, Array]:
    """Capture depth, mm, and disparity, px, of a tilted plane; the result is cached."""
    mesh, name = scenes.tilted(z_mm, _TILT_DEG, _ALBEDO, half_mm=2 * z_mm), f"plane {z_mm}"
    return captures.cached(name, lambda: _shot(captures, mesh, _FRAMES, name))


def _noise_rows(
    captures: Captures, distances_m: Sequence[float], scale: float
) -> dict[str, dict[str, float | None]]:
    """Capture tilted planes; return the noise of their disparity, in px times ``scale``."""
    rows: dict[str, dict[str, float | None]] = {n: {} for n in ("residual", "frame", "static")}
    noises = []
    for distance in distances_m:
        disparity = _plane(captures, MM_PER_M * distance)[1]
        noise = measure_disparity_noise(list(disparity), [(k, k + 1) for k in range(_FRAMES - 1)])
        noises.append(noise)
        for name, row in rows.items():
            row[f"{distance:g} m"] = scale * float(getattr(noise, name))
    rows["correlation"] = {
        f"{way} {lag}": float(np.mean([getattr(n, way)[k] for n in noises]))
        for way in ("rows", "columns")
        for k, lag in enumerate(_LAGS)
    }
    return rows


def _lattice_share(captures: Captures, z_mm: float, steps: float, unit_mm: float) -> float:
    """Return the share of a plane's depths that are round(f B steps / n) units, n an integer."""
    depth_mm = _plane(captures, z_mm)[0]
    constant = captures.focal_baseline_px_mm * steps / unit_mm  # a median keeps the lattice
    return float(on_lattice(np.rint(depth_mm[depth_mm > 0] / unit_mm), constant).mean())


def _step_rows(
    captures: Captures, near_mm: float, far_mm: float, half_mm: float, *, upright: bool = False
) -> Mapping[str, float]:
    """Capture a square before a wall; measure gaps, intermediate depths and left border band."""
    mesh = scenes.occluder(near_mm, far_mm, half_mm, _ALBEDO)
    _, disparity = _shot(captures, mesh, 2, f"step {near_mm} {far_mm}")
    steps = [find_steps(image.T if upright else image) for image in disparity]
    (_, before), (behind_px, behind) = (measure_gaps(steps, right) for right in (False, True))
    return {
        "before": before, "behind": behind, "behind px": behind_px,
        "between": between_share(steps), "band": border_band(list(disparity))[1],
    }  # fmt: skip


def _validity_rows(captures: Captures, mesh: Mesh, scene: str) -> dict[str, float]:
    """Capture a static scene; measure holes outside the left border band, and flips, percent."""
    frames = list(_shot(captures, mesh, _FRAMES, scene)[1])
    flips = flip_share(frames, [(k, k + 1) for k in range(_FRAMES - 1)])
    return {"holes": 100 * hole_share_beside_band(frames), "flips": 100 * flips}


@validation_check("realsense-d435")
def stereo(captures: Captures) -> dict[str, Measurement]:
    """Measure planes and a depth step with a stereo camera."""
    rows = _noise_rows(captures, (0.5, 0.7, 0.9, 1.7), 1.0)
    step = _step_rows(captures, 700, 1500, 150)
    values = {k: v for s in captures.camera.sensor.stages for k, v in s.settings.items()}
    names = ("subpixel_steps", "depth_unit_mm")
    if names[0] not in values:  # a sensor with one imager
        names = ("steps_per_px", "step_mm")
    steps, unit = (values[n].bounds()[0] for n in names)
    share = _lattice_share(captures, 1700.0, steps, unit)
    room = scenes.room_corner(_focal_baseline_px_mm(captures))
    corner = _validity_rows(captures, room, "room corner")
    return {
        "1": Measurement(rows["residual"]),
        "2": Measurement(rows["frame"]),
        "3": Measurement(rows["static"]),
        "4": Measurement(rows["correlation"], note="mean of four distances"),
        "5": Measurement({"share": share}),
        "6": Measurement({"ratio": step["before"]}),
        "7": Measurement({"width": step["behind px"]}),
        "8": Measurement({"width": step["band"]}),
        "9": Measurement({"share": step["between"]}),
        "10": Measurement({"share": corner["holes"]}),
        "11": Measurement({"share": corner["flips"]}),
        "12": Measurement({"0.7 m": _wave_px(captures)}),
    }


def _wave_px(captures: Captures) -> float:
    """Fit a sine to the error of a steep plane over disparity's fraction; return its size, px."""
    mesh = scenes.tilted(700, 30, _ALBEDO, half_mm=1400)
    shot = captures.camera.capture(mesh, 1, None, scene="steep plane")
    true = captures.focal_baseline_px_mm / shot.truth_mm
    error = captures.focal_baseline_px_mm / shot.measured_mm - true
    error[np.abs(error) > 1] = np.nan  # a pixel on another surface
    return 2 * float(np.abs(np.nanmean(error * np.exp(2j * np.pi * true))))


@validation_check("truedepth")
def truedepth(captures: Captures) -> dict[str, Measurement]:
    """Measure planes and a depth step with a TrueDepth camera."""
    rows = _noise_rows(captures, (0.2, 0.35, 1.2), MM_PER_M / captures.focal_baseline_px_mm)
    step = _step_rows(captures, 300, 600, 60, upright=True)
    board = _validity_rows(captures, scenes.wall(200, _ALBEDO), "board")
    return {
        "1": Measurement(rows["residual"]),
        "2": Measurement({"0.2 m": rows["frame"]["0.2 m"]}),
        "3": Measurement(rows["correlation"], note="mean of three distances"),
        "4": Measurement({"ratio": step["before"]}),
        "5": Measurement({"ratio": step["behind"]}),
        "6": Measurement({"share": step["between"]}),
        "7": Measurement({"share": board["holes"]}),
        "8": Measurement({"share": board["flips"]}),
        **board_measurements(list(_plane(captures, 200.0)[1])),
    }


def board_measurements(disparity: Sequence[Array]) -> dict[str, Measurement]:
    """Measure checks 9 to 11 of truedepth on frames of boards, real or simulated.

    They are (H, W) disparity, px or 1/m, with the baseline along columns.
    """
    tiles = [find_tiles(image) for image in disparity]
    along = measure_disparity_noise(disparity).columns
    low, high = np.percentile(np.concatenate([t.sigma for t in tiles]), (10, 90))
    residual = np.concatenate([t.residual for t in tiles])
    return {
        "9": Measurement({f"{lag} px": along[k] for k, lag in enumerate(_LAGS[:4])}),
        "10": Measurement({"share": power_share(residual, 5.7, 8.0)}),
        "11": Measurement({"ratio": float(high / low)}),
    }


@validation_check("kinect-v1-pattern")
def kinect_v1(captures: Captures) -> dict[str, Measurement]:
    """Measure planes and a depth step with the Kinect V1 whose simulation matches dots."""
    rows = _noise_rows(captures, (0.7, 1.2), 1.0)
    step = _step_rows(captures, 700, 1500, 150)
    along = {k: v for k, v in rows["correlation"].items() if k.startswith("rows")}
    return {
        "1": Measurement(rows["residual"]),
        "2": Measurement(along, note="mean of two distances"),
        "3": Measurement({"share": _lattice_share(captures, 1200.0, 8, 1.0)}),
        "4": Measurement({"width": step["behind px"]}),
        "5": Measurement({"share": step["between"]}),
    }
