"""Fit a sensor that matches images to a recording, by trying it on planes at the same distances.

What a parameter does to disparity is known only by running the matcher: the base sensor with the
recording's focal length, baseline and unit captures tilted planes at the distances of the recording
and is measured as the recording was. One parameter answers for one measure, in this order:

    noise from frame to frame    stereo_exposure.speckle_sigma, the noise of the laser's light
    correlation between pixels   match_stereo.support_px, the side of the averaged region; then the
                                 noise from frame to frame again
    static share                 match_stereo.device_sigma_px, the device's own error
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.bench.fit.sensor_file import BASES
from glsim.bench.fit.stereo_statistics import StereoStatistics
from glsim.bench.measures.disparity import DisparityNoise, measure_disparity_noise, to_disparity
from glsim.bench.validate import scenes
from glsim.bench.validate.virtual_camera import VirtualCamera
from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError, did_you_mean
from glsim.noise.rig_checks import MATCHER
from glsim.sensors.sensor import Sensor, load_sensor, sensor_names

#: Step and largest side of the averaged region, px.
_SUPPORT_STEP_PX, _MOST_SUPPORT_PX = 4, 25
#: Lags of LAGS_PX that are compared: 1 to 8 px.
_LAGS = slice(0, 6)
#: Speckle that is tried first, and most, as a share of the signal; steps of refinement.
_FIRST_SPECKLE, _MOST_SPECKLE, _REFINEMENTS = 0.1, 0.8, 3
#: Frames of a plane, its albedo (that of the sheets of ``glsim validate``), steepest tilt, degrees.
_FRAMES, _ALBEDO, _MOST_TILT_DEG = 3, 0.6, 60.0
#: Stages that expose: of two imagers, of one imager and a pattern.
_EXPOSURES = ("stereo_exposure", "pattern_exposure")


@dataclass(frozen=True)
class StereoFit:
    """A fitted sensor.

    Attributes:
        base: the sensor it extends.
        image: intrinsics.
        baseline_m: distance of the two views.
        values: "stage.parameter" -> value.
        noise: of the fitted sensor on planes, px.
        notes: measures that no value of a parameter reaches.
    """

    base: str
    image: Intrinsics
    baseline_m: float
    values: Mapping[str, float]
    noise: DisparityNoise
    notes: tuple[str, ...]


def matches_images(name: str) -> bool:
    """Return whether a sensor has two views that it matches. Raises ConfigError if unknown."""
    return any(stage.spec.name == MATCHER for stage in load_sensor(name).stages)


def check_base(name: str) -> Sensor:
    """Return a base sensor. Raises ConfigError if no fit starts from it."""
    if not matches_images(name):
        known = [*BASES, *(n for n in sensor_names() if matches_images(n))]
        raise ConfigError(f"no fit starts from {name!r} ({did_you_mean(name, known)})")
    return load_sensor(name)


def matcher_value(sensor: Sensor, name: str) -> float:
    """Return a parameter of the stage ``match_stereo`` of a sensor."""
    stage = next(s for s in sensor.stages if s.spec.name == MATCHER)
    return stage.settings[name].bounds()[0]


def fit_stereo(
    statistics: StereoStatistics, base: str, image: Intrinsics, context: moderngl.Context
) -> StereoFit:
    """Fit a sensor to the statistics of a recording.

    Args:
        statistics: of the recording.
        base: name of the sensor that is extended.
        image: intrinsics of the recording; its focal length gives the baseline.
        context: to render with.
    """
    sensor = check_base(base)
    exposure = next((s.name for s in sensor.stages if s.spec.name in _EXPOSURES), None)
    baseline_m = statistics.focal_baseline_px_mm / image.fx / 1000.0
    values = {f"{MATCHER}.depth_unit_mm": statistics.unit_mm}
    trial = StereoFit(base, image, baseline_m, values, statistics.noise, ())
    with TemporaryDirectory() as folder:
        tried = _Trials(statistics, sensor, Path(folder), context)
        speckle = f"{exposure}.speckle_sigma"
        first = trial if exposure is None else _fit_speckle(tried, trial, speckle)
        trial = _fit_support(tried, first)
        if exposure is not None and not _same_support(trial, sensor):
            trial = _fit_speckle(tried, replace(trial, notes=()), speckle)
        trial = _fit_static(tried, trial)
        return replace(trial, noise=tried.noise(trial))


class _Trials:
    """Captures planes with trial sensors, and measures them as the recording was."""

    def __init__(
        self,
        statistics: StereoStatistics,
        sensor: Sensor,
        folder: Path,
        context: moderngl.Context,
    ) -> None:
        self.target = statistics.noise
        self.sensor = sensor
        self._distances_mm, self._slopes = statistics.distances_mm, statistics.slopes
        self._folder, self._context, self._count = folder, context, 0

    def noise(self, trial: StereoFit, **changes: float) -> DisparityNoise:
        """Return the noise of a trial sensor with some other values, px."""
        values = {**trial.values, **{k.replace("__", "."): v for k, v in changes.items()}}
        file = self._folder / f"trial_{self._count}.toml"
        self._count += 1
        file.write_text(stereo_toml(replace(trial, values=values), self.sensor, ("a trial",)))
        camera = VirtualCamera(str(file), self._context)
        product = 1000.0 * camera.rig.intrinsics.fx * camera.rig.baseline_m
        disparity: list[NDArray[np.float64]] = []
        pairs: list[tuple[int, int]] = []
        for z_mm, slope in zip(self._distances_mm, self._slopes, strict=True):
            # Disparity changes by slope, so depth by z^2 slope / (f B), over z / f beside it.
            steep = slope * z_mm * camera.rig.intrinsics.fx / product
            tilt = min(float(np.degrees(np.arctan(steep))), _MOST_TILT_DEG)
            mesh = scenes.tilted(z_mm, tilt, _ALBEDO, half_mm=z_mm)
            shot = camera.capture(mesh, _FRAMES, None, scene=f"plane {z_mm:.0f}")
            first = len(disparity)
            disparity += list(to_disparity(np.nan_to_num(shot.measured_mm), product))
            pairs += [(first + a, first + b) for a, b in pairwise(range(_FRAMES))]
        return measure_disparity_noise(disparity, pairs)


def _fit_support(tried: _Trials, trial: StereoFit) -> StereoFit:
    """Choose the region whose noise in time is correlated as the recording's.

    From the base's region on, larger and smaller ones are tried as long as they fit better.
    """
    target = np.array([tried.target.frame_rows[_LAGS], tried.target.frame_columns[_LAGS]])

    def misfit(side: int) -> float:
        found = tried.noise(trial, match_stereo__support_px=side)
        own = np.array([found.frame_rows[_LAGS], found.frame_columns[_LAGS]])
        return float(np.nansum((own - target) ** 2)) if np.isfinite(own).any() else np.inf

    best = int(matcher_value(tried.sensor, "support_px")) | 1
    least = misfit(best)
    for step in (_SUPPORT_STEP_PX, -_SUPPORT_STEP_PX):
        start = best
        while 1 <= best + step <= _MOST_SUPPORT_PX and (own := misfit(best + step)) < least:
            best, least = best + step, own
        if best != start:
            break
    return _with(trial, f"{MATCHER}.support_px", best)


def _same_support(trial: StereoFit, sensor: Sensor) -> bool:
    return trial.values[f"{MATCHER}.support_px"] == int(matcher_value(sensor, "support_px")) | 1


def _fit_speckle(tried: _Trials, trial: StereoFit, name: str) -> StereoFit:
    """Find the speckle at which the noise in time is the recording's.

    Variances of noise grow with the square of the speckle: false position in squares. Where so few
    tiles are full of depth that the noise is not known, it is too large.
    """
    key = name.replace(".", "__")
    target = tried.target.frame

    def noise(speckle: float) -> float:
        found = tried.noise(trial, **{key: speckle}).frame
        return found if np.isfinite(found) else float("inf")

    low, below = 0.0, noise(0.0)
    if below >= target:
        note = f"without speckle its noise in time is {below:.3f} px, the recording's {target:.3f}"
        return replace(_with(trial, name, low), notes=(*trial.notes, note))
    high, above = _FIRST_SPECKLE, noise(_FIRST_SPECKLE)
    while above < target and high < _MOST_SPECKLE:
        low, below = high, above
        high *= 2.0
        above = noise(high)
    if above < target:
        note = f"the most speckle makes {above:.3f} px in time, the recording has {target:.3f}"
        return replace(_with(trial, name, high), notes=(*trial.notes, note))
    found = high
    for _ in range(_REFINEMENTS):
        share = (target**2 - below**2) / (above**2 - below**2) if np.isfinite(above) else 0.25
        found = float(np.sqrt(low**2 + share * (high**2 - low**2)))
        reached = noise(found)
        if reached < target:
            low, below = found, reached
        else:
            high, above = found, reached
    return _with(trial, name, round(found, 4))


def _fit_static(tried: _Trials, trial: StereoFit) -> StereoFit:
    """Add as much of the device's own error as the pattern's static share leaves open."""
    name = f"{MATCHER}.device_sigma_px"
    own = tried.noise(trial, match_stereo__device_sigma_px=0.0).static
    target = tried.target.static
    missing = target**2 - own**2
    if missing <= 0:
        note = f"the pattern alone leaves {own:.3f} px as it is, the recording {target:.3f} px"
        return replace(_with(trial, name, 0.0), notes=(*trial.notes, note))
    # Planes that are fitted to tiles hide some of it: measured with the same tiles.
    probe = float(np.sqrt(missing))
    reached = tried.noise(trial, match_stereo__device_sigma_px=probe).static
    gained = max(reached**2 - own**2, 0.25 * missing)
    return _with(trial, name, round(float(np.sqrt(missing**2 / gained)), 4))


def _with(trial: StereoFit, name: str, value: float) -> StereoFit:
    return replace(trial, values={**trial.values, name: value})


def stereo_toml(fit: StereoFit, sensor: Sensor, comments: Sequence[str]) -> str:
    """Write the sensor file: what it extends, the rig, and the fitted parameters.

    Args:
        fit: the fitted values.
        sensor: the one it extends.
        comments: lines at the top of the file.
    """
    image, rig = fit.image, sensor.rig
    lines = [f"# {comment}".rstrip() for comment in comments]
    lines += [
        f"extends = {json.dumps(fit.base)}",
        f"title = {json.dumps(f'fitted to a recording, from {sensor.name}')}",
        "",
        "[rig]",
        f"width = {image.width}",
        f"height = {image.height}",
        f"focal_px = [{image.fx:.6g}, {image.fy:.6g}]",
        f"centre_px = [{image.cx:.6g}, {image.cy:.6g}]",
    ]
    scale = fit.baseline_m / rig.baseline_m
    for name, places in (
        ("imager", rig.imagers_m),
        ("emitter", [e.position_m for e in rig.emitters]),
    ):
        for place in places:
            numbers = ", ".join(f"{scale * value:.7g}" for value in place)
            lines += ["", f"[[rig.{name}]]", f"position_m = [{numbers}]"]
    whole = {s.name: s.spec.parameters for s in sensor.stages}
    for stage in dict.fromkeys(name.partition(".")[0] for name in fit.values):
        use = next(s.spec.name for s in sensor.stages if s.name == stage)
        own_name = [f'name = "{stage}"'] if use != stage else []
        lines += ["", "[[stage]]", f'use = "{use}"', *own_name]
        for name, value in fit.values.items():
            owner, _, key = name.partition(".")
            if owner == stage:
                kind = whole[stage][key].type
                lines.append(f"{key} = {int(value) if kind == 'int' else value:.6g}")
    return "\n".join(lines) + "\n"
