"""Checks of the Azure Kinect, against its only real frame and Microsoft's published values.

The frame is pyk4a's test recording, NFOV unbinned (docs/explanation/time_of_flight.md).
tests/bench measures that frame with the same code and compares it with the bands.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glsim.bench import scenes
from glsim.bench.validate.captures import Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.array_types import Array
from glsim.core.depth_frame import Frames
from glsim.core.units import MM_PER_M
from glsim.measures.correlation import LAGS, correlation_of, lagged_sums
from glsim.measures.depth_noise import measure_spatial
from glsim.measures.pixel_runs import successive_runs
from glsim.measures.stacks import half_valid, sigma_temporal, without_plane

_SHEET = "azure-kinect"
#: Noise is compared in bins of infrared; limits of the bins, counts.
COUNTS = (60, 100, 150, 200, 300, 500, 1000, 3000, 9000)
#: Correlation of noise is measured in this range of infrared, counts, where noise is largest.
DIM = (60.0, 200.0)
#: Limits for rims of mug and handle: largest depth of the foreground, smallest of the wall, mm.
MUG_MM, BEHIND_MM = 330.0, 1300.0
#: Side of a tile for noise, and for the correlation of noise, px.
SIDE_PX, WIDE_PX = 12, 16
#: Largest range of depths in a tile, mm; a tile with a larger range contains an edge.
_MOST_SPREAD_MM = 60.0
#: Smallest ratio of far to near depth at a rim.
_STEP = 1.15
#: Widest gap beside a rim that is measured, px; few shadows of the emitter are wider.
_MOST_GAP_PX = 25
#: First and last pixel of a segment to which a line is fitted, counted from the rim.
_LINE_PX = (5, 10)
#: Pixels between the two surfaces are counted within this distance of a depth step, px.
_BAND_PX = 3
#: Largest rms of a smooth segment about its line, mm per m of depth.
_ROUGH_MM_PER_M = 4.0
#: A pixel lies between two surfaces if it is at least this share of their distance from both.
_BETWEEN = 0.15
#: Distance of the wall with a ramp of albedo, mm.
_RAMP_MM = 1000.0


def plane_tiles(
    depth_mm: NDArray[np.floating], infrared: NDArray[np.floating], side_px: int = SIDE_PX
) -> tuple[Array, Array, Array]:
    """Fit planes to half-overlapping tiles of (H, W) depth and infrared without holes and edges.

    Returns (N,) median infrared, counts; (N,) rms of the residual, mm; and (N, side, side) residual
    (depth minus plane), mm. Depth is 0 or NaN where there is none.
    """
    size, step = (side_px, side_px), side_px // 2
    z, light = (
        np.lib.stride_tricks.sliding_window_view(image, size)[:-1:step, :-1:step].reshape(
            -1, side_px**2
        )
        for image in (np.nan_to_num(np.asarray(depth_mm, np.float64)), infrared)
    )
    whole = (z.min(axis=1) > 0) & (np.ptp(z, axis=1) <= _MOST_SPREAD_MM)
    z, light = z[whole], light[whole]
    residual = without_plane(z.reshape(-1, *size))
    rms = np.sqrt((residual**2).sum(axis=(1, 2)) / (side_px**2 - 3))
    return np.median(light, axis=1).astype(np.float64), rms, residual


def dim_correlation(infrared: Array, residual_mm: Array) -> dict[str, float]:
    """Compute the correlation of the residuals of dim ``plane_tiles`` along rows and columns."""
    images = residual_mm[(infrared >= DIM[0]) & (infrared < DIM[1])]
    lags = {f"rows {n}": (0, n) for n in range(1, 5)}
    lags |= {f"columns {n}": (n, 0) for n in range(1, 5)}
    correlation = correlation_of([lagged_sums(images, list(lags.values()))])
    return dict(zip(lags, correlation, strict=True))


def noise_by_infrared(infrared: Array, rms_mm: Array) -> dict[str, float]:
    """Compute, by infrared, median tile noise / noise of the real frame (a fit within 12 %)."""
    ratios = {}
    for low, high in pairwise(COUNTS):
        inside = (infrared >= low) & (infrared < high)
        counts, rms = (np.median(v[inside]) if inside.any() else np.nan for v in (infrared, rms_mm))
        ratios[f"{low}-{high}"] = float(rms / np.hypot(0.42, 84 / counts**0.75))
    return ratios


def _frame(capture: Frames) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return depth, mm, and infrared, counts, of the first frame."""
    return np.nan_to_num(capture.whole_mm[0]), capture.stack("infrared")[0]


