"""Fit of an image-matching sensor to a recording, by simulating planes at equal distances.

The base sensor, with the recording's focal length, baseline and unit, captures tilted planes at the
distances of the recording. The same function measures the recording and the simulated planes. Each
measure is fitted by one parameter:

    noise from frame to frame    stereo_exposure.speckle_sigma, the noise of the laser's light
    correlation between pixels   match_stereo.support_px, the side of the averaged region; then the
                                 noise from frame to frame again
    static share                 match_stereo.device_sigma_px, the device's own error
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from moderngl import Context

from glsim.bench import scenes
from glsim.bench.fit.fitted_sensor import FittedSensor, recording_camera, sensor_toml
from glsim.bench.modes import find_lattice, possible_modes
from glsim.core.array_types import Array
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.units import MM_PER_M
from glsim.data.recording import Recording
from glsim.gl.context import borrowed_context
from glsim.measures.disparity import (
    LEAST_TILES,
    TILE_PX,
    DisparityNoise,
    find_tiles,
    measure_disparity_noise,
    to_disparity,
)
from glsim.measures.lattice import Lattice
from glsim.noise.rig_checks import MATCHER
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.simulation.virtual_camera import VirtualCamera

#: Number of frames to measure. Chosen: 23 differences determine a tile's temporal noise to 3 %.
FRAMES = 24
#: Number of groups of tiles by distance; the fit simulates a plane for each group.
_GROUPS = 3


@dataclass(frozen=True)
class StereoStatistics:
    """Disparity noise and planes of one recording.

    Attributes:
        size: (width, height), px.
        unit_mm: step of the depth files.
        lattice: lattice of the depths; None: not found, and f B is the base sensor's.
        noise: noise of disparity, px.
        distances_mm: median distance of each of three groups of tiles, nearest first.
        slopes: median slope of each group, px of disparity per px; noise depends on it. A single
            tile also has a slope that noise causes.
    """

    frames: int
    size: tuple[int, int]
    unit_mm: float
    focal_baseline_px_mm: float
    lattice: Lattice | None
    noise: DisparityNoise
    distances_mm: tuple[float, ...]
    slopes: tuple[float, ...]


def measure_stereo(
    frames: Frames, lattice: Lattice | None, steps: float, focal_baseline_px_mm: float
) -> StereoStatistics:
    """Measure the disparity noise of a static recording.

    Raises DatasetError if no part of the scene is plane. ``steps`` of disparity per pixel and the
    lattice give f B; without a lattice it is ``focal_baseline_px_mm``, that of the base sensor.
    """
    unit = frames[0].step_mm or 1.0
    product = focal_baseline_px_mm if lattice is None else lattice.constant * unit / steps
    disparity = [to_disparity(f.measured_mm, product) for f in frames]
    pairs = list(pairwise(range(len(disparity))))
    noise = measure_disparity_noise(disparity, pairs)
    if noise.tiles < LEAST_TILES or not np.isfinite([noise.frame, noise.static]).all():
        raise DatasetError(
            f"{frames.title}: only {noise.tiles} parts of 40x40 px are full of depth: record "
            "walls, a floor, a table, at several distances, and do not move"
        )
    tiles, half = find_tiles(disparity[0]), TILE_PX // 2
    parts = np.lib.stride_tricks.sliding_window_view(disparity[0], (TILE_PX, TILE_PX))
    parts = parts[tiles.top, tiles.left].reshape(-1, 2, half, 2, half)
    steps_px = [np.diff(np.nanmean(parts, axis=axes), axis=1) for axes in ((1, 2, 4), (2, 3, 4))]
    levels, slopes = tiles.level, np.concatenate(steps_px, axis=1) / half
    groups = np.array_split(np.argsort(-levels), _GROUPS)
    height, width = disparity[0].shape
    return StereoStatistics(
        len(disparity), (width, height), unit, product, lattice, noise,
        tuple(product / float(np.median(levels[group])) for group in groups),
        tuple(float(np.hypot(*np.median(slopes[group], axis=0))) for group in groups),
    )  # fmt: skip


#: Step of the search for the side of the averaged region, and its largest value, px.
_SUPPORT_STEP_PX, _MOST_SUPPORT_PX = 4, 25
#: Lags at which correlations are compared, as a slice of LAGS_PX: 1 to 8 px.
_LAGS = slice(0, 6)
#: Search for the value of a parameter: first value, largest value, number of rounds, and smallest
#: and largest factor of the squared value per round. Chosen: a round divides the error by about 3.
_FIRST, _MOST, _ROUNDS, _RATIO = 0.1, 0.8, 4, (0.1, 8.0)
#: A simulated plane: number of frames, albedo (as in the sheets of ``glsim validate``), and
#: steepest tilt, degrees.
_FRAMES, _ALBEDO, _MOST_TILT_DEG = 3, 0.6, 60.0
#: Stages that simulate the exposure: of two imagers, and of an imager with a projected pattern.
_EXPOSURES = ("stereo_exposure", "pattern_exposure")
#: Fitted parameters: the side of the averaged region, and the device's own error.
_SUPPORT, _DEVICE = f"{MATCHER}.support_px", f"{MATCHER}.device_sigma_px"


def _matcher_value(sensor: Sensor, name: str) -> float:
    stage = next(s for s in sensor.stages if s.spec.name == MATCHER)
    return stage.settings[name].bounds()[0]


def fit_stereo(
    recording: Recording, base: str, focal_px: float | None, part: slice
) -> FittedSensor:
    """Fit an image-matching sensor to a static recording.

    Args:
        recording: at least two frames of one view.
        focal_px: focal length of the recording. None: as the recording states; else the base's, or
            from the base's baseline.

    Raises ConfigError if the focal length is not known, or the frames are decimated or registered;
    DatasetError if the recording is not static, or shows no planes.
    """
    sensor = load_sensor(base)
    rig, steps = sensor.rig, _matcher_value(sensor, "subpixel_steps")
    frames = recording.read_static(FRAMES, part)
    product = MM_PER_M * rig.intrinsics.fx * rig.baseline_m
    lattice = find_lattice(frames)
    if focal_px is not None or recording.camera is not None:
        _check_grid(recording, sensor, focal_px, lattice)
    statistics = measure_stereo(frames, lattice, steps, product)
    other_px = statistics.focal_baseline_px_mm / rig.baseline_m / MM_PER_M
    image = recording_camera(statistics.size, recording.camera, rig.intrinsics, focal_px, other_px)
    named = str(Path(base).resolve()) if base.endswith(".toml") else base
    with TemporaryDirectory() as folder, borrowed_context(None) as context:
        fit = _Fit(statistics, named, sensor, image, Path(folder), context)
        exposure = next((s.name for s in sensor.stages if s.spec.name in _EXPOSURES), None)
        speckle = f"{exposure}.speckle_sigma"
        if exposure is not None:
            fit.solve(speckle, "frame")
        fit.support()
        if exposure is not None and fit.values[_SUPPORT] != fit.own_support:
            fit.notes.clear()
            fit.solve(speckle, "frame")
        fit.solve(_DEVICE, "static")
        lines = {"base": named, "at rest": frames.note} | _result_lines(
            statistics, fit.noise(), image, fit.baseline_m
        )
    comments = [
        f"Fitted by glsim fit to {statistics.frames} frames of {image.width}x{image.height}: "
        f"{recording.path}",
        *(f"{name}: {text}" for name, text in lines.items()),
        f"All other values are those of {sensor.name}.",
    ]
    return FittedSensor(fit.text(fit.values, comments), image, lines, tuple(fit.notes))


def _check_grid(
    recording: Recording, sensor: Sensor, focal_px: float | None, lattice: Lattice | None
) -> None:
    """Raise ConfigError if the stated focal length is that of decimated or registered frames."""
    try:
        mode = possible_modes(sensor, recording.read(1, focal_px), True, lattice)[0]
    except ConfigError:
        return  # another baseline: that is what a fit is for
    if mode.image is not mode.depth:
        raise ConfigError(
            f"{recording.path}: the frames are {mode.name}: a fit needs the depth camera's own "
            "frames, without alignment and decimation"
        )


class _Fit:
    """State of a fit: the values found so far, and their test on simulated planes."""

    def __init__(
        self,
        statistics: StereoStatistics,
        base: str,
        sensor: Sensor,
        image: Intrinsics,
        folder: Path,
        context: Context,
    ) -> None:
        self.statistics, self.base, self.sensor, self.image = statistics, base, sensor, image
        self.baseline_m = statistics.focal_baseline_px_mm / image.fx / MM_PER_M
        self.values = {f"{MATCHER}.depth_unit_mm": statistics.unit_mm}
        self.notes: list[str] = []
        self.own_support = int(_matcher_value(sensor, "support_px")) | 1
        self._folder, self._context, self._count = folder, context, 0

    def text(self, values: Mapping[str, float], comments: Sequence[str]) -> str:
        """Write the text of the sensor file: base sensor, rig and fitted parameters."""
        image, rig = self.image, self.sensor.rig
        scale = self.baseline_m / rig.baseline_m
        places = {"imager": rig.imagers_m, "emitter": [e.position_m for e in rig.emitters]}
        table = {
            "width": image.width,
            "height": image.height,
            "focal_px": [_rounded(image.fx), _rounded(image.fy)],
            "centre_px": [_rounded(image.cx), _rounded(image.cy)],
        } | {
            name: [{"position_m": [float(f"{scale * v:.7g}") for v in p]} for p in points]
            for name, points in places.items()
        }
        stages = {}
        for stage in self.sensor.stages:
            kinds = {f"{stage.name}.{key}": p.type for key, p in stage.spec.parameters.items()}
            fitted = {
                name.partition(".")[2]: int(v) if kinds[name] == "int" else _rounded(v)
                for name, v in values.items()
                if name in kinds
            }
            named = {} if stage.name == stage.spec.name else {"name": stage.name}
            if fitted:
                stages[stage.name] = {"use": stage.spec.name, **named, **fitted}
        title = f"fitted to a recording, from {self.sensor.name}"
        head = {"extends": self.base, "title": title}
        return sensor_toml(comments, head, table, list(stages.values()))

    def noise(self, name: str = "", value: float = 0.0) -> DisparityNoise:
        """Simulate planes with the values so far and one changed parameter; measure their noise."""
        file = self._folder / f"trial_{self._count}.toml"
        self._count += 1
        values = self.values | ({name: value} if name else {})
        file.write_text(self.text(values, ("a trial",)))
        camera = VirtualCamera(str(file), self._context)
        focal = camera.rig.intrinsics.fx
        product = MM_PER_M * focal * camera.rig.baseline_m
        disparity: list[Array] = []
        pairs: list[tuple[int, int]] = []
        for z_mm, slope in zip(self.statistics.distances_mm, self.statistics.slopes, strict=True):
            # Over a pixel, z / f wide, disparity changes by slope, depth by z^2 slope / (f B).
            steep = float(np.degrees(np.arctan(slope * z_mm * focal / product)))
            mesh = scenes.tilted(z_mm, min(steep, _MOST_TILT_DEG), _ALBEDO, half_mm=z_mm)
            shot = camera.capture(mesh, _FRAMES, None, scene=f"plane {z_mm:.0f}")
            first = len(disparity)
            disparity += list(to_disparity(np.nan_to_num(shot.measured_mm), product))
            pairs += [(first + a, first + b) for a, b in pairwise(range(_FRAMES))]
        return measure_disparity_noise(disparity, pairs)

    def support(self) -> None:
        """Choose the matching window that gives the recording's correlation of temporal noise.

        From the base's window, it tries larger, then smaller windows while the fit improves.
        """
        real = self.statistics.noise
        target = np.array([real.frame_rows[_LAGS], real.frame_columns[_LAGS]])

        def misfit(side: int) -> float:
            noise = self.noise(_SUPPORT, side)
            lags = np.array([noise.frame_rows[_LAGS], noise.frame_columns[_LAGS]])
            return float(np.nansum((lags - target) ** 2)) if np.isfinite(lags).any() else np.inf

        best = start = self.own_support
        least = misfit(best)
        for step in (_SUPPORT_STEP_PX, -_SUPPORT_STEP_PX):
            while 1 <= best + step <= _MOST_SUPPORT_PX and (next_ := misfit(best + step)) < least:
                best, least = best + step, next_
            if best != start:
                break
        self.values[_SUPPORT] = best

    def solve(self, name: str, measure: str) -> None:
        """Find the value of a parameter with which simulated noise equals the recording's noise.

        Model: the variance is a constant plus a multiple of the squared parameter. If no tile is
        full of depth, noise cannot be measured and counts as too large.
        """
        target = getattr(self.statistics.noise, measure)
        least = getattr(self.noise(name, 0.0), measure)
        value = 0.0 if least >= target else _FIRST
        for _ in range(_ROUNDS if value else 0):
            reached = getattr(self.noise(name, value), measure)
            grown = reached**2 - least**2 if np.isfinite(reached) else np.inf
            ratio = (target**2 - least**2) / max(grown, 1e-12)
            value = min(value * float(np.sqrt(np.clip(ratio, *_RATIO))), _MOST)
        if value in (0.0, _MOST):
            self.notes.append(
                f"{name} = {value:g}: {measure} noise of {least:.3f} px without it, the recording "
                f"has {target:.3f} px"
            )
        self.values[name] = round(value, 4)


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


def _result_lines(
    statistics: StereoStatistics, own: DisparityNoise, image: Intrinsics, baseline_m: float
) -> dict[str, str]:
    """Describe the results for the recording and for the fitted sensor: name -> text."""
    real, lattice = statistics.noise, statistics.lattice
    by = "the base sensor's: the depths are on no lattice that says it"
    if lattice is not None:
        by = f"depths are round({lattice.constant:,.0f} / n) units"
    places = ", ".join(f"{z / MM_PER_M:.2f}" for z in statistics.distances_mm)

    def pair(name: str) -> str:
        return f"{getattr(real, name):.3f} px (fitted sensor: {getattr(own, name):.3f})"

    def correlations(name: str) -> str:
        first, second = (
            ", ".join(f"{value:.2f}" for value in getattr(noise, name)[_LAGS])
            for noise in (real, own)
        )
        return f"{first} (fitted sensor: {second})"

    return {
        "focal length times baseline": f"{statistics.focal_baseline_px_mm:,.0f} px mm ({by}); "
        f"baseline {MM_PER_M * baseline_m:.2f} mm at {image.fx:.1f} px",
        "planes compared at": f"{places} m",
        "noise from frame to frame": pair("frame"),
        "share that stays": pair("static"),
        "residual of planes": pair("residual"),
        "correlation in time at 1, 2, 3, 4, 6, 8 px along rows": correlations("frame_rows"),
        "the same along columns": correlations("frame_columns"),
    }
