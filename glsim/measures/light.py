"""Infrared: depth noise as a function of infrared, and light by distance and radius.

Noise law of a phase measurement: sigma^2 = a^2 + (b / IR)^2, with a in mm and b in mm counts
(Mutto et al. 2012). IR r^2 / cos, in counts m^2, is the infrared of the same surface at 1 m, facing
the camera. It does not depend on the distance for a Lambertian surface and an emitter beside the
lens. The 90th percentile of a scene stands for its white surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from glsim.core.array_types import Array
from glsim.core.depth_frame import DepthFrame
from glsim.core.units import MM_PER_M
from glsim.measures.depth_noise import DISTANCES_M, pair_noise
from glsim.measures.measured_frame import lit, radius_px, surfaces

#: Bounds of the infrared classes of the noise law, counts; a factor of 10 has twelve classes.
_CLASSES = np.geomspace(100.0, 65_000.0, 34)
#: Bounds of the rings in which the light is measured, px.
RINGS_PX = (0.0, 40.0, 80.0, 120.0, 140.0, 160.0, 180.0, 200.0, 220.0, 240.0, 260.0, 300.0)
#: Radius, px, within which light is compared over distance; the lens is even there (measured).
EVEN_PX = 140.0
#: Counts by which the fit of the noise law is scaled, so that its two terms are of similar size.
_COUNTS = 1000.0
_LEAST_PIXELS = 300
_BRIGHTEST = 90.0
#: Smallest cosine of a surface (60 degrees): for steeper surfaces the cosine is uncertain.
_LEAST_COSINE = 0.5
#: Mean square of a Gaussian, divided by the mean square without its largest percent. Derived:
#: 0.99 / (0.99 - 2 c phi(c)) at c = 2.5758.
_UNTRIMMED = 0.99 / (0.99 - 2 * 2.5758 * 0.014460)


@dataclass(frozen=True)
class NoiseLaw:
    """The law sigma^2 = floor^2 + (slope / IR)^2; classes are (counts, sigma mm, pixels)."""

    floor_mm: float
    slope_mm: float
    classes: tuple[tuple[float, float, int], ...]


@dataclass(frozen=True)
class Light:
    """Infrared light of a set of frames, and depth noise as a function of infrared.

    Attributes:
        brightness: (from m, to m, IR r^2 / cos of the brightest surfaces, counts m^2).
        overall: median of ``brightness`` over the distances.
        rings: (from px, to px, brightness relative to the brightness within 80 px).
        saturated: share of pixels with saturated infrared.
    """

    temporal: NoiseLaw
    spatial: NoiseLaw
    brightness: tuple[tuple[float, float, float], ...]
    overall: float
    rings: tuple[tuple[float, float, float], ...]
    saturated: float


def measure_light(frames: Sequence[DepthFrame], pairs: Sequence[tuple[int, int]]) -> Light | None:
    """Measure the light and its noise law; None if no frame has infrared."""
    with_light = [frame for frame in frames if frame.infrared is not None]
    if not with_light:
        return None
    over_space = []
    bright: list[Array] = []
    saturated = []
    for frame in with_light:
        assert frame.infrared is not None
        s = surfaces(frame)
        used = s.smooth & lit(frame)
        ir = frame.infrared.astype(np.float64)
        unit = light_at_one_metre(frame)
        limit = 4.0 * np.nanmedian(s.rough_mm) if used.any() else 0.0
        flat = used & (s.rough_mm < limit) & (s.bend_mm < 2.0)
        quantum = frame.step_mm**2 / 12.0
        squares = np.where(flat, s.rough_mm.astype(np.float64) ** 2 - quantum, np.nan)
        over_space.append((ir[::3, ::3], squares[::3, ::3]))
        keep = np.isfinite(unit)[::2, ::2]
        columns = (unit, frame.measured_mm / MM_PER_M, radius_px(frame))
        bright.append(np.stack([c[::2, ::2][keep] for c in columns]).astype(np.float64))
        saturated.append(float((~lit(frame) & (frame.infrared > 0)).mean()))
    unit, depth, radius = np.concatenate(bright, axis=1)
    even = radius < EVEN_PX
    by_distance = [
        (near, far, _brightest(unit[even & (depth >= near) & (depth < far)]))
        for near, far in pairwise(DISTANCES_M)
    ]
    known = [value for _, _, value in by_distance if np.isfinite(value)]
    centre = _brightest(unit[radius < 80.0])
    rings = [
        (inner, outer, _brightest(unit[(radius >= inner) & (radius < outer)]) / centre)
        for inner, outer in pairwise(RINGS_PX)
    ]
    return Light(
        measure_noise_law(frames, pairs), _fit_law(over_space), tuple(by_distance),
        float(np.median(known)) if known else float("nan"), tuple(rings), float(np.mean(saturated)),
    )  # fmt: skip


def light_at_one_metre(frame: DepthFrame) -> Array:
    """Compute IR r^2 / cos, (H, W) counts m^2; NaN off smooth surfaces and for saturation."""
    if frame.infrared is None:
        return np.full(frame.measured_mm.shape, np.nan)
    s = surfaces(frame)
    away = np.sqrt(1.0 + (frame.rays.astype(np.float64) ** 2).sum(axis=-1))
    r_m = frame.measured_mm / MM_PER_M * away
    known = s.smooth & lit(frame) & (s.cosine > _LEAST_COSINE)
    return np.where(known, frame.infrared * r_m**2 / np.where(known, s.cosine, 1.0), np.nan)


def measure_noise_law(frames: Sequence[DepthFrame], pairs: Sequence[tuple[int, int]]) -> NoiseLaw:
    """Fit the noise law to static pairs; NaN for fewer than three classes of infrared."""
    parts = []
    for first, second in pairs:
        a, b = frames[first], frames[second]
        if a.infrared is None or b.infrared is None:
            continue
        used = lit(a) & lit(b)
        mean = 0.5 * (a.infrared.astype(np.float64) + b.infrared)
        quantum = (a.step_mm**2 + b.step_mm**2) / 24.0
        parts.append((mean, np.where(used, pair_noise(a, b) ** 2 - quantum, np.nan)))
    return _fit_law(parts)


def _brightest(values: Array) -> float:
    return float(np.percentile(values, _BRIGHTEST)) if values.size >= _LEAST_PIXELS else np.nan


def _fit_law(parts: Sequence[tuple[Array, Array]]) -> NoiseLaw:
    """Fit both terms, >= 0, to (infrared, squared noise) by the relative error of each class."""
    infrared, squares = (
        np.concatenate([np.zeros(0), *(part[k][np.isfinite(part[1])] for part in parts)])
        for k in (0, 1)
    )
    number = np.searchsorted(_CLASSES, infrared)
    rows = []
    for k in range(1, len(_CLASSES)):
        own, values = infrared[number == k], squares[number == k]
        if own.size >= _LEAST_PIXELS:
            # Without the largest percent, since the pixels of an edge weigh as much as 100 others.
            kept = values <= np.percentile(values, 99.0)
            variance = max(float(values[kept].mean()), 1e-6) * _UNTRIMMED
            rows.append((float(own.mean()), variance**0.5, int(own.size)))
    if len(rows) < 3:
        return NoiseLaw(float("nan"), float("nan"), tuple(rows))
    ir, sigma = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    design = np.column_stack([np.ones_like(ir), (_COUNTS / ir) ** 2]) / sigma[:, None] ** 2
    floor2, slope2 = _not_negative(design, np.ones_like(ir))
    return NoiseLaw(floor2**0.5, _COUNTS * slope2**0.5, tuple(rows))


def _not_negative(design: Array, target: Array) -> tuple[float, float]:
    both = np.linalg.lstsq(design, target, rcond=None)[0]
    if (both >= 0).all():
        return float(both[0]), float(both[1])
    singles = [max(float(c @ target / (c @ c)), 0.0) for c in design.T]
    errors = [((c * x - target) ** 2).sum() for c, x in zip(design.T, singles, strict=True)]
    return (singles[0], 0.0) if errors[0] <= errors[1] else (0.0, singles[1])