@validation_check(_SHEET)
def noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 1 and 2: noise and its correlation on walls of many distances and albedos."""
    camera = captures.camera
    shots = [
        _frame(camera.capture(scenes.wall(z, a), 1, 160, scene=f"{z} {a}"))
        for z in (300.0, 500.0, 800.0, 1200.0, 1600.0, 2000.0)
        for a in (0.05, 0.1, 0.2, 0.4, 0.8)
    ]
    tiles = [plane_tiles(*shot)[:2] for shot in shots]
    infrared, rms_mm = (np.concatenate(parts) for parts in zip(*tiles, strict=True))
    walls = []
    for shot in shots:
        counts, _, residual = plane_tiles(*shot, WIDE_PX)
        if ((counts >= DIM[0]) & (counts < DIM[1])).sum() >= 20:
            walls.append(dim_correlation(counts, residual))
    mean = {name: float(np.mean([w[name] for w in walls])) for name in (walls or [{}])[0]}
    return {
        "1": Measurement(noise_by_infrared(infrared, rms_mm)),
        "2": Measurement(mean, note="the real frame's holds bends of its surfaces too"),
    }


@validation_check(_SHEET)
def rims(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 3 to 8: the shadow of a bar, and the rims of a mug before walls."""
    camera = captures.camera
    bar = scenes.rectangle((-10, 10), (-300, 300), 297.0, 0.3)
    scene = scenes.merge_meshes(bar, scenes.wall(1520.0, 0.8))
    shot = camera.capture(scene, 1, None, scene="bar", extra=("lit",))
    row = camera.rig.intrinsics.height // 2
    clean, lit = shot.truth_mm[row], shot.stack("lit")[0, row].reshape(-1)
    front, back = np.flatnonzero(clean < 1000), clean > 1000
    shadow = np.flatnonzero(back & (lit < 0.5))
    shift = float(shadow.max() - front.max()) if shadow.size else 0.0
    penumbra = float((back & (lit > 0) & (lit < 1)).sum())
    depth, _ = _frame(camera.capture(scenes.mug_before_walls(), 1, None, scene="mug"))
    return {
        "3": Measurement({"px": shift}),
        "4": Measurement({"px": penumbra}),
        **rim_measurements(depth),
    }


