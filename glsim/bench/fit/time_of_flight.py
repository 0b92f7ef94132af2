"""Fit of a time-of-flight sensor to a static recording: noise, pattern, wiggling, filter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glsim.bench.fit.figures import FRAME, INVERSE_KM, LIGHT
from glsim.bench.fit.fit_wiggling import Wiggling, fit_wiggling
from glsim.bench.fit.fitted_sensor import PATTERN_MAP, FittedSensor, recording_camera, sensor_toml
from glsim.bench.fit.noise_model import (
    InfraredLaw,
    LightProfile,
    NoiseModel,
    TapNoise,
    fit_infrared,
    fit_noise_model,
)
from glsim.bench.fit.recording_statistics import RecordingStatistics, measure_recording
from glsim.bench.fit.stereo_sensor import Trials
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.data.recording import Recording
from glsim.sensors.kinect_v2 import FREQUENCIES_MHZ
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.sensors.wiggling import Wave

#: Stage -> parameters that are fitted.
_LIGHT = (
    "gain", "harmonic_2", "harmonic_5", "harmonic_2_phase_deg", "harmonic_5_phase_deg",
    "harmonic_phase_spread",
)  # fmt: skip
_TAPS = ("read_variance", "shot_variance")
_PATTERN = (
    "column_sigma_mm", "row_sigma_mm", "row_alternation_mm", "row_step_mm", "pixel_sigma_mm",
)  # fmt: skip
_FITTED = {
    "tof_light": _LIGHT,
    "tof_taps": _TAPS,
    "tof_floor": ("sigma_mm",),
    "tof_fast": ("sigma_mm", *_LIGHT, *_TAPS),
    "fixed_pattern": _PATTERN,
}

#: Smallest number of frames for the pattern of single pixels; in fewer, temporal noise hides it.
LEAST_PATTERN_FRAMES = 10
#: The shader has one phase for all frequencies. It is fitted only if the phases of the frequencies
#: differ by at most this angle, rad.
_MOST_APART_RAD = 0.7
#: Why a value is the base's: the recording does not say it.
_UNKNOWN = {
    "gain": "the base's: add far or dark walls",
    "shot_variance": "the base's: add infrared, and surfaces of many brightnesses",
    "harmonic_2": "the base's: add walls, one at a slant, over 0.65 m of distances",
}
#: Stage of the Azure Kinect's decoder, whose noise has no published law: replays fit its width by
#: this figure, and the light's noise by the size of the noise.
_SMOOTH, _ALIKE = "tof_smooth", f"{FRAME}: correlation at 2 px along rows"


def fit_time_of_flight(
    recording: Recording, base: str, albedo: float, focal_px: float | None, part: slice
) -> FittedSensor:
    """Fit a time-of-flight sensor to a static recording.

    ``recording``: at least two frames of one view. ``albedo``: reflectivity of the scene; with
    infrared, of its brightest surfaces. ``focal_px``: None: as stated, or the base sensor's.

    Raises ConfigError if the focal length is not known, DatasetError if the recording is not static
    or shows no smooth surfaces.
    """
    recorded = recording.read_static(part=part)
    rest = recorded.note
    height, width = recorded[0].noisy_mm.shape
    sensor = load_sensor(base)
    image = recording_camera((width, height), recording.camera, sensor.rig.intrinsics, focal_px)
    recorded = Frames.of([frame.changed(intrinsics=image) for frame in recorded], recorded.title)
    statistics = measure_recording(recorded)
    emitter, taps = sensor.rig.emitter_m, TapNoise(**_parameters(sensor, *_TAPS))
    profile = LightProfile(**_parameters(sensor, "flat_to", "fall_off", "tail", "vignetting"))
    smoothed, step_mm = any(s.spec.name == _SMOOTH for s in sensor.stages), recorded[0].step_mm
    model = None
    if not smoothed:
        model = fit_noise_model(statistics, image, albedo, step_mm, profile, emitter, taps)
    law = None
    if recorded[0].infrared is not None:
        law = fit_infrared(statistics, recorded, albedo, taps)
    kinect = sensor.rig.modulation_mhz == FREQUENCIES_MHZ  # whose wiggling is known
    wiggling = fit_wiggling(statistics, image, emitter) if kinect else None
    values = _fitted_values(statistics, model, law, taps, wiggling)
    waves = wiggling.waves() if wiggling is not None else ()
    lines = {"base": base, "at rest": rest} | _result_lines(statistics, sensor, values)
    named = _named(sensor, values)
    if smoothed:
        trials = Trials(recorded, sensor, base, INVERSE_KM, named, {})
        trials.solve(f"{_SMOOTH}.width_px", _ALIKE, -2.0)
        lit = math.isfinite(sum(trials.real.get(LIGHT, (math.nan,))))
        trials.solve("tof_taps.shot_variance", LIGHT if lit else FRAME, 1.0, 2.0)
        named, lines = trials.values, lines | trials.lines()
    usable = _knows_pattern(statistics)
    comments = [
        f"Fitted by glsim fit to {statistics.frames} frames of {width}x{height}: {recording.path}",
        *(f"{title}: {text}" for title, text in lines.items()),
        f"Map of this device's own fixed pattern: {PATTERN_MAP} (float32 mm, NaN = unknown"
        + (")." if usable else "); too noisy to add to frames."),
        f"All other values are those of {base}.",
    ]
    pattern = PATTERN_MAP if usable else ""
    text = fitted_toml(sensor, named, image, comments, pattern, waves)
    return FittedSensor(text, image, lines, statistics.map_mm)


def _parameters(sensor: Sensor, *names: str) -> dict[str, float]:
    """Return typical values of the parameters from the first stage that declares any of them."""
    for stage in sensor.stages:
        if given := {n: stage.settings[n].typical for n in names if n in stage.settings}:
            return given
    return {}


def _knows_pattern(statistics: RecordingStatistics) -> bool:
    """Return whether the recording shows the pattern: a known map and enough frames."""
    known = bool(np.isfinite(statistics.map_mm).any())
    return known and statistics.frames >= LEAST_PATTERN_FRAMES


def _fitted_values(
    statistics: RecordingStatistics, model: NoiseModel | None, infrared: InfraredLaw | None,
    taps: TapNoise, wiggling: Wiggling | None,
) -> dict[str, float]:  # fmt: skip
    """Collect the parameters that the recording determines, from infrared if there is any."""
    values = dict(statistics.pattern) | ({} if model is None else {"sigma_mm": model.floor_mm})
    if not _knows_pattern(statistics):
        del values["pixel_sigma_mm"]
    if infrared is not None and math.isfinite(infrared.gain):
        values["gain"] = infrared.gain
        if model is not None and infrared.knows_noise:
            values["sigma_mm"] = infrared.floor_mm
            values["read_variance"] = infrared.tap_scale * taps.read_variance
            values["shot_variance"] = infrared.tap_scale * taps.shot_variance
    elif model is not None and model.knows_amplitude:
        values["gain"] = model.amplitude
    return values if wiggling is None else values | _harmonics(wiggling)


def _harmonics(wiggling: Wiggling) -> dict[str, float]:
    """Collect sizes of significant harmonics; phases only if they agree at all frequencies."""
    values: dict[str, float] = {}
    phases: dict[str, float] = {}
    known = [harmonic for harmonic in wiggling.amplitude if wiggling.known(harmonic)]
    for harmonic in known:
        values[f"harmonic_{harmonic}"] = wiggling.amplitude[harmonic]
        turns = np.exp(1j * wiggling.phase_rad[harmonic])
        mean = turns.mean()
        if np.abs(np.angle(turns / mean)).max() < 0.5 * _MOST_APART_RAD:
            phases[f"harmonic_{harmonic}_phase_deg"] = math.degrees(np.angle(mean))
    if known and len(phases) == len(wiggling.amplitude):
        values |= phases | {"harmonic_phase_spread": 0.0}
    return values


def fitted_toml(
    sensor: Sensor, values: Mapping[str, float], image: Intrinsics, comments: Sequence[str],
    pattern_map: str = "", waves: Sequence[Wave] = (),
) -> str:  # fmt: skip
    """Write the sensor file: the base with values of STAGE.PARAMETER; a map's file name or ""."""
    rig: dict[str, Any] = {"fixed_pattern_map": pattern_map} if pattern_map else {}
    if waves:
        rig["wiggling"] = [wave.model_dump() for wave in waves]
    return sensor_toml(comments, sensor, sensor.name, image, rig, values)


def _named(sensor: Sensor, values: Mapping[str, float]) -> dict[str, float]:
    """Return values of parameters as values of STAGE.PARAMETER."""
    return {
        f"{stage.name}.{n}": float(f"{values[n]:.5g}")
        for stage in sensor.stages
        for n in _FITTED.get(stage.spec.name, ())
        if n in values
    }


def _result_lines(
    statistics: RecordingStatistics, sensor: Sensor, values: Mapping[str, float]
) -> dict[str, str]:
    """List fitted values beside the base sensor's, and what the recording cannot tell."""
    fitted = {
        n: f"{v:.4g} (base: {_parameters(sensor, n).get(n, 0.0):.4g})" for n, v in values.items()
    }
    known = f"{100 * np.isfinite(statistics.map_mm).mean():.0f} % of the pixels, on flat surfaces"
    if not _knows_pattern(statistics):
        known += (
            f"; mostly temporal noise with {statistics.frames} frames: below "
            f"{LEAST_PATTERN_FRAMES} the part of single pixels is not fitted, "
            "and the sensor does not name the map"
        )
    unknown = _UNKNOWN if "sigma_mm" in values else {}
    return unknown | fitted | {"map of the fixed pattern": known}
