"""Describe sensors and their chains as JSON values, for the page without a server.

The page runs the GLSL itself: it gets the files, the patterns by which declarations are read, the
settings of each stage, and numbers drawn here for sensors whose settings are distributions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from glsim.gl.declarations import Parameter, declaration_patterns
from glsim.gl.includes import SHADER_ROOT, display_name, included_text
from glsim.gl.shader_source import load_source
from glsim.noise.layer_names import BLANK, EXPECTED_LAYER
from glsim.noise.stage import ENABLED, Stage, draw_values
from glsim.reason import Reason
from glsim.sensors.sensor import Sensor
from glsim.settings.distribution import Distribution, DrawKeys
from glsim.settings.seeds import stable_seed
from glsim.tune.state import toml_value

#: The shared passes that the page draws besides the stages.
VERTEX, SILHOUETTE = "render/fullscreen.vert", "render/silhouette.frag"

#: Cameras that "draw another camera" steps through, for sensors whose settings are distributions.
CAMERAS = 40

#: Frames a second while the page plays; a chosen rate, that of the Kinects.
FRAMES_PER_SECOND = 30


def describe_chains(sensors: Sequence[Sensor]) -> dict[str, Any]:
    """Return sensors, reasons and GLSL files (with all that stages may include) as JSON values."""
    files = {VERTEX: included_text(VERTEX), SILHOUETTE: included_text(SILHOUETTE)}
    for library in sorted((SHADER_ROOT / "lib").glob("*.glsl")):
        files[display_name(library)] = included_text(display_name(library))
    for sensor in sensors:
        for stage in sensor.stages:
            if stage.spec.source is not None:
                names = {display_name(Path(stage.spec.file))}
                names |= {name for name, _ in stage.spec.source.lines}
                files |= {name: included_text(name) for name in sorted(names)}
    return {
        "patterns": declaration_patterns(),
        "files": files,
        "vertex": VERTEX,
        "silhouette": SILHOUETTE,
        "blank": BLANK,
        "frames_per_second": FRAMES_PER_SECOND,
        "reasons": [{"name": r.name, "help": r.help, "has_depth": r.has_depth} for r in Reason],
        "sensors": {sensor.name: describe_sensor(sensor) for sensor in sensors},
    }


def describe_sensor(sensor: Sensor) -> dict[str, Any]:
    """Return a sensor's rig, stages and drawn cameras as JSON values.

    ``drawn`` names the settings that are distributions, ``cameras`` has their values per camera.
    """
    camera = sensor.rig.intrinsics
    drawn: list[str] = []
    cameras: list[list[float]] = []
    for number in range(CAMERAS):
        values, _ = draw_values(sensor.stages, camera_keys(number))
        if not values:
            break
        drawn = list(values)
        cameras.append(list(values.values()))
    return {
        "title": sensor.title,
        "rig": {
            "width": camera.width,
            "height": camera.height,
            "focal_px": [camera.fx, camera.fy],
            "centre_px": [camera.cx, camera.cy],
        },
        "stages": [_stage(stage) for stage in sensor.stages],
        "drawn": drawn,
        "cameras": cameras,
    }


def camera_keys(number: int) -> DrawKeys:
    """Return the seeds of the page's camera ``number``."""
    seed = stable_seed("camera", number)
    return DrawKeys(seed, seed, seed)


def describe_source(file: Path) -> dict[str, Any]:
    """Return a stage's declarations as the page reads them from its text, as JSON values."""
    source = load_source(file)
    if source.uses("EXPECTED"):
        source = source.without(EXPECTED_LAYER)
    return {
        "parameters": [_parameter(p) for p in source.parameters.values()],
        "reads": list(source.reads),
        "writes": [[layer.name, layer.type, str(layer.scale)] for layer in source.writes],
        "bound": list(source.bound),
        "sparse": source.sparse,
    }


def _stage(stage: Stage) -> dict[str, Any]:
    """Describe a stage: constant parameters in ``settings``, distributions in ``ranges``."""
    array = stage.spec.source is None
    parameters = [_parameter(p) for p in stage.spec.parameters.values()] if array else []
    return {
        "name": stage.name,
        "title": stage.spec.title,
        "array": array,
        "file": "" if array else display_name(Path(stage.spec.file)),
        "parameters": parameters,
        "settings": {k: s.constant for k, s in stage.settings.items() if s.is_constant},
        "ranges": {
            k: _in_words(s) for k, s in stage.settings.items() if not s.is_constant and k != ENABLED
        },
    }


def _parameter(p: Parameter) -> dict[str, Any]:
    return {
        "name": p.name,
        "type": p.type,
        "default": p.default,
        "low": p.low,
        "high": p.high,
        "unit": p.unit,
        "help": p.help,
        "slider": None if p.slider is None else list(p.slider),
        "log_scale": p.log_scale,
        "step": p.step,
    }


def _in_words(setting: Distribution) -> str:
    table = setting.model_dump(exclude_none=True, exclude_defaults=True)
    return ", ".join(f"{kind} {toml_value(value)}" for kind, value in table.items())
