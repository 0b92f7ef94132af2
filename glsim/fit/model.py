"""From the noise of a recording to the numbers of a sensor: amplitude, floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.camera import Intrinsics
from glsim.fit.statistics import Statistics
from glsim.validate.curves import white_sigma_mm

Array = NDArray[np.float64]

#: Noise over distance is averaged in so many classes of equal light.
_CLASSES = 40
_AMPLITUDES = np.geomspace(2.0, 20_000.0, 1201)

#: Normals are differences over so many pixels to both sides.
_LAG_PX = 4

#: Cosine of the most slanted surface that is looked at.
_LEAST_FACING = 0.5

#: Below this amplitude phases are no longer Gaussian, and noise grows faster than its law.
_LEAST_AMPLITUDE = 15.0

#: What libfreenect2's 3 x 3 filter gains, and the variance of rounding a tap to whole LSB.
_FILTER_GAIN = 2.99
_TAP_ROUNDING_LSB2 = 1.0 / 12.0


@dataclass(frozen=True, eq=False)
class Model:
    """sigma^2 = floor^2 + (white(a) cosine)^2 + unit^2 / 12, a = amplitude * light.

    The noise of the light is along the ray; cosine, of the ray to the axis, brings it to depth.

    amplitude: of a white wall at 1 m (libfreenect2's infrared units), and its standard error as a
    share; infinite if the recording does not tell. light, sigma_mm: (N,) classes of pixels, the
    light relative to a facing wall at 1 m.
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


def fit_model(
    found: Statistics,
    image: Intrinsics,
    albedo: float,
    unit_mm: float,
    vignetting: float,
    emitter_m: tuple[float, float, float],
) -> Model:
    """Amplitude and floor by weighted least squares over classes of equal light.

    albedo: of the scene, relative to a white wall. vignetting: power of the cosine to the axis by
    which the image darkens. emitter_m: where the light comes from, camera frame.
    """
    cosine = 1.0 / np.linalg.norm(_rays(image), axis=-1)
    light = albedo * _light(found.mean_mm, image, vignetting, emitter_m)
    used = found.smooth & np.isfinite(light) & (light > 0)
    x, squared, variance, weight = _classes(
        light[used], cosine[used] ** 2, found.variance_mm2[used], found.frames
    )
    rounding = unit_mm**2 / 12.0
    best, error, floor = _search(x, squared, variance - rounding, weight)
    strong = best * x >= _LEAST_AMPLITUDE
    if 3 <= strong.sum() < len(x):
        best, error, floor = _search(
            *(column[strong] for column in (x, squared, variance - rounding, weight))
        )
    return Model(best, error, floor, x, np.sqrt(variance))


def _search(
    light: Array, squared: Array, variance: Array, weight: Array
) -> tuple[float, float, float]:
    """The amplitude of least misfit, its standard error as a share, and the floor with it."""
    misfit, floors = np.empty(len(_AMPLITUDES)), np.empty(len(_AMPLITUDES))
    for number, amplitude in enumerate(_AMPLITUDES):
        white = squared * white_sigma_mm(amplitude * light, _FILTER_GAIN, _TAP_ROUNDING_LSB2) ** 2
        floors[number] = max(float(np.average(variance - white, weights=weight)), 0.0)
        misfit[number] = float((weight * (variance - white - floors[number]) ** 2).sum())
    best = int(misfit.argmin())
    # One standard error is where the misfit has risen by what a class is off on average.
    spare = len(light) - 2
    rise = max(misfit[best] / spare, 1.0) if spare > 0 else np.inf
    good = np.flatnonzero(misfit <= misfit[best] + rise)
    step = float(np.log(_AMPLITUDES[1] / _AMPLITUDES[0]))
    error = 0.5 * max(float(np.log(_AMPLITUDES[good[-1]] / _AMPLITUDES[good[0]])), step)
    if good[0] == 0 or good[-1] == len(_AMPLITUDES) - 1:
        error = float("inf")
    return float(_AMPLITUDES[best]), error, float(np.sqrt(floors[best]))


def _rays(image: Intrinsics) -> Array:
    """(H, W, 3) rays with z = 1."""
    flat = image.rays().astype(np.float64)
    return np.concatenate([flat, np.ones((*flat.shape[:2], 1))], axis=-1)


def _light(
    mean_mm: Array, image: Intrinsics, vignetting: float, emitter_m: tuple[float, float, float]
) -> Array:
    """(H, W) light of each pixel relative to a facing wall at 1 m.

    NaN without neighbours, and on slanted surfaces, where noise has more causes.
    """
    rays = _rays(image)
    points = rays * mean_mm[..., None] / 1000.0
    along, down = np.full(points.shape, np.nan), np.full(points.shape, np.nan)
    along[:, _LAG_PX:-_LAG_PX] = points[:, 2 * _LAG_PX :] - points[:, : -2 * _LAG_PX]
    down[_LAG_PX:-_LAG_PX] = points[2 * _LAG_PX :] - points[: -2 * _LAG_PX]
    normal = np.cross(down, along)
    from_emitter = points - np.asarray(emitter_m)
    way = np.linalg.norm(from_emitter, axis=-1)
    length = way * np.linalg.norm(normal, axis=-1)
    facing = np.abs((normal * from_emitter).sum(axis=-1)) / np.where(length > 0, length, np.nan)
    facing[~(facing > _LEAST_FACING)] = np.nan
    stretch = np.linalg.norm(rays, axis=-1)
    return np.asarray(facing / np.where(way > 0, way, np.nan) ** 2 * stretch**-vignetting)


def _classes(
    light: Array, squared: Array, variance: Array, frames: int
) -> tuple[Array, Array, Array, Array]:
    """Mean light, mean squared cosine, mean variance and weight of classes of equal light."""
    edges = np.geomspace(light.min() * 0.999, light.max() * 1.001, _CLASSES + 1)
    which = np.digitize(light, edges) - 1
    rows = []
    for k in range(_CLASSES):
        own = variance[which == k]
        if own.size < 50:
            continue
        # Pixels of other stuff or at hidden edges are far noisier than most.
        own_light, own_squared = light[which == k], squared[which == k]
        kept = own <= 5.0 * np.median(own)
        mean = float(own[kept].mean())
        # Nine neighbours share their noise: about two ninths as many independent samples.
        samples = kept.sum() * max(frames - 1, 1) * 0.22
        weight = samples / max(2.0 * mean**2, 1e-12)
        rows.append((own_light[kept].mean(), own_squared[kept].mean(), mean, weight))
    return tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]
