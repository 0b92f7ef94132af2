"""A fitted sensor as a TOML file: a shipped sensor with the numbers of a recording."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from glsim.camera import Intrinsics
from glsim.errors import ConfigError, did_you_mean
from glsim.fit.model import Model
from glsim.fit.statistics import Statistics
from glsim.sensor import SENSOR_FOLDER, sensor_names
from glsim.toml import read_toml

#: Sensors that a fit can start from, the cheapest first.
BASES = ("kinect-v2-fast", "kinect-v2")

#: Where sensors keep what is fitted: stage, parameter -> name of the fitted value.
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
    """Name and TOML tree of what to start from. Raises ConfigError for one that cannot serve."""
    chosen = name or next(b for b in BASES if b in sensor_names())
    if chosen not in BASES or chosen not in sensor_names():
        raise ConfigError(f"no fit starts from {chosen!r} ({did_you_mean(chosen, BASES)})")
    return chosen, read_toml(SENSOR_FOLDER / f"{chosen}.toml")


def fitted_values(found: Statistics, model: Model) -> dict[str, float]:
    """The numbers to write; what the recording does not tell is left out."""
    values = {
        "floor_mm": model.floor_mm,
        "pixel_mm": found.pixel_mm,
        "column_mm": found.column_mm,
        "row_step_mm": found.row_step_mm,
    }
    if model.knows_amplitude:
        values["gain"] = model.amplitude
    if found.edge_pixels > 0:
        values["edge_invalid"] = found.invalid_share
    return values


def sensor_text(
    base: str,
    tree: Mapping[str, Any],
    values: Mapping[str, float],
    image: Intrinsics,
    comments: Sequence[str],
) -> str:
    """The TOML file: the base's rig and stages with the fitted values and the camera's image."""
    rig = {k: v for k, v in tree["rig"].items() if k != "distortion"}
    rig |= {
        "width": image.width, "height": image.height,
        "focal_px": [image.fx, image.fy], "centre_px": [image.cx, image.cy],
    }  # fmt: skip
    lines = [f"# {comment}".rstrip() for comment in comments]
    lines += [f"title = {_value(f'fitted to a recording, from {base}')}", "", "[rig]"]
    lines += [f"{k} = {_value(v)}" for k, v in rig.items() if k != "emitter"]
    for emitter in rig.get("emitter", []):
        lines += ["", "[[rig.emitter]]", *(f"{k} = {_value(v)}" for k, v in emitter.items())]
    for stage in tree["stage"]:
        changed = {
            parameter: round(values[name], 4)
            for (use, parameter), name in _PLACES.items()
            if use == stage["use"] and name in values
        }
        lines += ["", "[[stage]]", *(f"{k} = {_value(v)}" for k, v in {**stage, **changed}.items())]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    """A TOML value: strings, numbers, booleans, arrays and inline tables."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return json.dumps(value)