def rim_measurements(depth_mm: NDArray[np.floating]) -> dict[str, Measurement]:
    """Measure checks 5 to 8 on (H, W) depth of the mug, 0 = none, real or simulated.

    A row is divided into segments of smooth depth; a rim is a step between two of them. A line is
    fitted to pixels 5 to 10 from the rim. The bend of a segment is the distance of its outermost
    pixels from this line, negative towards the camera. A sum of two surfaces' phasors bends a
    segment either way; a mean of depths bends it towards the other surface only.
    """
    z = np.nan_to_num(np.asarray(depth_mm, np.float64))
    # Neighbours belong to one segment if their depths differ by less than a tenth.
    least = np.minimum(z[:, 1:], z[:, :-1])
    joined = (least > 0) & (np.abs(np.diff(z, axis=1)) < 0.1 * least)
    row, _, end, start, _ = successive_runs(joined, _LINE_PX[1] + 1, _MOST_GAP_PX)
    away, outer = np.arange(*_LINE_PX), np.arange(2)[:, None]
    at_rim, bends, smooth = [], [], np.ones(row.size, np.bool_)
    for last, step in ((end - 1, -1), (start, 1)):
        inner = z[row, last + step * away[:, None]]
        slope, at_end = np.polyfit(away, inner, 1)
        residual = inner - (at_end + slope * away[:, None])
        smooth &= np.sqrt((residual**2).mean(axis=0)) <= _ROUGH_MM_PER_M * at_end / MM_PER_M
        at_rim.append(at_end)
        bends.append(z[row, last + step * outer] - (at_end + slope * outer))
    front, back = np.sort(at_rim, axis=0)
    right = at_rim[0] < at_rim[1]  # foreground on the left, gap on the right
    mug = smooth & (back >= _STEP * front) & (front < MUG_MM)
    band = z[row, (end + start) // 2 + np.arange(-_BAND_PX, _BAND_PX)[:, None]]
    margin = _BETWEEN * (back - front)
    between = ((band > front + margin) & (band < back - margin)).mean(axis=0)
    sides = {"lit": mug & ~right, "shadow": mug & right & (back > BEHIND_MM)}
    if min(side.sum() for side in sides.values()) < 20:
        return {n: Measurement({}, note="too few rims") for n in ("5", "6", "7", "8")}
    front_bend, back_bend = np.where(right, bends, bends[::-1])

    def middle(values: Array, *names: str) -> dict[str, float]:
        return {name: float(np.median(values[sides[name]])) for name in names}

    next_lit = middle(front_bend[1], "lit")["lit"]
    next_shadow = middle(back_bend[1], "shadow")["shadow"]
    return {
        "5": Measurement(middle(start - end, "lit", "shadow")),
        "6": Measurement({"share": float(between[mug].mean())}),
        "7": Measurement(middle(front_bend[0], "lit", "shadow") | {"lit, next": next_lit}),
        "8": Measurement(middle(back_bend[0], "shadow", "lit") | {"shadow, next": next_shadow}),
    }


@validation_check(_SHEET)
def limits(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 9 to 14: infrared, range, error and noise on walls and albedo ramps."""
    wall = captures.wall(1500.0, 0.8)
    bright = captures.camera.capture(scenes.wall(200.0, 0.8), 1, scene="bright").centre()
    ramp = scenes.albedo_ramp(330.0, 100.0, 0.5, 1.4)
    steep = captures.camera.capture(ramp, 4, None, scene="steep ramp")
    valid = np.isfinite(steep.whole_mm)
    dim = captures.camera.capture(
        scenes.albedo_ramp(_RAMP_MM, 500.0, 0.0, 0.1), 8, None, scene="dim ramp"
    )
    near = [z for z in range(140, 200, 5) if captures.valid_percent(z, 0.1) > 50]
    share = {f"{z} m": abs(captures.mean_error_mm(MM_PER_M * z)) - z for z in (0.5, 1, 2, 3)}
    noise = {f"{z} m": captures.temporal_sigma_mm(MM_PER_M * z) for z in (1, 2, 3)}
    half = half_valid(dim.stack("infrared"), np.isfinite(dim.whole_mm), np.arange(20.0, 140.0, 4.0))
    saturation = {
        "brightest": float(np.percentile(steep.stack("infrared")[valid], 99.99)),
        "infrared": float(np.median(bright.stack("infrared"))),
        "valid": float(np.isfinite(bright.whole_mm).mean()),
    }
    reach = {f"{z / MM_PER_M:g} m": captures.valid_percent(z, 0.8) / 100 for z in (3800, 4000)}
    return {
        "9": Measurement({"counts m^2": float(wall.stack("infrared").mean()) * 1.5**2}),
        "10": Measurement(saturation),
        "11": Measurement({"counts": half}),
        "12": Measurement({"nearest": float(min(near)) if near else None, **reach}),
        "13": Measurement({k: max(v, 0.0) for k, v in share.items()}, note="of one device"),
        "14": Measurement(noise),
    }


@validation_check(f"{_SHEET}-nfov-binned")
def binned(captures: Captures) -> dict[str, Measurement]:
    """Measure noise and range of the mode that averages 2 x 2 pixels, on image-filling walls."""
    near, middle, *far = (
        captures.camera.capture(scenes.wall(z, 0.6), 4, None, scene=f"binned {z}")
        for z in (1000.0, 1700.0, 2500.0, 3400.0, 4400.0, 5400.0)
    )
    valid = [np.isfinite(shot.whole_mm) for shot in far]
    surfaces = measure_spatial([*near, *middle, *far[0]])
    along = dict(zip(LAGS, surfaces.correlation, strict=True))
    return {
        "1": Measurement({"sigma": sigma_temporal(near.whole_mm)}),
        "2": Measurement({"all": float(np.mean(valid))}),
        "3": Measurement({"middle": float(valid[-1][:, 124:164, 140:180].mean())}),
        "4": Measurement({"p10": surfaces.rough_mm[0]}),
        "5": Measurement({"2 px": along[0, 2], "3 px": along[0, 3]}),
    }
