"""Fit of a time-of-flight camera's noise model to a recording: amplitude and noise floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from glsim.bench.fit.recording_statistics import RecordingStatistics
from glsim.core.array_types import Array
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.units import MM_PER_M
from glsim.measures.light import EVEN_PX, light_at_one_metre
from glsim.measures.measured_frame import lit, mean_frame, radius_px
from glsim.sensors.kinect_v2 import (
    COUNTS_PER_AMPLITUDE,
    TAP_READ_LSB2,
    TAP_SHOT_LSB,
    white_sigma_mm,
)

#: Number of classes of pixels with equal light, and smallest number of pixels in a class.
_CLASSES = 40
_LEAST_CLASS = 50
_AMPLITUDES = np.geomspace(2.0, 20_000.0, 1201)
#: A normal is computed from neighbours at this distance, px. The value was chosen, not measured.
_LAG_PX = 4
#: Smallest cosine of the angle between a surface's normal and the light that a fit uses.
_LEAST_FACING = 0.5
#: Smallest amplitude in a fit. Measured: below it, phase noise is not Gaussian as in the model.
_LEAST_AMPLITUDE = 15.0
#: Derived: factor by which libfreenect2's 3 x 3 filter reduces noise; a tap's rounding variance.
FILTER_GAIN = 2.99
_TAP_ROUNDING_LSB2 = 1.0 / 12.0
#: Smooth pixels above this quantile of light are bright surfaces.
_BRIGHT_SHARE = 0.95


class TapNoise(NamedTuple):
    """Noise of a tap: variance in the dark (LSB^2), and growth of the variance with light (LSB)."""

    read_variance: float = TAP_READ_LSB2
    shot_variance: float = TAP_SHOT_LSB


@dataclass(frozen=True)
class LightProfile:
    """Light as a function of t, the tangent of the angle to the optical axis; default: uniform.

    (tail + (1 - tail) exp(min(flat_to - t, 0) / fall_off)) cos^vignetting.
    """

    flat_to: float = 10.0
    fall_off: float = 1.0
    tail: float = 0.0
    vignetting: float = 0.0

    def share(self, tangent: Array) -> Array:
        """Compute the light relative to the optical axis, for tangents of any shape."""
        fall = np.exp(np.minimum(self.flat_to - tangent, 0.0) / self.fall_off)
        cosine = 1.0 / np.sqrt(1.0 + tangent**2)
        return np.asarray((self.tail + (1.0 - self.tail) * fall) * cosine**self.vignetting)


@dataclass(frozen=True)
class InfraredLaw:
    """Law of light and noise as functions of infrared counts.

    Attributes:
        gain: amplitude of a white wall at 1 m (libfreenect2's infrared units); NaN if no bright
            surface is near the image centre.
        floor_mm: part of the noise that depends neither on light nor on the taps.
        noise_error: relative standard error of the taps' noise; infinite for equal brightness.
        tap_scale: variance of the taps, divided by the variance of the base sensor's taps.
    """

    gain: float
    floor_mm: float
    noise_error: float
    tap_scale: float

    @property
    def knows_noise(self) -> bool:
        """Whether the recording determines the noise of the taps."""
        return self.noise_error < 0.3


def fit_infrared(
    statistics: RecordingStatistics, frames: Frames, albedo: float, taps: TapNoise
) -> InfraredLaw:
    """Fit the gain and the noise law to a recording with infrared.

    ``albedo``: reflectivity of the brightest surfaces, relative to white.
    """
    mean = mean_frame(frames)
    assert mean.infrared is not None
    usable = statistics.smooth & lit(mean)
    bright = light_at_one_metre(mean)[usable & (radius_px(mean) < EVEN_PX)]
    bright = bright[np.isfinite(bright)]
    gain = float("nan")
    if bright.size >= _LEAST_CLASS:
        gain = float(np.quantile(bright, _BRIGHT_SHARE)) / albedo / COUNTS_PER_AMPLITUDE
    nothing = InfraredLaw(gain, float("nan"), float("inf"), float("nan"))
    if usable.sum() < _LEAST_CLASS:
        return nothing
    squared = 1.0 / (_rays(frames.intrinsics) ** 2).sum(axis=-1)
    x, cosine2, variance, weight = _classes(
        mean.infrared[usable].astype(np.float64), squared[usable], statistics.variance_mm2[usable],
        statistics.frames,
    )  # fmt: skip
    strong = x >= COUNTS_PER_AMPLITUDE * _LEAST_AMPLITUDE
    x, cosine2, variance, weight = (c[strong] for c in (x, cosine2, variance, weight))
    if len(x) < 3:
        return nothing
    variance = variance - frames[0].step_mm ** 2 / 12.0
    amplitude = x / COUNTS_PER_AMPLITUDE
    shape = white_sigma_mm(amplitude, FILTER_GAIN, 0.0, *taps) ** 2
    rounding = white_sigma_mm(amplitude, FILTER_GAIN, _TAP_ROUNDING_LSB2, 0.0, 0.0) ** 2
    floor2, scale, error = _line(cosine2 * shape, variance - cosine2 * rounding, weight)
    relative = error / scale if scale > 0 else float("inf")
    return InfraredLaw(gain, float(np.sqrt(max(floor2, 0.0))), relative, scale)


def _line(x: Array, y: Array, weight: Array) -> tuple[float, float, float]:
    """Fit y = a + b x by robust weighted least squares; return a, b and the standard error of b."""
    design = np.column_stack([np.ones_like(x), x])
    robust = np.ones_like(x)
    for _ in range(5):
        root = np.sqrt(weight * robust)
        fit = np.linalg.lstsq(root[:, None] * design, root * y, rcond=None)[0]
        misfit = np.abs(y - design @ fit) * np.sqrt(weight)
        limit = 2.0 * max(1.4826 * float(np.median(misfit)), 1e-9)
        robust = np.minimum(1.0, limit / np.maximum(misfit, 1e-12))
    covariance = np.linalg.pinv((root[:, None] * design).T @ (root[:, None] * design))
    spread = float((weight * robust * (y - design @ fit) ** 2).sum()) / max(len(x) - 2, 1)
    return float(fit[0]), float(fit[1]), float(np.sqrt(covariance[1, 1] * max(spread, 1.0)))


@dataclass(frozen=True)
class NoiseModel:
    """Noise of depth: sigma^2 = floor^2 + (white(a) cosine)^2 + unit^2 / 12, a = amplitude * light.

    white(a) is the noise along a ray that light causes; the cosine of the angle between the ray and
    the optical axis projects it to depth.

    Attributes:
        amplitude: amplitude of a white wall at 1 m (libfreenect2's infrared units).
        amplitude_error: relative standard error of the amplitude; infinite = undetermined.
        floor_mm: part of the noise that does not depend on light.
    """

    amplitude: float
    amplitude_error: float
    floor_mm: float

    @property
    def knows_amplitude(self) -> bool:
        """Whether the recording determines the amplitude."""
        return self.amplitude_error < 0.3


def fit_noise_model(
    statistics: RecordingStatistics, image: Intrinsics, albedo: float, unit_mm: float,
    profile: LightProfile, emitter_m: tuple[float, float, float], taps: TapNoise,
) -> NoiseModel:  # fmt: skip
    """Fit amplitude and floor by weighted least squares over classes of equal light.

    ``albedo``: of the scene, relative to a white wall. ``unit_mm``: step of the depth files.
    """
    cosine = 1.0 / np.linalg.norm(_rays(image), axis=-1)
    light = albedo * facing_light(statistics.mean_mm, image, profile, emitter_m)
    used = statistics.smooth & np.isfinite(light) & (light > 0)
    x, squared, variance, weight = _classes(
        light[used], cosine[used] ** 2, statistics.variance_mm2[used], statistics.frames
    )
    columns = x, squared, variance - unit_mm**2 / 12.0, weight
    best, error, floor = _search(*columns, taps)
    strong = best * x >= _LEAST_AMPLITUDE
    if 3 <= strong.sum() < len(x):
        used_columns = x[strong], squared[strong], columns[2][strong], weight[strong]
        best, error, floor = _search(*used_columns, taps)
    return NoiseModel(best, error, floor)


def _search(
    light: Array, squared: Array, variance: Array, weight: Array, taps: TapNoise
) -> tuple[float, float, float]:
    """Find the amplitude with the smallest misfit; return it, its relative error, floor (mm)."""
    misfit, floors = np.empty(len(_AMPLITUDES)), np.empty(len(_AMPLITUDES))
    for number, amplitude in enumerate(_AMPLITUDES):
        sigma_mm = white_sigma_mm(amplitude * light, FILTER_GAIN, _TAP_ROUNDING_LSB2, *taps)
        white = squared * sigma_mm**2
        floors[number] = max(float(np.average(variance - white, weights=weight)), 0.0)
        misfit[number] = float((weight * (variance - white - floors[number]) ** 2).sum())
    best = int(misfit.argmin())
    # One standard error from the best amplitude, the misfit is larger by a class's mean misfit.
    freedom = len(light) - 2
    rise = max(misfit[best] / freedom, 1.0) if freedom > 0 else np.inf
    good = np.flatnonzero(misfit <= misfit[best] + rise)
    step = float(np.log(_AMPLITUDES[1] / _AMPLITUDES[0]))
    error = 0.5 * max(float(np.log(_AMPLITUDES[good[-1]] / _AMPLITUDES[good[0]])), step)
    if good[0] == 0 or good[-1] == len(_AMPLITUDES) - 1:
        error = float("inf")
    return float(_AMPLITUDES[best]), error, float(np.sqrt(floors[best]))


def _rays(image: Intrinsics) -> Array:
    """Compute the (H, W, 3) rays of the pixels, scaled to z = 1."""
    flat = image.rays().astype(np.float64)
    return np.concatenate([flat, np.ones((*flat.shape[:2], 1))], axis=-1)


def facing_light(
    mean_mm: Array, image: Intrinsics, profile: LightProfile, emitter_m: tuple[float, float, float]
) -> Array:
    """Compute the (H, W) light of each pixel relative to a frontal wall at 1 m.

    NaN where neighbours are missing, and on slanted surfaces, where noise has further causes.
    The emitter's position is in camera axes.
    """
    rays = _rays(image)
    points = rays * mean_mm[..., None] / MM_PER_M
    along, down = np.full(points.shape, np.nan), np.full(points.shape, np.nan)
    along[:, _LAG_PX:-_LAG_PX] = points[:, 2 * _LAG_PX :] - points[:, : -2 * _LAG_PX]
    down[_LAG_PX:-_LAG_PX] = points[2 * _LAG_PX :] - points[: -2 * _LAG_PX]
    normal = np.cross(down, along)
    from_emitter = points - np.asarray(emitter_m)
    distance = np.linalg.norm(from_emitter, axis=-1)
    length = distance * np.linalg.norm(normal, axis=-1)
    facing = np.abs((normal * from_emitter).sum(axis=-1)) / np.where(length > 0, length, np.nan)
    facing[~(facing > _LEAST_FACING)] = np.nan
    distance = np.where(distance > 0, distance, np.nan)
    return np.asarray(facing / distance**2 * profile.share(np.hypot(rays[..., 0], rays[..., 1])))


def _classes(
    light: Array, squared: Array, variance: Array, frames: int
) -> tuple[Array, Array, Array, Array]:
    """Average classes of equal light; return (N,) light, squared cosine, variance and weight."""
    edges = np.geomspace(light.min() * 0.999, light.max() * 1.001, _CLASSES + 1)
    which = np.digitize(light, edges) - 1
    rows = []
    for k in range(_CLASSES):
        light_k, squared_k, variance_k = (v[which == k] for v in (light, squared, variance))
        if variance_k.size < _LEAST_CLASS:
            continue
        # Outliers are other materials and hidden edges. The variance of few frames scatters by
        # sqrt(2 / degrees) of its mean, and its median is lower than its mean.
        degrees = max(frames - 1, 1)
        middle = (1.0 - 2.0 / (9.0 * degrees)) ** 3  # Wilson and Hilferty 1931
        limit = (1.0 + 6.0 * np.sqrt(2.0 / degrees)) / middle * np.median(variance_k)
        inliers = variance_k <= limit
        mean = float(variance_k[inliers].mean())
        # Nine neighbours share their noise: independent samples are about two ninths (0.22).
        weight = inliers.sum() * degrees * 0.22 / max(2.0 * mean**2, 1e-12)
        rows.append((light_k[inliers].mean(), squared_k[inliers].mean(), mean, weight))
    return tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]
