"""Fit of an image-matching sensor to a recording, by simulating planes at equal distances.

The base sensor, with the recording's focal length, baseline and unit, captures tilted planes at the
distances of the recording. The same function measures the recording and the simulated planes. Each
measure is fitted by one parameter, if it differs from the base's by two standard errors:

    noise from frame to frame                  stereo_exposure.speckle_sigma, of the laser's light
    noise that stays: correlation at 4 px      match_stereo.device_grain_px, its waves
    over that at 1 px
    1 - correlation at 1 px                    match_stereo.device_fine, share of its fine grains
    its size                                   match_stereo.device_sigma_px
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
    measure_blocks,
    to_disparity,
)
from glsim.measures.lattice import Lattice
from glsim.measures.stacks import jackknife_error
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
        noise: noise of disparity, px; then without each of some parts of the image, for errors.
        distances_mm: median distance of each of three groups of tiles, nearest first.
        slopes: median slope of each group, px of disparity per px; noise depends on it. A single
            tile also has a slope that noise causes.
    """

    frames: int
    size: tuple[int, int]
    unit_mm: float
    focal_baseline_px_mm: float
    lattice: Lattice | None
    noise: Sequence[DisparityNoise]
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
    noise = measure_blocks(disparity, pairs)
    if noise[0].tiles < LEAST_TILES or not np.isfinite([noise[0].frame, noise[0].static]).all():
        raise DatasetError(
            f"{frames.title}: only {noise[0].tiles} parts of 40x40 px are full of depth: record "
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


#: Lags at which correlations are printed, as a slice of LAGS_PX: 1 to 8 px.
_LAGS = slice(0, 6)
#: Search for the value of a parameter: value where the base's is 0, factor of the second value to
#: the power, largest number of values, and standard errors from which a difference counts. Chosen.
_FIRST, _SECOND, _VALUES, _SIGNIFICANT = 0.05, 2.0, 4, 2.0
#: A simulated plane: number of frames, albedo (as in the sheets of ``glsim validate``), and
#: steepest tilt, degrees.
_FRAMES, _ALBEDO, _MOST_TILT_DEG = 3, 0.6, 60.0
#: Stages that simulate the exposure: of two imagers, and of an imager with a projected pattern.
_EXPOSURES = ("stereo_exposure", "pattern_exposure")


def _static(noise: DisparityNoise, lag: int) -> float:
    """Return the correlation of static noise at a lag of LAGS_PX, mean of rows and columns."""
    return 0.5 * (noise.static_rows[lag] + noise.static_columns[lag])


#: A measure of noise that says a parameter.
_Measure = Callable[[DisparityNoise], float]
#: Fitted parameters of the matcher: measure, and power of the parameter in which it is linear.
_OWN: dict[str, tuple[_Measure, float]] = {
    "device_grain_px": (lambda n: _static(n, 3) / _static(n, 0), -2.0),
    "device_fine": (lambda n: 1.0 - _static(n, 0), 1.0),
    "device_sigma_px": (lambda n: n.static**2, 2.0),
}


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
        base_noise = fit.noise()
        exposure = next((s.name for s in sensor.stages if s.spec.name in _EXPOSURES), None)
        if exposure is not None:
            fit.solve(f"{exposure}.speckle_sigma", lambda n: n.frame**2, 2.0)
        for name, (measure, power) in _OWN.items():
            fit.solve(f"{MATCHER}.{name}", measure, power)
        lines = {"base": named, "at rest": frames.note} | _result_lines(
            statistics, base_noise, fit.noise(), image, fit.baseline_m
        )
    lines |= fit.results
    comments = [
        f"Fitted by glsim fit to {statistics.frames} frames of {image.width}x{image.height}: "
        f"{recording.path}",
        *(f"{name}: {text}" for name, text in lines.items()),
        f"All other values are those of {sensor.name}.",
    ]
    return FittedSensor(fit.text(fit.values, comments), image, lines)


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
        self, statistics: StereoStatistics, base: str, sensor: Sensor, image: Intrinsics,
        folder: Path, context: Context,
    ) -> None:  # fmt: skip
        self.statistics, self.base, self.sensor, self.image = statistics, base, sensor, image
        self.baseline_m = statistics.focal_baseline_px_mm / image.fx / MM_PER_M
        self.values = {f"{MATCHER}.depth_unit_mm": statistics.unit_mm}
        self.results: dict[str, str] = {}
        self._folder, self._context, self._count = folder, context, 0

    def text(self, values: Mapping[str, float], comments: Sequence[str]) -> str:
        """Write the text of the sensor file: base sensor, rig and fitted parameters."""
        image, rig = self.image, self.sensor.rig
        scale = self.baseline_m / rig.baseline_m
        places = {"imager": rig.imagers_m, "emitter": [e.position_m for e in rig.emitters]}
        table = {
            "width": image.width, "height": image.height,
            "focal_px": [_rounded(image.fx), _rounded(image.fy)],
            "centre_px": [_rounded(image.cx), _rounded(image.cy)],
            **{
                name: [{"position_m": [float(f"{scale * v:.7g}") for v in p]} for p in points]
                for name, points in places.items()
            },
        }  # fmt: skip
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

    def noise(self, name: str = "", value: float = 0.0) -> list[DisparityNoise]:
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
        return measure_blocks(disparity, pairs)

    def solve(self, name: str, measure: _Measure, power: float) -> None:
        """Find the value of a parameter with which simulated planes measure as the recording does.

        Secants over the parameter to a power. The base's value stays if the recording agrees with
        it, or if the measure hardly depends on the parameter.
        """
        stage_name, _, key = name.partition(".")
        stage = next(s for s in self.sensor.stages if s.name == stage_name)
        low, high = stage.spec.parameters[key].low, stage.spec.parameters[key].high
        own = stage.settings[key].typical
        target, error = _with_error(measure, self.statistics.noise)
        value, slope, spread, apart, both = own or _FIRST, 0.0, 0.0, 0.0, 0.0
        tried: list[tuple[float, float]] = []
        for _ in range(_VALUES):
            reached, spread = _with_error(measure, self.noise(name, value))
            if not np.isfinite(reached):  # no tile is full of depth: halfway back to the last value
                x = 0.5 * (value**power + tried[-1][0]) if tried else 0.5 * value**power
                value = float(np.clip(x ** (1.0 / power), low, high))
                continue
            tried.append((value**power, reached))
            apart, both = target - reached, _SIGNIFICANT * float(np.hypot(error, spread))
            if len(tried) > 1:
                slope = (reached - tried[-2][1]) / (tried[-1][0] - tried[-2][0] or np.inf)
                if abs(slope) * tried[-1][0] <= _SIGNIFICANT * spread:
                    break
            if abs(apart) < (both if len(tried) == 1 else 0.5 * error):
                break
            x = _SECOND * tried[-1][0]
            if slope:
                x = float(np.clip(tried[-1][0] + apart / slope, 0.1 * x, 2.0 * x))
            value = float(np.clip(x ** (1.0 / power), low, high))
        if slope and abs(slope) * tried[-1][0] > _SIGNIFICANT * spread:
            off = 0.5 * both / abs(slope * power * value ** (power - 1.0))
            self.values[name] = float(f"{value:.3g}")
            self.results[name] = f"{value:.3g} +- {off:.2g} (base {own:g})"
        else:
            why = "as the recording's" if abs(apart) < both else "the recording hardly shows it"
            self.results[name] = f"{own:g}, the base's: {why}"


