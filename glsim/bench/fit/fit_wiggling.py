"""Fit of a camera's wiggling: a depth error that is periodic in distance.

Planes are fitted to the recording; a residual with the period of a harmonic is wiggling. The planes
must together cover 0.65 m of distance along the rays, without lens distortion: a slanted wall, a
floor, or several walls. A longer range makes the error smaller.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.bench.fit.recording_statistics import RecordingStatistics
from glsim.core.array_types import Array
from glsim.core.camera import Intrinsics
from glsim.core.units import MM_PER_M
from glsim.sensors.kinect_v2 import FREQUENCIES_MHZ, FUSION_MM_PER_RAD
from glsim.sensors.wiggling import CYCLES, Wave

#: Half a wavelength at 1 MHz, mm: speed of light / 2.
_HALF_WAVE_MM_MHZ = 149_896.229
#: Frequencies of the result, MHz. A wave at 16 MHz has a cycle of 3.1 m, longer than the planes of
#: a room. It is fitted with a prior of the usual size, so that it does not bias the other waves.
FITTED_MHZ = tuple(f for f in FREQUENCIES_MHZ if f > 16)
#: Number of fitted waves, and the frequency of each coefficient: cosines, then sines.
_WAVES = len(CYCLES) * len(FREQUENCIES_MHZ)
_MHZ_OF = 2 * len(CYCLES) * FREQUENCIES_MHZ
#: Typical amplitude of a wave, mm, measured on a Kinect V2.
_USUAL_MM = 1.5
#: Side of an image tile that the jackknife leaves out, px. The value was chosen, not measured.
_TILE_PX = 64
#: Smallest range of distances of the planes, mm; the longest period of the result is 625 mm.
_LEAST_SPAN_MM = 650.0
_LEAST_PIXELS = 5000
#: Largest number of planes. Chosen above the number in a room; the search takes 0.1 s per plane.
_MOST_PLANES = 8
_STEP_MM = 10.0
_INLIER_MM = 12.0
_TRIALS = 200


@dataclass(frozen=True, eq=False)
class Wiggling:
    """Harmonics of the correlation, as they appear in depth after libfreenect2's fusion.

    A harmonic of size h and phase p moves depth by -110.5 mm h sin(c - p), with c = 3 (second) or 6
    (fifth) times the phase of the light.

    Attributes:
        amplitude: harmonic -> its size relative to the fundamental wave, mean over FITTED_MHZ.
        phase_rad: harmonic -> (len(FITTED_MHZ),) phases.
        error: harmonic -> standard error of the size.
        sizes: harmonic -> (len(FITTED_MHZ),) sizes.
    """

    amplitude: dict[int, float]
    phase_rad: dict[int, Array]
    error: dict[int, float]
    sizes: dict[int, Array]

    def known(self, harmonic: int) -> bool:
        """Whether the harmonic is significant: at least four standard errors in size."""
        return self.amplitude[harmonic] >= 4.0 * self.error[harmonic]

    def waves(self) -> tuple[Wave, ...]:
        """Return the waves of the significant harmonics for a sensor file."""
        return tuple(
            Wave(
                harmonic=2 if harmonic == 2 else 5,
                modulation_mhz=mhz,
                size=float(f"{min(size, 0.2):.5g}"),
                phase_deg=float(f"{math.degrees(phase):.5g}"),
            )
            for harmonic in self.amplitude
            if self.known(harmonic)
            for mhz, size, phase in zip(
                FITTED_MHZ, self.sizes[harmonic], self.phase_rad[harmonic], strict=True
            )
        )


def fit_wiggling(
    statistics: RecordingStatistics, image: Intrinsics,
    emitter_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Wiggling | None:  # fmt: skip
    """Fit the harmonics to all planes of a recording without lens distortion, which bends planes.

    ``emitter_m``: (x, y, z) of the emitter in the camera frame. Returns None if the planes cover
    too short a range of distances along the rays.
    """
    flat = image.rays().astype(np.float64)
    usable = statistics.smooth & np.isfinite(statistics.mean_mm)
    depth, x, y = statistics.mean_mm[usable], flat[..., 0][usable], flat[..., 1][usable]
    design = np.column_stack([np.ones_like(x), x, y])
    planes = _planes(design, depth)
    points = depth[:, None] * np.column_stack([x, y, np.ones_like(x)])
    back = np.linalg.norm(points, axis=1)
    # Half the way of the light, from the emitter and back: the error is periodic in its phase.
    distance = 0.5 * (back + np.linalg.norm(points - MM_PER_M * np.asarray(emitter_m), axis=1))
    span = _covered_mm([distance[inside] for inside in planes])
    if span < _LEAST_SPAN_MM:
        return None
    tile = np.flatnonzero(usable)
    tile = tile // image.width // _TILE_PX * image.width + tile % image.width // _TILE_PX
    # An error along the ray moves inverse depth, 1 / m, by minus the error over this weight.
    weight = depth * back / MM_PER_M
    pixels = (design, depth, distance, weight, tile)
    fit, error_mm = _fit_waves([tuple(values[inside] for values in pixels) for inside in planes])
    wiggling = Wiggling({}, {}, {}, {})
    for number, harmonic in enumerate(CYCLES):
        first = number * len(FREQUENCIES_MHZ)
        cosines = first + np.array([FREQUENCIES_MHZ.index(f) for f in FITTED_MHZ])
        # Inverse depth falls where depth grows.
        a, b = -fit[cosines], -fit[cosines + _WAVES]
        size = np.hypot(a, b)  # mm: a cos c + b sin c = -size sin(c - phase)
        wiggling.sizes[harmonic] = size / FUSION_MM_PER_RAD
        wiggling.amplitude[harmonic] = float(wiggling.sizes[harmonic].mean())
        wiggling.phase_rad[harmonic] = np.arctan2(a, -b)
        squares = 0.5 * (error_mm[cosines] ** 2 + error_mm[cosines + _WAVES] ** 2)
        wiggling.error[harmonic] = float(np.sqrt(squares.mean())) / FUSION_MM_PER_RAD
    return wiggling


def _fit_waves(planes: Sequence[tuple[NDArray[Any], ...]]) -> tuple[Array, Array]:
    """Fit the waves to the residuals of planes.

    A plane has, for N pixels: design (N, 3), the columns 1, x/z and y/z; and (N,) depth, mm, half
    the path of the light, mm, weight, and number of the tile. Returns coefficients, cosines then
    sines, mm, and their standard errors: the larger of the error from noise, which is shared by the
    filter's 3 x 3 pixels, and of a jackknife over tiles, which includes bends of the planes.
    """
    squares, products = [], []
    left, pixels = 0.0, 0
    cycles = np.array([n * f for n in CYCLES.values() for f in FREQUENCIES_MHZ])
    for design, depth_mm, distance_mm, weight, tile in planes:
        angle = 2 * np.pi * distance_mm[:, None] * cycles / _HALF_WAVE_MM_MHZ
        waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
        target = weight * MM_PER_M / depth_mm
        basis = np.linalg.qr(weight[:, None] * design)[0]
        waves = waves - basis @ (basis.T @ waves)
        target = target - basis @ (basis.T @ target)
        for number in np.unique(tile):
            inside = tile == number
            squares.append(waves[inside].T @ waves[inside])
            products.append(waves[inside].T @ target[inside])
        left += float((target**2).sum())
        pixels += len(target)
    noise = 9.0 * left / pixels
    # The prior keeps waves of the other frequencies near the typical amplitude.
    prior = np.where(np.isin(_MHZ_OF, FITTED_MHZ), 0.0, noise / _USUAL_MM**2)
    whole, target = np.sum(squares, axis=0) + np.diag(prior), np.sum(products, axis=0)
    fit = np.linalg.lstsq(whole, target, rcond=None)[0]
    by_noise = np.sqrt(noise * np.linalg.pinv(whole).diagonal())
    fits = [
        np.linalg.lstsq(whole - s, target - p, rcond=None)[0]
        for s, p in zip(squares, products, strict=True)
    ]
    by_tiles = np.sqrt((len(fits) - 1) * np.var(fits, axis=0))
    return np.asarray(fit), np.asarray(np.maximum(by_noise, by_tiles))


def _planes(design: Array, depth_mm: Array) -> list[NDArray[np.intp]]:
    """Find up to _MOST_PLANES planes, largest first; return the pixel indices of each plane."""
    rest = np.arange(len(depth_mm))
    planes: list[NDArray[np.intp]] = []
    while len(planes) < _MOST_PLANES and len(rest) >= _LEAST_PIXELS:
        inside = _largest_plane(design[rest], depth_mm[rest])
        if inside.sum() < _LEAST_PIXELS:
            break
        planes.append(rest[inside])
        rest = rest[~inside]
    return planes


def _covered_mm(distances: list[Array]) -> float:
    """Compute the range of distances that the planes cover together, mm, without overlaps."""
    steps = np.arange(0.0, 20_000.0, _STEP_MM)
    covered = np.zeros(len(steps), np.bool_)
    for plane_mm in distances:
        near, far = np.quantile(plane_mm, (0.01, 0.99))
        covered |= (steps >= near) & (steps < far)
    return float(covered.sum()) * _STEP_MM


def _largest_plane(design: Array, depth_mm: Array) -> NDArray[np.bool_]:
    """Find the pixels of the largest plane by random triples of points and two refits."""
    rng = np.random.default_rng(0)  # the same file gives the same fit
    some = rng.permutation(len(depth_mm))[:4000]
    best: Array = np.zeros(3)
    most = -1
    for _ in range(_TRIALS):
        chosen = rng.choice(some, 3, replace=False)
        try:
            plane = np.linalg.solve(design[chosen], MM_PER_M / depth_mm[chosen])
        except np.linalg.LinAlgError:
            continue
        count = int(_near_plane(design[some], depth_mm[some], plane).sum())
        if count > most:
            best, most = plane, count
    for _ in range(2):
        inside = _near_plane(design, depth_mm, best)
        if inside.sum() < 3:
            return inside
        weight = depth_mm[inside] ** 2
        columns, target = weight[:, None] * design[inside], weight * MM_PER_M / depth_mm[inside]
        best = np.asarray(np.linalg.lstsq(columns, target, rcond=None)[0], np.float64)
    return _near_plane(design, depth_mm, best)


def _near_plane(design: Array, depth_mm: Array, plane: Array) -> NDArray[np.bool_]:
    beside_mm = np.abs(design @ plane * depth_mm / MM_PER_M - 1) * depth_mm
    return np.asarray(beside_mm < _INLIER_MM)
