"""Write a fitted sensor as a TOML file: a shipped sensor with fitted values."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from glsim.bench.fit.noise_model import InfraredLaw, LightProfile, NoiseModel, TapNoise
from glsim.bench.fit.recording_statistics import RecordingStatistics
from glsim.bench.fit.wiggling import Wiggling
from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError, did_you_mean
from glsim.noise.registry import find_stage
from glsim.sensors.sensor import SENSOR_FOLDER, sensor_names
from glsim.sensors.wiggling import Wave
from glsim.settings.distribution import NumberSetting
from glsim.settings.tables import read_toml

#: Sensors that a fit can start from, the cheapest first.
BASES = ("kinect-v2-fast", "kinect-v2")

#: Fitted value -> stages and parameter of a sensor file; the first stage that declares it gets the
#: value.
_PLACES: Mapping[str, tuple[tuple[str, ...], str]] = {
    "gain": (("tof_light", "tof_fast"), "gain"),
    "floor_mm": (("tof_floor", "tof_fast"), "sigma_mm"),
    "read_lsb2": (("tof_taps", "tof_fast"), "read_variance"),
    "shot_lsb": (("tof_taps", "tof_fast"), "shot_variance"),
    "pixel_mm": (("fixed_pattern",), "pixel_sigma_mm"),
    "column_mm": (("fixed_pattern",), "column_sigma_mm"),
    "row_mm": (("fixed_pattern",), "row_sigma_mm"),
    "alternation_mm": (("fixed_pattern",), "row_alternation_mm"),
    "row_step_mm": (("fixed_pattern",), "row_step_mm"),
    "harmonic_2": (("tof_light", "tof_fast"), "harmonic_2"),
    "harmonic_5": (("tof_light", "tof_fast"), "harmonic_5"),
    "harmonic_2_phase_deg": (("tof_light", "tof_fast"), "harmonic_2_phase_deg"),
    "harmonic_5_phase_deg": (("tof_light", "tof_fast"), "harmonic_5_phase_deg"),
    "harmonic_phase_spread": (("tof_light", "tof_fast"), "harmonic_phase_spread"),
    "edge_invalid": (("edge_dropout",), "probability"),
}

#: Least frames for the pattern of single pixels; with fewer, temporal noise hides it.
LEAST_PATTERN_FRAMES = 10

#: Largest difference between the phases of the frequencies, rad: the shader has one for all.
_MOST_APART_RAD = 0.7


def knows_pattern(statistics: RecordingStatistics) -> bool:
    """Whether the map holds more pattern than temporal noise."""
    known = np.isfinite(statistics.pattern.map_mm).any()
    return bool(known) and statistics.frames >= LEAST_PATTERN_FRAMES


def base_sensor(name: str | None = None) -> tuple[str, dict[str, Any]]:
    """Return name and TOML tree of the base sensor. Raises ConfigError if it is not in BASES."""
    chosen = name or next(b for b in BASES if b in sensor_names())
    if chosen not in BASES or chosen not in sensor_names():
        raise ConfigError(f"no fit starts from {chosen!r} ({did_you_mean(chosen, BASES)})")
    return chosen, read_toml(SENSOR_FOLDER / f"{chosen}.toml")


def _typical(value: object) -> float:
    """Return a number of a sensor file; of one that is drawn per device, the typical one."""
    return TypeAdapter(NumberSetting).validate_python(value).typical


def base_taps(tree: Mapping[str, Any]) -> TapNoise:
    """Return the noise of the taps of a base sensor."""
    read, shot = (base_value(tree, name) for name in ("read_lsb2", "shot_lsb"))
    return TapNoise() if read is None or shot is None else TapNoise(read, shot)


def base_profile(tree: Mapping[str, Any]) -> LightProfile:
    """Return the light of a base sensor over the image; even light without such parameters."""
    for stage in tree["stage"]:
        declared = find_stage(stage["use"]).parameters
        own = {
            name: _typical(stage.get(name, declared[name].default))
            for name in ("flat_to", "fall_off", "tail", "vignetting")
            if name in declared
        }
        if own:
            return LightProfile(**own)
    return LightProfile()


def base_value(tree: Mapping[str, Any], name: str) -> float | None:
    """Return a base sensor's value in the place of a fitted one; None without such a place."""
    stages, parameter = _PLACES[name]
    for stage in tree["stage"]:
        declared = find_stage(stage["use"]).parameters
        if stage["use"] in stages and parameter in declared:
            return _typical(stage.get(parameter, declared[parameter].default))
    return None


