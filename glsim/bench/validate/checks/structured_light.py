"""Checks of the structured-light sensors.

``kinect-v1`` is compared with Nguyen, Izadi and Lovell 2012 and with the constants that
render_kinect and BlenSor share; ``kinect-v2-paper`` with the definitions of the model that it
re-implements.
"""

from __future__ import annotations

import cv2
import numpy as np

from glsim.bench import scenes
from glsim.bench.validate.captures import OFF, Captures
from glsim.bench.validate.checks.depth_edges import HALF_PX, NEAR_MM, capture_edge
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.array_types import Array
from glsim.core.units import MM_PER_M
from glsim.measures import stacks as measure
from glsim.simulation.virtual_camera import Changes

#: Distances at which noise and depth steps of the Kinect V1 are measured, mm.
V1_DISTANCES_MM = (900, 1500, 2000, 3000, 4000)
#: Distances of the wall behind an occluder at 0.9 m, m.
SHADOW_M = (1.1, 1.5, 2.0)

_ON = {"enabled": 1.0}


@validation_check("kinect-v1")
def v1_noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 1 to 3 of kinect-v1: noise over distance, and edge jitter."""
    sigma = {z: captures.spatial_sigma_mm(z) for z in V1_DISTANCES_MM}
    edge = capture_edge(captures, 1500)
    jitter = measure.edge_jitter(measure.edge_positions(edge.whole_mm, NEAR_MM, 1500))
    by_distance = {f"{z / MM_PER_M:g} m": s for z, s in sigma.items()}
    return {
        "1": Measurement(by_distance, "includes rounding to 1/8 px"),
        "2": Measurement({"ratio": measure.ratio(sigma[4000], sigma[2000])}),
        "3": Measurement({"std": jitter}),
    }


@validation_check("kinect-v1")
def v1_steps(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 4, 5 and 9 of kinect-v1: depth steps, since disparity has steps of 1/8 px."""
    on_grid, steps = [], {}
    for z in V1_DISTANCES_MM:
        depth = captures.wall(z).whole_mm
        depth = depth[np.isfinite(depth)]
        eighths = 8.0 * captures.focal_baseline_px_mm / depth
        # Rounding of depth, half a mm, as disparity in eighths of a pixel.
        tolerance = 0.51 * eighths / depth
        on_grid.append(np.abs(eighths - np.rint(eighths)) <= tolerance)
        steps[f"{z / MM_PER_M:g} m"] = _mean_level_step(captures, z)
    return {
        "4": Measurement({"share": 100.0 * float(np.concatenate(on_grid).mean())}),
        "5": Measurement(steps),
        "9": Measurement({"levels": float(captures.levels_on_ramp())}),
    }


def _mean_level_step(captures: Captures, z_mm: float) -> float:
    """Measure the mean step between depth levels, mm, on a ramp of depths within 6 % of z."""
    half_x = 40 * z_mm / captures.camera.rig.intrinsics.fx
    capture = captures.camera.capture(
        scenes.depth_ramp(z_mm, half_x, 0.09 * z_mm), 16, scene=f"ramp {z_mm}"
    )
    levels = np.unique(capture.whole_mm)
    levels = levels[np.abs(levels / z_mm - 1.0) < 0.06]
    return float(np.diff(levels).mean()) if levels.size > 1 else float("nan")


