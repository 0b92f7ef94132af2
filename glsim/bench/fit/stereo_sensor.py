"""Fit of an image-matching sensor to a recording, by replays of the recording's own surfaces.

The base sensor gets the recording's focal length, baseline and unit. Then each figure is fitted by
one parameter, if it differs from the base's by two standard errors:

    noise from frame to frame                  speckle_sigma of the exposure, of the laser's light
    noise that stays: correlation at 4 px      match_stereo.device_grain_px, its waves
    over that at 1 px
    correlation at 1 px                        match_stereo.device_fine, share of its fine grains
    its size                                   match_stereo.device_sigma_px
    single holes                               match_stereo.unlike_medians, of which match is bad
    gap right of silhouettes                   match_stereo.rim_px
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from glsim.bench.compare.replay import Replay
from glsim.bench.fit import figures
from glsim.bench.fit.fitted_sensor import FittedSensor, recording_camera, sensor_toml
from glsim.bench.modes import find_lattice, possible_modes
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError, DatasetError, counted
from glsim.core.units import MM_PER_M
from glsim.data.recording import Recording
from glsim.measures.disparity import LEAST_TILES, find_tiles, to_disparity
from glsim.measures.lattice import Lattice
from glsim.noise.rig_checks import MATCHER
from glsim.sensors.sensor import Sensor, load_sensor

#: Number of frames to measure. Chosen: 23 differences determine a tile's temporal noise to 3 %.
FRAMES = 24
#: Devices and frames of a trial; factor of a value to the power for the second trial, and the
#: largest one; number of trials, and standard errors from which a difference counts. Chosen.
_DEVICES, _FRAMES = 2, 3
_SECOND, _FURTHER, _VALUES, _SIGNIFICANT = 2.0, 5.0, 5, 2.0
#: Smoothing of the trials' surfaces, px. Chosen: of noise alike over 6 px, what stays in them is a
#: fifth; with relief a simulated room's noise that stays came back 1.8 times too large.
_SMOOTH_PX = 16.0
#: A figure as near as this share counts as equal, and none counts more than this many standard
#: errors. Chosen: the surfaces of a replay still hold a part of the real noise.
_EQUAL, _MOST_ERRORS = 0.05, 5.0
AGREES, _NONE = "as the recording's", (math.nan, math.nan)


def fit_stereo(
    recording: Recording, base: str, focal_px: float | None, part: slice
) -> FittedSensor:
    """Fit an image-matching sensor to a static recording.

    ``recording``: at least two frames of one view. ``focal_px``: None: as the recording states;
    else the base's, or from the base's baseline.

    Raises ConfigError if the focal length is not known, or the frames are decimated or registered;
    DatasetError if the recording is not static, or shows no planes.
    """
    sensor = load_sensor(base)
    rig, matcher = sensor.rig, next(s for s in sensor.stages if s.spec.name == MATCHER)
    frames = recording.read_static(FRAMES, part)
    lattice = find_lattice(frames)
    if focal_px is not None or recording.camera is not None:
        _check_grid(recording, sensor, focal_px, lattice)
    steps, unit_mm = matcher.settings["subpixel_steps"].bounds()[0], frames[0].step_mm or 1.0
    product = None if lattice is None else lattice.constant * unit_mm / steps
    other_px = rig.intrinsics.fx if product is None else product / rig.baseline_m / MM_PER_M
    size = frames.intrinsics.width, frames.intrinsics.height
    image = recording_camera(size, recording.camera, rig.intrinsics, focal_px, other_px)
    product = product or MM_PER_M * rig.baseline_m * image.fx
    baseline_m = product / image.fx / MM_PER_M
    tiles = len(find_tiles(to_disparity(frames[0].measured_mm, product)).sigma)
    if tiles < LEAST_TILES:
        raise DatasetError(
            f"{frames.title}: only {counted(tiles, 'part')} of 40x40 px full of depth: record "
            "walls, a floor, a table, at several distances, and do not move"
        )
    named = str(Path(base).resolve()) if base.endswith(".toml") else base
    placed = Frames.of([frame.changed(intrinsics=image) for frame in frames], frames.title)
    unit, scale = {f"{MATCHER}.depth_unit_mm": unit_mm}, baseline_m / rig.baseline_m
    places = {"imager": rig.imagers_m, "emitter": [e.position_m for e in rig.emitters]}
    moved = {
        name: [{"position_m": [float(f"{scale * v:.7g}") for v in point]} for point in points]
        for name, points in places.items()
    }
    trials = Trials(placed, sensor, named, product, unit, moved)
    for exposure in ("stereo_exposure", "pattern_exposure"):  # a sensor has one of them
        trials.solve(f"{exposure}.speckle_sigma", figures.FRAME, 2.0, 2.0)
    trials.solve(f"{MATCHER}.device_grain_px", figures.WAVES, -2.0)
    trials.solve(f"{MATCHER}.device_fine", figures.FINE, 1.0)
    trials.solve(f"{MATCHER}.device_sigma_px", figures.STATIC, 2.0, 2.0)
    trials.solve(f"{MATCHER}.unlike_medians", figures.HOLES, -5.0)  # fitted to trials of 7 to 12
    trials.solve(f"{MATCHER}.rim_px", figures.GAPS[1], 1.0)
    by = "the baseline is the base sensor's: the depths are on no lattice that says it"
    if lattice is not None:
        by = f"depths are round({lattice.constant:,.0f} / n) units"
    lines = {
        "base": named, "at rest": frames.note,
        "focal length times baseline": f"{product:,.0f} px mm ({by}); baseline "
        f"{MM_PER_M * baseline_m:.2f} mm at {image.fx:.1f} px",
    } | trials.lines()  # fmt: skip
    comments = (
        f"Fitted by glsim fit to {counted(len(frames), 'frame')} of {image.width}x{image.height}: "
        f"{recording.path}",
        *(f"{name}: {line}" for name, line in lines.items()),
        f"All other values are those of {sensor.name}.",
    )
    return FittedSensor(trials.text(trials.values, comments), image, lines)


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


class Trials:
    """State of a fit: the values found so far, and the figures of trials with them."""

    def __init__(
        self, frames: Frames, sensor: Sensor, base: str, focal_baseline_px_mm: float,
        values: Mapping[str, float], rig: Mapping[str, Any],
    ) -> None:  # fmt: skip
        """Measure a recording and replays of it, through the base and with known values.

        ``base``: name or file of the base sensor; ``values``: of STAGE.PARAMETER; ``rig``: further
        keys of [rig].
        """
        self.sensor, self._base, self._product = sensor, base, focal_baseline_px_mm
        self._rig = rig
        self.values = dict(values)
        self.moved: set[str] = set()  # figures that a parameter moves
        self.results: dict[str, str] = {}
        self._image, self._seed = frames.intrinsics, 0
        self._replay = Replay(frames, base, smooth_px=_SMOOTH_PX, relief=False)
        self.real = self._measure(frames)
        self.base, self.now = self._replayed(self._base), self.trial()

    def text(self, values: Mapping[str, float], comments: Sequence[str] = ()) -> str:
        """Write a sensor file with other values."""
        return sensor_toml(comments, self.sensor, self._base, self._image, self._rig, values)

    def trial(self, name: str = "", value: float = 0.0) -> figures.Figures:
        """Change one parameter of the sensor so far, replay by new devices, and measure."""
        with TemporaryDirectory() as folder:
            file = Path(folder) / "trial.toml"
            file.write_text(self.text(self.values | ({name: value} if name else {})))
            return self._replayed(str(file))

    def _replayed(self, sensor: str) -> figures.Figures:
        drawn = []
        for _ in range(_DEVICES):
            self._seed += 1
            drawn.append(self._measure(self._replay.through(sensor, seed=self._seed, most=_FRAMES)))
        return figures.mean_figures(drawn)

    def _measure(self, frames: Frames) -> figures.Figures:
        return figures.disparity_figures(frames, self._product) | figures.compared_figures(frames)

    def misfit(self, found: figures.Figures) -> float:
        """Return the mean square difference from the recording, in standard errors."""
        apart = []
        for name, (value, error) in self.real.items():
            other = found.get(name, _NONE)
            if np.isfinite([value, error, *other]).all():
                scale = math.hypot(error, other[1], _EQUAL * value) or 1.0
                apart.append(min(abs(value - other[0]) / scale, _MOST_ERRORS) ** 2)
        return float(np.mean(apart)) if apart else math.inf

    def solve(self, name: str, figure: str, power: float, of_figure: float = 1.0) -> None:
        """Find the value of a parameter with which a figure is the recording's.

        Secants of the figure and the parameter to their powers. The value so far stays if the
        recording agrees with it, if the figure hardly depends on the parameter, or if all figures
        together come no nearer.
        """
        stage_name, _, key = name.partition(".")
        stage = next((s for s in self.sensor.stages if s.name == stage_name), None)
        if stage is None or key not in stage.settings:
            return
        own, declared = stage.settings[key].typical, stage.spec.parameters[key]
        target, error = _to_power(self.real.get(figure, _NONE), of_figure)
        if own == 0 or not math.isfinite(target + error):
            why = "it has none" if own == 0 else "the recording does not show it"
            self.results[name] = f"{own:g}, the base's: {why}"
            return
        self.moved.add(figure)
        value, found, why = own, self.now, ""
        drawn: dict[float, figures.Figures] = {}
        tried: list[tuple[float, figures.Value]] = []
        while True:
            drawn[value] = found
            reached = _to_power(found.get(figure, _NONE), of_figure)
            tried.append((value**power, reached))
            x, why = _next(tried, (target, error))
            value = float(np.clip(max(x, 1e-12) ** (1.0 / power), declared.low, declared.high))
            value = float(f"{value:.3g}")
            if why or value in drawn or len(drawn) == _VALUES:
                break
            found = self.trial(name, value)
        apart = [abs(target - reached[0]) for _, reached in tried]
        best = list(drawn)[int(np.nanargmin(apart))] if np.isfinite(apart).any() else own
        if best != own and not why:
            why = "with others all figures together come no nearer"
            if self.misfit(drawn[best]) < self.misfit(self.now):
                (x, now), (y, then) = tried[-2:]
                slope = abs((now[0] - then[0]) / (x - y) * power * best ** (power - 1.0))
                off = math.hypot(error, then[1]) / slope
                self.values[name], self.now = best, drawn[best]
                self.results[name] = f"{best:g} +- {off:.2g} (base {own:g})"
                return
        self.results[name] = f"{own:g}, the base's: {why or AGREES}"

    def lines(self) -> dict[str, str]:
        """Write each figure as text: of the recording, of the base and of the fitted sensor."""
        lines = {}
        for name, real in self.real.items():
            texts = [figures.figure_text(v.get(name, _NONE)) for v in (self.base, self.now)]
            by = f"fitted {texts[1]}" if name in self.moved else f"not fitted, now {texts[1]}"
            lines[name] = f"{figures.figure_text(real)}; base {texts[0]}; {by}"
        return lines | self.results


def _next(tried: Sequence[tuple[float, figures.Value]], target: figures.Value) -> tuple[float, str]:
    """Return the next parameter value to try, to its power, or why the search ends.

    ``tried``: each x, a parameter to its power, with the figure and its error there.
    """
    x, (reached, spread) = tried[-1]
    known = [entry for entry in tried if math.isfinite(entry[1][0])]
    if not math.isfinite(reached):  # nothing to measure: halfway back to the last value
        return 0.5 * (x + (known[-1][0] if known else 0.0)), ""
    apart, both = target[0] - reached, _SIGNIFICANT * math.hypot(target[1], spread)
    if len(known) == 1:
        return _SECOND * x, AGREES if abs(apart) < both else ""
    (_, (first, own_spread)), (before, (then, _)) = known[0], known[-2]
    if abs(reached - first) <= _SIGNIFICANT * math.hypot(spread, own_spread):
        return _FURTHER * x, "" if len(tried) < _VALUES else "the recording hardly shows it"
    if abs(apart) < 0.5 * target[1]:
        return x, ""
    step = apart * (x - before) / ((reached - then) or math.inf)
    return float(np.clip(x + step, x / _FURTHER, _FURTHER * x)), ""


def _to_power(value: figures.Value, power: float) -> figures.Value:
    return value[0] ** power, abs(power * value[0] ** (power - 1.0)) * value[1]