def fitted_values(
    statistics: RecordingStatistics,
    model: NoiseModel,
    infrared: InfraredLaw | None = None,
    taps: TapNoise | None = None,
    wiggling: Wiggling | None = None,
) -> dict[str, float]:
    """Collect the fitted values that the recording determines.

    Args:
        statistics: of the recording.
        model: fit to the distances.
        infrared: fit to the infrared; replaces ``model`` where present.
        taps: noise of the base sensor's taps.
        wiggling: harmonics, if the recording shows them.

    Returns:
        name -> value, see ``_PLACES``.

    """
    pattern = statistics.pattern
    values = {
        "floor_mm": model.floor_mm,
        "column_mm": pattern.column_mm,
        "row_mm": pattern.row_mm,
        "alternation_mm": abs(pattern.alternation_mm),  # its sign is drawn, and in the map
        "row_step_mm": pattern.row_step_mm,
    }
    if knows_pattern(statistics):
        values["pixel_mm"] = pattern.pixel_mm
    if infrared is not None and math.isfinite(infrared.gain):
        values["gain"] = infrared.gain
        if infrared.knows_noise:
            base = taps or TapNoise()
            values["floor_mm"] = infrared.floor_mm
            values["read_lsb2"] = infrared.tap_scale * base.read_lsb2
            values["shot_lsb"] = infrared.tap_scale * base.shot_lsb
    elif model.knows_amplitude:
        values["gain"] = model.amplitude
    if wiggling is not None:
        values |= _harmonics(wiggling)
    if statistics.edge_pixels > 0:
        values["edge_invalid"] = statistics.invalid_share
    return values


def _harmonics(wiggling: Wiggling) -> dict[str, float]:
    """Collect sizes of the known harmonics, and phases where one serves all frequencies."""
    values: dict[str, float] = {}
    phases: dict[int, float] = {}
    known = [harmonic for harmonic in wiggling.amplitude if wiggling.known(harmonic)]
    for harmonic in known:
        values[f"harmonic_{harmonic}"] = wiggling.amplitude[harmonic]
        turns = np.exp(1j * wiggling.phase_rad[harmonic])
        mean = complex(turns.mean())
        if np.abs(np.angle(turns / mean)).max() < 0.5 * _MOST_APART_RAD:
            phases[harmonic] = math.degrees(math.atan2(mean.imag, mean.real))
    if known and set(phases) == set(wiggling.amplitude):
        values |= {f"harmonic_{h}_phase_deg": phase for h, phase in phases.items()}
        values["harmonic_phase_spread"] = 0.0
    return values


def unplaced_parameters(tree: Mapping[str, Any], values: Mapping[str, float]) -> list[str]:
    """List the parameters that no stage of the base sensor declares.

    The share without depth at edges is left out: only statistical sensors have it.
    """
    return [
        ".".join((_PLACES[name][0][0], _PLACES[name][1]))
        for name in values
        if name != "edge_invalid" and base_value(tree, name) is None
    ]


def sensor_toml(
    base: str,
    tree: Mapping[str, Any],
    values: Mapping[str, float],
    image: Intrinsics,
    comments: Sequence[str],
    pattern_map: str = "",
    waves: Sequence[Wave] = (),
) -> str:
    """Write the TOML text: rig and stages of the base with fitted values and intrinsics.

    Args:
        base: name of the base sensor.
        tree: its file; its lens distortion is dropped.
        values: fitted values by name.
        image: intrinsics of the recording.
        comments: lines at the top of the file.
        pattern_map: file name of the map of the fixed pattern beside the sensor file, or "".
        waves: wiggling of the device.

    """
    rig = {k: v for k, v in tree["rig"].items() if k != "distortion"}
    rig |= {
        "width": image.width, "height": image.height,
        "focal_px": [image.fx, image.fy], "centre_px": [image.cx, image.cy],
    }  # fmt: skip
    if pattern_map:
        rig["fixed_pattern_map"] = pattern_map
    if waves:
        rig["wiggling"] = [wave.model_dump() for wave in waves]
    lines = [f"# {comment}".rstrip() for comment in comments]
    lines += [f"title = {_toml_value(f'fitted to a recording, from {base}')}", "", "[rig]"]
    lines += [f"{k} = {_toml_value(v)}" for k, v in rig.items() if k != "emitter"]
    for emitter in rig.get("emitter", []):
        lines += ["", "[[rig.emitter]]", *(f"{k} = {_toml_value(v)}" for k, v in emitter.items())]
    for stage in tree["stage"]:
        declared = find_stage(stage["use"]).parameters
        changed = {
            parameter: _clipped(value, declared[parameter].low, declared[parameter].high)
            for name, value in values.items()
            for stages, parameter in (_PLACES[name],)
            if stage["use"] in stages and parameter in declared
        }
        lines += [
            "",
            "[[stage]]",
            *(f"{k} = {_toml_value(v)}" for k, v in {**stage, **changed}.items()),
        ]
    return "\n".join(lines) + "\n"


def _clipped(value: float, low: float, high: float) -> float:
    return float(f"{min(max(value, low), high):.5g}")


def _toml_value(value: Any) -> str:
    """Format a TOML value: string, number, boolean, array or inline table."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return json.dumps(value)
