"""Checks of the structured-light sensors.

``kinect-v1`` is compared with Nguyen, Izadi and Lovell 2012 and with the constants that
render_kinect and BlenSor share; ``kinect-v2-paper`` with the definitions of the model that it
re-implements.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from glsim.measures import stacks as measure
from glsim.measures.stacks import Array
from glsim.validate import scenes
from glsim.validate.captures import Captures
from glsim.validate.checks.edges import NEAR_MM, capture_edge
from glsim.validate.published_curves import nguyen_mm, shadow_px
from glsim.validate.report import Band, Check, Measurement, validation_check
from glsim.validate.sources import ANCESTORS, NGUYEN
from glsim.validate.virtual_camera import Changes

#: Distances for the V1's noise and depth steps, mm.
V1_DISTANCES_MM = (900, 1500, 2000, 3000, 4000)
#: Depth steps of 1/8 px at those distances, mm: z^2 / (f b) / 8.
_V1_STEPS_MM = (2.3, 6.5, 11.5, 25.9, 46.0)
#: Backgrounds of an occluder at 0.9 m, m.
SHADOW_M = (1.1, 1.5, 2.0)

_OFF = {"enabled": 0.0}
_ON = {"enabled": 1.0}


def _around(key: str, value: float, share: float, unit: str) -> Band:
    low, high = sorted((value * (1 - share), value * (1 + share)))
    return Band(key, round(low, 4), round(high, 4), unit)


def _shadows(focal_px: float) -> tuple[Band, ...]:
    widths = {z: shadow_px(0.075, focal_px, 0.9, z) for z in SHADOW_M}
    return tuple(
        Band(f"{z:g} m", round(w - 1, 1), round(w + 1, 1), "px") for z, w in widths.items()
    )


def disparity_px(captures: Captures, depth_mm: Array) -> Array:
    """Convert depth (mm) to disparity (px): focal length times baseline over depth."""
    return np.asarray(
        1000.0 * captures.camera.rig.intrinsics.fx * captures.camera.rig.baseline_m / depth_mm
    )


@validation_check(
    "kinect-v1",
    Check("1", "frontal wall: spatial sigma over distance",
          tuple(_around(f"{z / 1000:g} m", float(nguyen_mm(z / 1000)), 0.25, "mm")
                for z in V1_DISTANCES_MM), f"{NGUYEN} +-25 %", "measured"),
    Check("2", "shape: sigma(4 m) / sigma(2 m)",
          (_around("ratio", float(nguyen_mm(4.0) / nguyen_mm(2.0)), 0.25, ""),),
          f"{NGUYEN} +-25 %", "measured"),
    Check("3", "lateral: jitter of a straight edge, 0.9 before 1.5 m",
          (_around("std", 0.8, 0.25, "px"),), f"{NGUYEN} +-25 %", "measured"),
)  # fmt: skip
def v1_noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 1 to 3 of kinect-v1: noise over distance, edge jitter."""
    sigma = {z: captures.spatial_sigma_mm(z) for z in V1_DISTANCES_MM}
    edge = capture_edge(captures, 1500)
    jitter = measure.edge_jitter(measure.edge_positions(edge.frames_mm, NEAR_MM, 1500))
    return {
        "1": Measurement(
            {f"{z / 1000:g} m": s for z, s in sigma.items()}, "includes rounding to 1/8 px"
        ),
        "2": Measurement({"ratio": measure.ratio(sigma[4000], sigma[2000])}),
        "3": Measurement({"std": jitter}),
    }


