"""Fit the wiggling of a camera: the error of depth that repeats with distance.

It needs distances at which the truth is known up to a few numbers: one large plane seen at a
slant, or walls at several distances that belong to one plane, such as a floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.fit.recording_statistics import RecordingStatistics
from glsim.geometry.camera import Intrinsics
from glsim.validate.published_curves import FREQUENCIES_MHZ, FUSION_MM_PER_RAD

Array = NDArray[np.float64]

#: Half a wavelength at 1 MHz, mm: speed of light / 2.
_HALF_WAVE_MM_MHZ = 149_896.229

#: Harmonics that three taps alias to 3 and 6 cycles per half wave.
_CYCLES = {2: 3, 5: 6}

#: Frequencies, MHz, that are fitted: at 16 MHz a cycle is 3.1 m, which no plane of a room covers.
FITTED_MHZ = tuple(f for f in FREQUENCIES_MHZ if f > 16)

#: The plane must span this range of distances, mm: the longest period that is fitted, 625 mm.
_LEAST_SPAN_MM = 650.0
_LEAST_PIXELS = 5000
_INLIER_MM = 12.0
_TRIALS = 200


@dataclass(frozen=True, eq=False)
class Wiggling:
    """Harmonics of the correlation, as libfreenect2's fusion shows them in depth.

    amplitude: harmonic -> size relative to the fundamental, mean over FITTED_MHZ. phase_rad:
    harmonic -> (len(FITTED_MHZ),) phases: a harmonic of size h and phase p moves depth by
    -110.5 mm h sin(c - p), c = 3 (second) or 6 (fifth) times the phase of the light. error:
    standard error of the sizes. span_mm: nearest and farthest point of the plane.
    """

    amplitude: dict[int, float]
    phase_rad: dict[int, Array]
    error: dict[int, float]
    span_mm: tuple[float, float]

    def known(self, harmonic: int) -> bool:
        """Whether the recording shows this harmonic: at least four standard errors."""
        return self.amplitude[harmonic] >= 4.0 * self.error[harmonic]


def fit_wiggling(statistics: RecordingStatistics, image: Intrinsics) -> Wiggling | None:
    """Fit the harmonics to the largest plane; None if it spans too little distance.

    The frames must be free of distortion, which bends a plane by more than harmonics do.
    """
    flat = image.rays().astype(np.float64)
    usable = statistics.smooth & np.isfinite(statistics.mean_mm)
    depth, x, y = statistics.mean_mm[usable], flat[..., 0][usable], flat[..., 1][usable]
    if len(depth) < _LEAST_PIXELS:
        return None
    design = np.column_stack([np.ones_like(x), x, y])
    inside = _largest_plane(design, depth)
    if inside.sum() < _LEAST_PIXELS:
        return None
    design, depth, x, y = design[inside], depth[inside], x[inside], y[inside]
    stretch = np.sqrt(1.0 + x**2 + y**2)
    near, far = (float(np.quantile(depth * stretch, q)) for q in (0.01, 0.99))
    if far - near < _LEAST_SPAN_MM:
        return None
    # An error e along the ray moves inverse depth by -e / (stretch depth^2).
    cycles = [n * f for n in _CYCLES.values() for f in FITTED_MHZ]
    angle = 2 * np.pi * (depth * stretch)[:, None] * np.array(cycles) / _HALF_WAVE_MM_MHZ
    moved = 1000.0 / (stretch * depth**2)
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1) * moved[:, None]
    weight = 1.0 / moved[:, None]
    columns = weight * np.column_stack([design, waves])
    target = weight[:, 0] * 1000.0 / depth
    fit = np.linalg.lstsq(columns, target, rcond=None)[0]
    left = target - columns @ fit
    # Errors are alike over the filter's 3 x 3 pixels and along rows and columns of the pattern.
    variance = 9.0 * float((left**2).mean()) * np.linalg.pinv(columns.T @ columns).diagonal()
    amplitude: dict[int, float] = {}
    phase: dict[int, Array] = {}
    error: dict[int, float] = {}
    for number, harmonic in enumerate(_CYCLES):
        own = 3 + number * len(FITTED_MHZ) + np.arange(len(FITTED_MHZ))
        # Inverse depth falls where depth grows.
        a, b = -fit[own], -fit[own + len(cycles)]
        size = np.hypot(a, b)  # mm: a cos c + b sin c = -size sin(c - phase)
        amplitude[harmonic] = float(size.mean()) / FUSION_MM_PER_RAD
        phase[harmonic] = np.arctan2(a, -b)
        own_error = np.sqrt(0.5 * (variance[own] + variance[own + len(cycles)]))
        error[harmonic] = float(own_error.mean()) / FUSION_MM_PER_RAD
    return Wiggling(amplitude, phase, error, (near, far))


def _largest_plane(design: Array, depth_mm: Array) -> NDArray[np.bool_]:
    """Find the pixels of the plane that holds most of them, by random triples and two refits."""
    rng = np.random.default_rng(0)  # the same file gives the same fit
    some = rng.permutation(len(depth_mm))[:4000]
    best: Array = np.zeros(3)
    most = -1
    for _ in range(_TRIALS):
        chosen = rng.choice(some, 3, replace=False)
        try:
            plane = np.linalg.solve(design[chosen], 1000.0 / depth_mm[chosen])
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
        columns, target = weight[:, None] * design[inside], weight * 1000.0 / depth_mm[inside]
        best = np.asarray(np.linalg.lstsq(columns, target, rcond=None)[0], np.float64)
    return _near_plane(design, depth_mm, best)


def _near_plane(design: Array, depth_mm: Array, plane: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(design @ plane * depth_mm - 1000.0) * depth_mm < 1000.0 * _INLIER_MM)
