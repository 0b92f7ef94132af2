"""Validation sheets of the structured-light sensors as data.

``kinect-v1`` is compared with Nguyen, Izadi and Lovell 2012 and with the constants that
render_kinect and BlenSor share; ``kinect-v2-paper`` with the definitions of the model that it
re-implements.
"""

from __future__ import annotations

from math import sqrt

from glsim.validate.published_curves import nguyen_mm, shadow_px
from glsim.validate.report import Band, Check

NGUYEN = "Nguyen 2012"
ANCESTORS = "render_kinect, BlenSor"

#: Distances for the V1's noise and depth steps, mm.
V1_DISTANCES_MM = (900, 1500, 2000, 3000, 4000)

#: Depth steps of 1/8 px at those distances, mm: z^2 / (f b) / 8.
_V1_STEPS_MM = (2.3, 6.5, 11.5, 25.9, 46.0)

#: Backgrounds of an occluder at 0.9 m, m.
SHADOW_M = (1.1, 1.5, 2.0)


def _around(key: str, value: float, share: float, unit: str) -> Band:
    low, high = sorted((value * (1 - share), value * (1 + share)))
    return Band(key, round(low, 4), round(high, 4), unit)


def _shadows(focal_px: float) -> tuple[Band, ...]:
    widths = {z: shadow_px(0.075, focal_px, 0.9, z) for z in SHADOW_M}
    return tuple(
        Band(f"{z:g} m", round(w - 1, 1), round(w + 1, 1), "px") for z, w in widths.items()
    )


KINECT_V1: tuple[Check, ...] = (
    Check("1", "frontal wall: spatial sigma over distance",
          tuple(_around(f"{z / 1000:g} m", float(nguyen_mm(z / 1000)), 0.25, "mm")
                for z in V1_DISTANCES_MM), f"{NGUYEN} +-25 %", "measured"),
    Check("2", "shape: sigma(4 m) / sigma(2 m)",
          (_around("ratio", float(nguyen_mm(4.0) / nguyen_mm(2.0)), 0.25, ""),),
          f"{NGUYEN} +-25 %", "measured"),
    Check("3", "lateral: jitter of a straight edge, 0.9 before 1.5 m",
          (_around("std", 0.8, 0.25, "px"),), f"{NGUYEN} +-25 %", "measured"),
    Check("4", "disparities that are multiples of 1/8 px, within the rounding to mm",
          (Band("share", 99.9, 100.0, "%"),), ANCESTORS),
    Check("5", "depth steps: z^2 / (f b) / 8",
          tuple(_around(f"{z / 1000:g} m", s, 0.05, "mm")
                for z, s in zip(V1_DISTANCES_MM, _V1_STEPS_MM, strict=True)), ANCESTORS),
    Check("6", "shadow of an edge at 0.9 m on 1.1, 1.5, 2 m, b f (1/Zo - 1/Zb); right, up, down",
          (*_shadows(580.0), Band("other sides", -1.0, 1.0, "px")), "geometry, 75 mm"),
    Check("7", "range: share valid outside 0.7 to 6 m; least share valid inside",
          (Band("outside", 0.0, 0.0, "%"), Band("inside", 99.0, 100.0, "%")), "BlenSor"),
    Check("8", "field of view",
          (Band("across", 55.0, 59.0, "deg"), Band("down", 41.0, 45.0, "deg")),
          "render_kinect"),
    Check("9", "levels of depth on a 10 cm ramp at 3 m: banded",
          (Band("levels", 3.0, 6.0),), ANCESTORS),
)  # fmt: skip

KINECT_V2_PAPER: tuple[Check, ...] = (
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
    Check("6", "9 x 9 window: narrowest strip that is seen, 2/3 of 9 px",
          (Band("width", 5.0, 8.0, "px"),), ANCESTORS),
    Check("7", "dots: share of pixels; how far their depth spreads beyond a silhouette",
          (Band("share", 0.105, 0.117), Band("reach", 1.0, 3.1, "px")),
          f"{ANCESTORS}: 1/9, 3.1 px"),
    Check("8", "shadow of an edge at 0.9 m on 1.1, 1.5, 2 m, b f (1/Zo - 1/Zb); right, up, down",
          (*_shadows(365.456), Band("other sides", -1.0, 1.0, "px")), "geometry, 75 mm"),
    Check("9", "range: share valid outside 0.5 to 6 m; least share valid inside",
          (Band("outside", 0.0, 0.0, "%"), Band("inside", 95.0, 100.0, "%")), "render_kinect"),
    Check("10", "baseline", (Band("baseline", 75.0, 75.0, "mm"),), ANCESTORS),
)  # fmt: skip