@validation_check(
    "kinect-v1",
    Check("4", "disparities that are multiples of 1/8 px, within the rounding to mm",
          (Band("share", 99.9, 100.0, "%"),), ANCESTORS),
    Check("5", "depth steps: z^2 / (f b) / 8",
          tuple(_around(f"{z / 1000:g} m", s, 0.05, "mm")
                for z, s in zip(V1_DISTANCES_MM, _V1_STEPS_MM, strict=True)), ANCESTORS),
    Check("9", "levels of depth on a 10 cm ramp at 3 m: banded",
          (Band("levels", 3.0, 6.0),), ANCESTORS),
)  # fmt: skip
def v1_steps(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 4, 5 and 9 of kinect-v1: levels of depth due to disparity in 1/8 px."""
    on_grid, steps = [], {}
    for z in V1_DISTANCES_MM:
        depth = captures.wall(z).frames_mm
        depth = depth[np.isfinite(depth)]
        eighths = 8.0 * disparity_px(captures, depth)
        # Half a mm of rounding, in eighths of a pixel.
        tolerance = 0.51 * eighths / depth
        on_grid.append(np.abs(eighths - np.rint(eighths)) <= tolerance)
        steps[f"{z / 1000:g} m"] = _mean_level_step(captures, z)
    ramp = captures.camera.capture(
        scenes.ten_centimetres(captures.camera.rig.intrinsics.fx), crop=96, scene="ramp"
    )
    return {
        "4": Measurement({"share": 100.0 * float(np.concatenate(on_grid).mean())}),
        "5": Measurement(steps),
        "9": Measurement({"levels": float(scenes.levels_on_ramp(ramp.encoded))}),
    }


def _mean_level_step(captures: Captures, z_mm: float) -> float:
    """Return the mean gap of neighbouring depth levels on a ramp, mm, at depths within 6 % of z."""
    half_x = 40 * z_mm / captures.camera.rig.intrinsics.fx
    capture = captures.camera.capture(
        scenes.depth_ramp(z_mm, half_x, 0.09 * z_mm), 16, at_mm=(0, 0, z_mm), scene=f"ramp {z_mm}"
    )
    levels = np.unique(capture.encoded).astype(np.float64)
    levels = levels[np.abs(levels / z_mm - 1.0) < 0.06]
    return float(np.diff(levels).mean()) if levels.size > 1 else float("nan")


@validation_check(
    "kinect-v1",
    Check("7", "range: share valid outside 0.7 to 6 m; least share valid inside",
          (Band("outside", 0.0, 0.0, "%"), Band("inside", 99.0, 100.0, "%")), "BlenSor"),
    Check("8", "field of view",
          (Band("across", 55.0, 59.0, "deg"), Band("down", 41.0, 45.0, "deg")),
          "render_kinect"),
)  # fmt: skip
def v1_range(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 7 and 8 of kinect-v1: range, field of view."""
    image = captures.camera.rig.intrinsics
    across = 2 * np.degrees(np.arctan(image.width / 2 / image.fx))
    down = 2 * np.degrees(np.arctan(image.height / 2 / image.fy))
    return {
        "7": _measure_range(captures, (500, 680, 6500), (730, 2000, 5500)),
        "8": Measurement({"across": float(across), "down": float(down)}),
    }


@validation_check(
    "kinect-v1",
    Check("6", "shadow of an edge at 0.9 m on 1.1, 1.5, 2 m, b f (1/Zo - 1/Zb); right, up, down",
          (*_shadows(580.0), Band("other sides", -1.0, 1.0, "px")), "geometry, 75 mm"),
)  # fmt: skip
def v1_shadow(captures: Captures) -> dict[str, Measurement]:
    """Measure check 6 of kinect-v1: widths of shadows."""
    return {
        "6": _measure_shadow(captures, {"edge_dropout": _OFF, "lateral": _OFF, "despeckle": _OFF})
    }


@validation_check(
    "kinect-v2-paper",
    Check("1", "disparities that are multiples of 1/8 px", (Band("share", 99.9, 100.0, "%"),),
          ANCESTORS),
    Check("2", "Perlin noise in disparity: largest change; growth with a doubled amplitude",
          (Band("largest", 0.1, 1.25, "px"), Band("doubled", 1.9, 2.1)),
          "render_kinect: 0.4 px, 6 octaves of persistence 0.7, at most 1.18 px"),
    Check("3", "Gaussian variant: sigma of disparity, 0.15 px and rounding to 1/8",
          (_around("sigma", sqrt(0.15**2 + 0.125**2 / 12), 0.05, "px"),), "render_kinect"),
    Check("4", "simplex variant: largest change of disparity, 0.5 px and rounding",
          (Band("largest", 0.3, 0.5 + 0.0625, "px"),), "render_kinect"),
    Check("5", "Perlin noise is smooth: correlation of disparity 8 px away",
          (Band("lag 8", 0.5, 1.0),), "render_kinect: first lattice 192 x 318 px"),
)  # fmt: skip
def paper_noise(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 1 to 5 of kinect-v2-paper: noise of disparity on a wall at 0.9 m."""

    def disparity(changes: Changes) -> Array:
        return disparity_px(captures, captures.wall(900, changes=changes).fine_mm)

    noiseless_px = measure.mean_of(disparity({"perlin": _OFF}))
    shipped = disparity({})
    eighths = 8.0 * shipped[np.isfinite(shipped)]
    perlin_px = shipped - noiseless_px
    doubled = disparity({"perlin": {"amplitude_px": 0.8}}) - noiseless_px
    gaussian = disparity({"perlin": _OFF, "gaussian": _ON})
    simplex = disparity({"perlin": _OFF, "simplex": _ON}) - noiseless_px
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


@validation_check(
    "kinect-v2-paper",
    Check("6", "9 x 9 window: narrowest strip that is seen, 2/3 of 9 px",
          (Band("width", 5.0, 8.0, "px"),), ANCESTORS),
    Check("7", "dots: share of pixels; how far their depth spreads beyond a silhouette",
          (Band("share", 0.105, 0.117), Band("reach", 1.0, 3.1, "px")),
          f"{ANCESTORS}: 1/9, 3.1 px"),
)  # fmt: skip
def paper_window(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 6 and 7 of kinect-v2-paper without noise: correlation window, dots."""
    pixel_mm = 900 / captures.camera.rig.intrinsics.fx
    quiet: Changes = {"perlin": _OFF}
    widths = np.arange(2.0, 13.0)
    seen = []
    for width in widths:
        half = 0.5 * width * pixel_mm
        capture = captures.camera.capture(
            scenes.rectangle((-half, half), (-150, 150), 900), 1, 72, at_mm=(0, 0, 900),
            changes=quiet, scene="strip",
        )  # fmt: skip
        seen.append(np.isfinite(capture.centre(2, 64).frames_mm).mean())
    dots = captures.camera.capture(
        scenes.wall(900), 1, None, at_mm=(0, 0, 900), scene="dots",
        changes={**quiet, "dot_spread": {"radius_px": 0.5}},
    ).centre(400)  # fmt: skip
    half = 30 * pixel_mm
    patch = captures.camera.capture(
        scenes.rectangle((-half, half), (-half, half), 900), 1, 96, at_mm=(0, 0, 900),
        changes=quiet, scene="patch",
    )  # fmt: skip
    grown = np.isfinite(patch.frames_mm[0])
    return {
        "6": Measurement({"width": measure.crossing(widths, np.array(seen), 0.5)}),
        "7": Measurement(
            {
                "share": float(np.isfinite(dots.frames_mm).mean()),
                "reach": _reach(grown, np.isfinite(patch.clean_mm)),
            }
        ),
    }


@validation_check(
    "kinect-v2-paper",
    Check("8", "shadow of an edge at 0.9 m on 1.1, 1.5, 2 m, b f (1/Zo - 1/Zb); right, up, down",
          (*_shadows(365.456), Band("other sides", -1.0, 1.0, "px")), "geometry, 75 mm"),
    Check("9", "range: share valid outside 0.5 to 6 m; least share valid inside",
          (Band("outside", 0.0, 0.0, "%"), Band("inside", 95.0, 100.0, "%")), "render_kinect"),
    Check("10", "baseline", (Band("baseline", 75.0, 75.0, "mm"),), ANCESTORS),
)  # fmt: skip
def paper_geometry(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 8 to 10 of kinect-v2-paper: shadow, range, baseline."""
    return {
        "8": _measure_shadow(captures, {"perlin": _OFF, "dot_spread": _OFF}),
        "9": _measure_range(captures, (300, 470, 8000), (530, 2000, 5000)),
        "10": Measurement({"baseline": 1000.0 * captures.camera.rig.baseline_m}),
    }


def _reach(grown: np.ndarray, clean: np.ndarray) -> float:
    """Return the largest distance from a grown pixel to the nearest clean one, px."""
    new, old = np.argwhere(grown & ~clean), np.argwhere(clean)
    if len(new) == 0 or len(old) == 0:
        return 0.0
    squared = ((new[:, None, :] - old[None, :, :]) ** 2).sum(axis=-1).min(axis=1)
    return float(np.sqrt(squared.max()))


def _measure_range(
    captures: Captures, outside: tuple[float, ...], inside: tuple[float, ...]
) -> Measurement:
    """Measure the share of valid pixels on walls outside and inside the range, distances in mm."""

    def valid(z: float) -> float:
        capture = captures.camera.capture(
            scenes.wall(z), 8, 24, at_mm=(0, 0, z), scene=f"range {z}"
        )
        return 100.0 * float(np.isfinite(capture.frames_mm).mean())

    return Measurement({"outside": max(map(valid, outside)), "inside": min(map(valid, inside))})


def _measure_shadow(captures: Captures, changes: Changes) -> Measurement:
    """Measure the holes around a square at 0.9 m, px; ``changes`` turn other causes off."""
    half = 20.0 * NEAR_MM / captures.camera.rig.intrinsics.fx
    widths: dict[str, float] = {}
    others: list[float] = []
    for far in SHADOW_M:
        capture = captures.camera.capture(
            scenes.occluder(NEAR_MM, 1000 * far, half), 8, 144, at_mm=(0, 0, NEAR_MM),
            changes=changes, scene=f"hole {far}",
        )  # fmt: skip
        hole = np.isnan(capture.frames_mm).mean(axis=0)
        middle = slice(72 - 10, 72 + 10)
        across, down = hole[middle].mean(axis=0), hole[:, middle].mean(axis=1)
        widths[f"{far:g} m"] = float(across[:72].sum())
        others += [float(across[72:].sum()), float(down[:72].sum()), float(down[72:].sum())]
    widths["other sides"] = max(others, key=abs)
    return Measurement(widths)