def _with_error(measure: _Measure, noise: Sequence[DisparityNoise]) -> tuple[float, float]:
    whole, *without = (measure(n) for n in noise)
    return whole, float(jackknife_error(without))


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


#: Printed figures of noise -> their titles.
_NOISES = {
    "residual": "residual of planes, px", "frame": "noise from frame to frame, px",
    "frame_rows": "noise from frame to frame: correlation at 1, 2, 3, 4, 6, 8 px along rows",
    "frame_columns": "the same along columns", "static": "noise that stays, px",
    "static_rows": "noise that stays: correlation at 1, 2, 3, 4, 6, 8 px along rows",
    "static_columns": "noise that stays: the same along columns",
}  # fmt: skip


def _result_lines(
    statistics: StereoStatistics, base: Sequence[DisparityNoise], own: Sequence[DisparityNoise],
    image: Intrinsics, baseline_m: float,
) -> dict[str, str]:  # fmt: skip
    """List the noise of the recording, the base and the fitted sensor, px: name -> text."""
    by = "the base sensor's: the depths are on no lattice that says it"
    if statistics.lattice is not None:
        by = f"depths are round({statistics.lattice.constant:,.0f} / n) units"
    lines = {
        "focal length times baseline": f"{statistics.focal_baseline_px_mm:,.0f} px mm ({by}); "
        f"baseline {MM_PER_M * baseline_m:.2f} mm at {image.fx:.1f} px",
        "planes compared at": ", ".join(f"{z / MM_PER_M:.2f}" for z in statistics.distances_mm)
        + " m",
    }
    for name, title in _NOISES.items():
        texts = []
        for noise in (statistics.noise, base, own):
            values, *without = (np.atleast_1d(getattr(n, name))[_LAGS] for n in noise)
            pairs = zip(values, jackknife_error(without), strict=True)
            texts.append(", ".join(f"{v:.3f} +- {e:.3f}" for v, e in pairs))
        lines[title] = "{}; base {}; fitted {}".format(*texts)
    return lines