@validation_check("kinect-v1")
def v1_range(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 6 to 8 of kinect-v1: widths of shadows, range and field of view."""
    image = captures.camera.rig.intrinsics
    across = 2 * np.degrees(np.arctan(image.width / 2 / image.fx))
    down = 2 * np.degrees(np.arctan(image.height / 2 / image.fy))
    return {
        "6": _measure_shadow(captures, {"edge_dropout": OFF, "lateral": OFF, "despeckle": OFF}),
        "7": _measure_range(captures, (500, 680, 6500), (730, 2000, 5500)),
        "8": Measurement({"across": float(across), "down": float(down)}),
    }


@validation_check("kinect-v2-paper")
def paper_noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 1 to 5 of kinect-v2-paper: noise of disparity on a wall at 0.9 m."""

    def disparity(changes: Changes) -> Array:
        return captures.focal_baseline_px_mm / captures.wall(900, changes=changes).measured_mm

    noiseless_px = measure.mean_of(disparity({"perlin": OFF}))
    shipped = disparity({})
    eighths = 8.0 * shipped[np.isfinite(shipped)]
    perlin_px = shipped - noiseless_px
    doubled = disparity({"perlin": {"amplitude_px": 0.8}}) - noiseless_px
    gaussian = disparity({"perlin": OFF, "gaussian": _ON})
    simplex = disparity({"perlin": OFF, "simplex": _ON}) - noiseless_px
    rms = [np.sqrt(measure.mean_of(field**2) - 0.125**2 / 12) for field in (perlin_px, doubled)]
    smooth = measure.autocorrelation(perlin_px - measure.mean_of(perlin_px), [(0, 8)])
    on_grid = np.abs(eighths - np.rint(eighths)) < 0.01
    return {
        "1": Measurement({"share": 100.0 * float(on_grid.mean())}),
        "2": Measurement(
            {"largest": float(np.nanmax(np.abs(perlin_px))), "doubled": rms[1] / rms[0]}
        ),
        "3": Measurement({"sigma": float(np.nanstd(gaussian))}),
        "4": Measurement({"largest": float(np.nanmax(np.abs(simplex)))}),
        "5": Measurement({"lag 8": float(smooth[0])}),
    }


@validation_check("kinect-v2-paper")
def paper_window(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 6 and 7 of kinect-v2-paper: correlation window and dots, without noise."""
    pixel_mm = 900 / captures.camera.rig.intrinsics.fx
    quiet: Changes = {"perlin": OFF}
    widths = np.arange(2.0, 13.0)
    seen = []
    for width in widths:
        half = 0.5 * width * pixel_mm
        capture = captures.camera.capture(
            scenes.rectangle((-half, half), (-150, 150), 900), 1, 72, changes=quiet, scene="strip"
        )
        seen.append(np.isfinite(capture.centre(2, 64).whole_mm).mean())
    dots = captures.camera.capture(
        scenes.wall(900), 1, None, scene="dots", changes={**quiet, "dot_spread": {"radius_px": 0.5}}
    ).centre(400)
    half = 30 * pixel_mm
    patch = captures.camera.capture(
        scenes.rectangle((-half, half), (-half, half), 900), 1, 96, changes=quiet, scene="patch"
    )
    grown, clean = np.isfinite(patch.whole_mm[0]), np.isfinite(patch.truth_mm)
    away = cv2.distanceTransform((~clean).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return {
        "6": Measurement({"width": measure.crossing(widths, np.array(seen), 0.5)}),
        "7": Measurement(
            {
                "share": float(np.isfinite(dots.whole_mm).mean()),
                "reach": float(away[grown & ~clean].max(initial=0.0)),
            }
        ),
    }


@validation_check("kinect-v2-paper")
def paper_geometry(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 8 to 10 of kinect-v2-paper: shadow, range and baseline."""
    return {
        "8": _measure_shadow(captures, {"perlin": OFF, "dot_spread": OFF}),
        "9": _measure_range(captures, (300, 470, 8000), (530, 2000, 5000)),
        "10": Measurement({"baseline": MM_PER_M * captures.camera.rig.baseline_m}),
    }


def _measure_range(
    captures: Captures, outside: tuple[float, ...], inside: tuple[float, ...]
) -> Measurement:
    """Measure the share of valid pixels on walls at distances outside and inside the range, mm."""
    low = min(map(captures.valid_percent, inside))
    return Measurement({"outside": max(map(captures.valid_percent, outside)), "inside": low})


def _measure_shadow(captures: Captures, changes: Changes) -> Measurement:
    """Measure the shadow of a square at 0.9 m, px; ``changes`` disable other causes of holes."""
    half = HALF_PX * NEAR_MM / captures.camera.rig.intrinsics.fx
    widths: dict[str, float] = {}
    others: list[float] = []
    for far in SHADOW_M:
        square = scenes.occluder(NEAR_MM, MM_PER_M * far, half)
        capture = captures.camera.capture(square, 8, 144, changes=changes, scene=f"hole {far}")
        hole = np.isnan(capture.whole_mm).mean(axis=0)
        middle = slice(72 - 10, 72 + 10)
        across, down = hole[middle].mean(axis=0), hole[:, middle].mean(axis=1)
        widths[f"{far:g} m"] = float(across[:72].sum())
        others += [float(across[72:].sum()), float(down[:72].sum()), float(down[72:].sum())]
    widths["other sides"] = max(others, key=abs)
    return Measurement(widths)
