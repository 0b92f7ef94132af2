"""Write a fitted sensor as a TOML file: a shipped sensor with values fitted to a recording."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from glsim.errors import ConfigError, did_you_mean
from glsim.fit.noise_model import NoiseModel
from glsim.fit.recording_statistics import RecordingStatistics
from glsim.geometry.camera import Intrinsics
from glsim.sensors.sensor import SENSOR_FOLDER, sensor_names
from glsim.settings.tables import read_toml

#: Sensors that a fit can start from, the cheapest first.
BASES = ("kinect-v2-fast", "kinect-v2")

#: Place of each fitted value in a sensor file: (stage, parameter) -> name of the value.
_PLACES: Mapping[tuple[str, str], str] = {
    ("tof_light", "gain"): "gain",
    ("tof_fast", "gain"): "gain",
    ("tof_floor", "sigma_mm"): "floor_mm",
    ("tof_fast", "sigma_mm"): "floor_mm",
    ("fixed_pattern", "pixel_sigma_mm"): "pixel_mm",
    ("fixed_pattern", "column_sigma_mm"): "column_mm",
    ("fixed_pattern", "row_step_mm"): "row_step_mm",
    ("edge_dropout", "probability"): "edge_invalid",
}


def base_sensor(name: str | None = None) -> tuple[str, dict[str, Any]]:
    """Return name and TOML tree of the base sensor. Raises ConfigError if it is not in BASES."""
    chosen = name or next(b for b in BASES if b in sensor_names())
    if chosen not in BASES or chosen not in sensor_names():
        raise ConfigError(f"no fit starts from {chosen!r} ({did_you_mean(chosen, BASES)})")
    return chosen, read_toml(SENSOR_FOLDER / f"{chosen}.toml")


def fitted_values(statistics: RecordingStatistics, model: NoiseModel) -> dict[str, float]:
    """Collect the fitted values by name, without those that the recording does not determine."""
    values = {
        "floor_mm": model.floor_mm,
        "pixel_mm": statistics.pixel_mm,
        "column_mm": statistics.column_mm,
        "row_step_mm": statistics.row_step_mm,
    }
    if model.knows_amplitude:
        values["gain"] = model.amplitude
    if statistics.edge_pixels > 0:
        values["edge_invalid"] = statistics.invalid_share
    return values


def sensor_toml(
    base: str,
    tree: Mapping[str, Any],
    values: Mapping[str, float],
    image: Intrinsics,
    comments: Sequence[str],
) -> str:
    """Write the TOML text: rig and stages of the base with fitted values and intrinsics.

    values: fitted values by name. image: intrinsics of the recording; the base's distortion is
    dropped. comments: lines at the top of the file.
    """
    rig = {k: v for k, v in tree["rig"].items() if k != "distortion"}
    rig |= {
        "width": image.width, "height": image.height,
        "focal_px": [image.fx, image.fy], "centre_px": [image.cx, image.cy],
    }  # fmt: skip
    lines = [f"# {comment}".rstrip() for comment in comments]
    lines += [f"title = {_toml_value(f'fitted to a recording, from {base}')}", "", "[rig]"]
    lines += [f"{k} = {_toml_value(v)}" for k, v in rig.items() if k != "emitter"]
    for emitter in rig.get("emitter", []):
        lines += ["", "[[rig.emitter]]", *(f"{k} = {_toml_value(v)}" for k, v in emitter.items())]
    for stage in tree["stage"]:
        changed = {
            parameter: round(values[name], 4)
            for (use, parameter), name in _PLACES.items()
            if use == stage["use"] and name in values
        }
        lines += [
            "",
            "[[stage]]",
            *(f"{k} = {_toml_value(v)}" for k, v in {**stage, **changed}.items()),
        ]
    return "\n".join(lines) + "\n"


def _toml_value(value: Any) -> str:
    """Format a TOML value: string, number, boolean, array or inline table."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return json.dumps(value)
