"""Fit the noise model of a time-of-flight camera to a recording: amplitude and floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.fit.recording_statistics import RecordingStatistics
from glsim.geometry.camera import Intrinsics
from glsim.validate.published_curves import white_sigma_mm

Array = NDArray[np.float64]

#: Number of classes of equal light in which noise is averaged.
_CLASSES = 40
_AMPLITUDES = np.geomspace(2.0, 20_000.0, 1201)

#: Normals are computed from neighbours this many pixels away on both sides.
_LAG_PX = 4

#: Cosine between normal and light of the most slanted surface that is used.
_LEAST_FACING = 0.5

#: Below this amplitude phases are no longer Gaussian, and noise grows faster than the model says.
_LEAST_AMPLITUDE = 15.0

#: Factor by which libfreenect2's 3 x 3 filter reduces noise; variance of rounding a tap to 1 LSB.
_FILTER_GAIN = 2.99
_TAP_ROUNDING_LSB2 = 1.0 / 12.0


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Noise of depth: sigma^2 = floor^2 + (white(a) cosine)^2 + unit^2 / 12, a = amplitude * light.

    The noise of the light, white(a), is along the ray; the cosine between ray and axis projects it
    to depth.

    amplitude: that of a white wall at 1 m (libfreenect2's infrared units). amplitude_error: its
    standard error as a share; infinite if the recording does not determine it. light, sigma_mm:
    (N,) light of classes of pixels, relative to a facing wall at 1 m, and their noise.
    """

    amplitude: float
    amplitude_error: float
    floor_mm: float
    light: Array
    sigma_mm: Array

    @property
    def knows_amplitude(self) -> bool:
        """Whether the recording determines the amplitude."""
        return self.amplitude_error < 0.3


def fit_noise_model(
    statistics: RecordingStatistics,
    image: Intrinsics,
    albedo: float,
    unit_mm: float,
    vignetting: float,
    emitter_m: tuple[float, float, float],
) -> NoiseModel:
    """Fit amplitude and floor by weighted least squares over classes of equal light.

    albedo: of the scene, relative to a white wall. unit_mm: step of the depth files. vignetting:
    power of the cosine to the axis by which the image darkens. emitter_m: position of the emitter
    in the camera frame.
    """
    cosine = 1.0 / np.linalg.norm(_rays(image), axis=-1)
    light = albedo * _light(statistics.mean_mm, image, vignetting, emitter_m)
    used = statistics.smooth & np.isfinite(light) & (light > 0)
    x, squared, variance, weight = _classes(
        light[used], cosine[used] ** 2, statistics.variance_mm2[used], statistics.frames
    )
    rounding = unit_mm**2 / 12.0
    best, error, floor = _search(x, squared, variance - rounding, weight)
    strong = best * x >= _LEAST_AMPLITUDE
    if 3 <= strong.sum() < len(x):
        best, error, floor = _search(
            *(column[strong] for column in (x, squared, variance - rounding, weight))
        )
    return NoiseModel(best, error, floor, x, np.sqrt(variance))


def _search(
    light: Array, squared: Array, variance: Array, weight: Array
) -> tuple[float, float, float]:
    """Return the amplitude of least misfit, its standard error as a share, and its floor, mm."""
    misfit, floors = np.empty(len(_AMPLITUDES)), np.empty(len(_AMPLITUDES))
    for number, amplitude in enumerate(_AMPLITUDES):
        white = squared * white_sigma_mm(amplitude * light, _FILTER_GAIN, _TAP_ROUNDING_LSB2) ** 2
        floors[number] = max(float(np.average(variance - white, weights=weight)), 0.0)
        misfit[number] = float((weight * (variance - white - floors[number]) ** 2).sum())
    best = int(misfit.argmin())
    # The standard error ends where the misfit has risen by the mean misfit of a class.
    freedom = len(light) - 2
    rise = max(misfit[best] / freedom, 1.0) if freedom > 0 else np.inf
    good = np.flatnonzero(misfit <= misfit[best] + rise)
    step = float(np.log(_AMPLITUDES[1] / _AMPLITUDES[0]))
    error = 0.5 * max(float(np.log(_AMPLITUDES[good[-1]] / _AMPLITUDES[good[0]])), step)
    if good[0] == 0 or good[-1] == len(_AMPLITUDES) - 1:
        error = float("inf")
    return float(_AMPLITUDES[best]), error, float(np.sqrt(floors[best]))


def _rays(image: Intrinsics) -> Array:
    """Return the (H, W, 3) rays of the pixels with z = 1."""
    flat = image.rays().astype(np.float64)
    return np.concatenate([flat, np.ones((*flat.shape[:2], 1))], axis=-1)


def _light(
    mean_mm: Array, image: Intrinsics, vignetting: float, emitter_m: tuple[float, float, float]
) -> Array:
    """Compute the (H, W) light of each pixel relative to a facing wall at 1 m.

    NaN where neighbours are missing, and on slanted surfaces, where noise has other causes too.
    """
    rays = _rays(image)
    points = rays * mean_mm[..., None] / 1000.0
    along, down = np.full(points.shape, np.nan), np.full(points.shape, np.nan)
    along[:, _LAG_PX:-_LAG_PX] = points[:, 2 * _LAG_PX :] - points[:, : -2 * _LAG_PX]
    down[_LAG_PX:-_LAG_PX] = points[2 * _LAG_PX :] - points[: -2 * _LAG_PX]
    normal = np.cross(down, along)
    from_emitter = points - np.asarray(emitter_m)
    distance = np.linalg.norm(from_emitter, axis=-1)
    length = distance * np.linalg.norm(normal, axis=-1)
    facing = np.abs((normal * from_emitter).sum(axis=-1)) / np.where(length > 0, length, np.nan)
    facing[~(facing > _LEAST_FACING)] = np.nan
    stretch = np.linalg.norm(rays, axis=-1)
    distance = np.where(distance > 0, distance, np.nan)
    return np.asarray(facing / distance**2 * stretch**-vignetting)


def _classes(
    light: Array, squared: Array, variance: Array, frames: int
) -> tuple[Array, Array, Array, Array]:
    """Average classes of equal light; each (N,): light, squared cosine, variance, weight."""
    edges = np.geomspace(light.min() * 0.999, light.max() * 1.001, _CLASSES + 1)
    which = np.digitize(light, edges) - 1
    rows = []
    for k in range(_CLASSES):
        own = variance[which == k]
        if own.size < 50:
            continue
        # Pixels of other materials or at hidden edges are much noisier than most.
        own_light, own_squared = light[which == k], squared[which == k]
        kept = own <= 5.0 * np.median(own)
        mean = float(own[kept].mean())
        # Nine neighbours share their noise: independent samples are about two ninths (0.22).
        samples = kept.sum() * max(frames - 1, 1) * 0.22
        weight = samples / max(2.0 * mean**2, 1e-12)
        rows.append((own_light[kept].mean(), own_squared[kept].mean(), mean, weight))
    return tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]
