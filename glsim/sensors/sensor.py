"""Sensors as data: a TOML file with the rig and the chain of noise stages.

title = "..."
extends = "azure-kinect"  optional: another sensor's name, or a path to a .toml file, relative to
                          this file's folder; this file has only the keys that differ
binning = 2               optional: this mode averages 2 x 2 pixels of the extended sensor into one
modes = [[848, 480, 423.8], [1280, 720, 640]]   optional: width, height and focal length, px, of all
                          modes of the depth camera; for recordings in other modes than [rig]
sheet = "kinect-v2"       optional: published measures for glsim validate; "": there are none
[rig]                     see glsim.sensors.rig_table
[[stage]]
use = "axial"             shipped stage, path of a .glsl file, or file.py:function
name = "axial"            optional; required if a stage is used twice
base_sigma_mm = 1.5       parameters: numbers or distributions; they replace the parameters of the
                          same stage in the extended file
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from glsim.core.camera import SensorRig
from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.plugins import load_plugin, plugin_file, plugin_names
from glsim.noise.chain import check_chain
from glsim.noise.layer_names import NO_PATTERN, PATTERN_LAYER, PROJECTOR_LAYER
from glsim.noise.registry import find_stage, is_code
from glsim.noise.rig_checks import MATCHER, check_rig
from glsim.noise.stage import ENABLED, Stage, StageSpec, make_stage
from glsim.sensors.images import SensorImage, read_pattern_map, read_projector_image
from glsim.sensors.rig_table import RigTable
from glsim.sensors.wiggling import Wave
from glsim.settings.distribution import Distribution, NumberSetting
from glsim.settings.schema import Settings, place_of
from glsim.settings.toml_tables import (
    TomlTable,
    first_problem,
    merge_tables,
    parse_table,
    read_toml,
)

SENSOR_FOLDER = Path(__file__).parent
#: Keys of the sensor file: the extended sensor, and the side of the square of binned pixels.
EXTENDS, BINNING = "extends", "binning"
#: (stage or "rig", key) -> power of the binning n by which the parameter is multiplied. Derived: a
#: mean of n^2 taps has 1 / n^2 of their variance. Microsoft's ranges of the modes agree: the same
#: noise from half of the light, (5.46 / 3.86)^2 = 2.0. The decoder's limits apply to the sum of the
#: pixels, as real binned frames with depth to 5.4 m show. Noise of single pixels averages out.
_BINNED = {
    ("rig", "width"): -1, ("rig", "height"): -1, ("rig", "focal_px"): -1, ("rig", "centre_px"): -1,
    ("tof_taps", "read_variance"): -2, ("tof_taps", "shot_variance"): -2,
    ("tof_taps", "psf_sigma_px"): -1, ("tof_smooth", "min_amplitude"): -2,
    ("tof_unwrap", "min_amplitude"): -2, ("tof_unwrap", "min_sum"): -2,
    ("tof_floor", "sigma_mm"): -1, ("fixed_pattern", "pixel_sigma_mm"): -1,
}  # fmt: skip
#: More steps of disparity per pixel than these leave no lattice in whole units of depth.
_MOST_STEPS = 64
#: Keys of [rig] that name a file, relative to the folder of the sensor file.
RIG_FILES = ("fixed_pattern_map", "projector_image")

#: A function that returns where a setting was given: ``glsim.settings.schema.place_of``.
_Place = Callable[..., str]

_DISTRIBUTION: TypeAdapter[Distribution] = TypeAdapter(NumberSetting)


class _SensorFile(TomlTable):
    title: str
    rig: RigTable
    sheet: str = ""
    modes: tuple[tuple[int, int, float], ...] = ()
    stage: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True)
class StageChange:
    """A change of a sensor's chain: new code for a stage of its file, or an additional stage.

    Args:
        spec: code of the stage. Parameters in the file that ``spec`` does not declare are dropped.
        before: the stage after a new stage; None: the first stage on arrays, or the chain's end.
    """

    name: str
    spec: StageSpec
    before: str | None = None


@dataclass(frozen=True)
class Sensor:
    """A depth camera: its rig and its chain of noise stages.

    Args:
        pattern_map: the device's pattern for the stage ``fixed_pattern``; None: it samples one.
        projector_image: the emitters' image over ``projector_view_deg``, degrees (horizontal,
            vertical); None: the light stage draws dots.
        wiggling: the device's error for ``remove_wiggling``; the light stage does not read it.
        sheet: name of the sheet of ``glsim validate`` with published measures; "": none.
        modes: (width, height, focal length), px, of each mode of the depth camera.
    """

    name: str
    title: str
    rig: SensorRig
    stages: tuple[Stage, ...]
    file: Path
    pattern_map: SensorImage | None = None
    wiggling: tuple[Wave, ...] = ()
    projector_image: SensorImage | None = None
    projector_view_deg: tuple[float, float] | None = None
    sheet: str = ""
    modes: tuple[tuple[int, int, float], ...] = ()

    @property
    def matcher(self) -> Stage | None:
        """The stage that matches two images; None if the chain has none."""
        return next((s for s in self.stages if s.spec.name == MATCHER), None)

    @property
    def steps_per_px(self) -> float:
        """Steps of disparity per pixel, if the depths lie on a lattice; else 0."""
        named = ("subpixel_steps", "steps_per_px")
        found = [s.settings[n].bounds()[0] for s in self.stages for n in named if n in s.settings]
        return found[0] if found and found[0] <= _MOST_STEPS else 0.0

    @property
    def images(self) -> dict[str, NDArray[np.float32]]:
        """The images that stages read in every frame: name of the layer -> float32 array."""
        images = {}
        if self.pattern_map is not None:
            images[PATTERN_LAYER] = np.nan_to_num(self.pattern_map.values, nan=float(NO_PATTERN))
        if self.projector_image is not None:
            images[PROJECTOR_LAYER] = self.projector_image.values
        return images

    def describe(self) -> dict[str, Any]:
        """Describe the complete sensor as JSON values, for the header of a data set."""
        i, thrown = self.rig.intrinsics, self.projector_image
        described: dict[str, Any] = {
            "name": self.name,
            "title": self.title,
            "width": i.width,
            "height": i.height,
            "focal_px": [i.fx, i.fy],
            "centre_px": [i.cx, i.cy],
            "distortion": {
                name: value
                for name, value in asdict(self.rig.distortion).items()
                if value or name in ("k1", "k2", "k3", "p1", "p2")
            },
            "deliver": self.rig.deliver,
            **({"colour": asdict(self.rig.registered)} if self.rig.registered else {}),
            "emitters_m": [list(e.position_m) for e in self.rig.emitters],
            "emitter_spreads_m": [e.spread_m for e in self.rig.emitters],
            "emitter_shares": [list(e.shares) for e in self.rig.emitters],
            "path_from_m": list(self.rig.emitter_m),
            **({"imagers_m": [list(i) for i in self.rig.imagers_m]} if self.rig.imagers_m else {}),
            "modulation_mhz": list(self.rig.modulation_mhz),
            "supersample": self.rig.supersample,
            **({"exposure": asdict(self.rig.exposure)} if self.rig.exposure.parts() else {}),
            "stages": [
                {"name": s.name, "use": s.spec.name}
                | {k: v.model_dump(exclude_none=True) for k, v in s.settings.items()}
                for s in self.stages
            ],
            **({"fixed_pattern_map": self.pattern_map.digest} if self.pattern_map else {}),
        }
        if thrown is not None and self.projector_view_deg is not None:
            described["projector_image"] = {
                "digest": thrown.digest,
                "size_px": list(thrown.values.shape[::-1]),
                "view_deg": list(self.projector_view_deg),
            }
        return described


def shipped_sensors() -> list[str]:
    """Return the names of the shipped sensors, sorted."""
    return sorted(file.stem for file in SENSOR_FOLDER.glob("*.toml"))


def sensor_names() -> list[str]:
    """Return the names of the shipped sensors and of installed plug-ins, sorted."""
    shipped = shipped_sensors()
    return sorted([*shipped, *plugin_names("sensors", shipped)])


def sensor_file(name: str) -> Path:
    """Return the TOML file of a sensor, given its name or path. Raises ConfigError if unknown."""
    file = Path(name) if name.endswith(".toml") else SENSOR_FOLDER / f"{name}.toml"
    if name.endswith(".toml") or file.is_file():
        return file
    if name not in sensor_names():
        raise ConfigError(
            f"no such sensor {name!r} ({did_you_mean(name, sensor_names())}; "
            "your own: a path that ends in .toml)"
        )
    package = load_plugin("sensors", name, lambda o: plugin_file(o, file.name) is not None)
    return plugin_file(package, file.name) or file


def read_sensor_tree(file: Path, before: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Read the tables of a sensor file, merged with the file that it extends. Raises ConfigError.

    ``before``: the files that extend this file, to refuse a circle.
    """
    own = read_toml(file)
    if own.keys() & Settings.model_fields.keys() - _SensorFile.model_fields.keys():
        raise ConfigError(f"{file}: holds settings, not a sensor: give it as --config")
    base = own.pop(EXTENDS, None)
    if base is None:
        return own
    if not isinstance(base, str):
        raise ConfigError(f"{file}: {EXTENDS} must be the name of a sensor, not {base!r}")
    if file.resolve() in before:
        raise ConfigError(f"{file}: extends itself: let one of the files extend none")
    other = file.parent / base if base.endswith(".toml") else sensor_file(base)
    tree = read_sensor_tree(other, (*before, file.resolve()))
    _anchor(tree, other.parent)
    _bin(tree, own.pop(BINNING, 1), file)
    stages = own.pop("stage", [])
    merge_tables(tree, own)
    _merge_stages(tree, stages, file, other)
    return tree


def _bin(tree: dict[str, Any], binning: Any, file: Path) -> None:
    """Multiply the parameters of _BINNED, in place, for a mode that averages pixels."""
    if binning not in (1, 2, 4):
        raise ConfigError(f"{file}: {BINNING} must be 1, 2 or 4, not {binning!r}")
    named = {name_of_stage(stage, file): stage for stage in tree.get("stage", [])}
    named["rig"] = tree.get("rig", {})
    for (name, key), power in _BINNED.items():
        if key in named.get(name, {}):
            named[name][key] = _times(named[name][key], float(binning) ** power)


def _times(value: Any, factor: float) -> Any:
    """Multiply a number, or the numbers of a list or a distribution."""
    if isinstance(value, dict):
        return {name: _times(number, factor) for name, number in value.items()}
    if isinstance(value, list):
        return [_times(number, factor) for number in value]
    return value * factor if isinstance(value, int | float) else value


def _anchor(tree: dict[str, Any], folder: Path) -> None:
    """Make relative paths of a sensor file absolute, in place, for files in other folders."""
    rig = tree.get("rig", {})
    for key in RIG_FILES if isinstance(rig, dict) else ():
        if isinstance(file := rig.get(key), str) and file:
            rig[key] = str(folder.absolute() / file)
    for stage in tree.get("stage", []):
        use = stage.get("use") if isinstance(stage, dict) else None
        if isinstance(use, str) and (use.endswith(".glsl") or ".py:" in use):
            stage["use"] = str(folder.absolute() / use)


def _merge_stages(tree: dict[str, Any], own: Any, file: Path, other: Path) -> None:
    """Merge the stages ``own`` into those of the extended sensor file, in place; new ones last."""
    stages = tree.setdefault("stage", [])
    tables = (stages, own)
    if not all(isinstance(t, list) and all(isinstance(s, dict) for s in t) for t in tables):
        raise ConfigError(f"{file}: write each stage as a table of its own, [[stage]]")
    known = {name_of_stage(stage, other): stage for stage in stages}
    for stage in own:
        if (name := name_of_stage(stage, file)) in known:
            known[name].update(stage)
        else:
            stages.append(stage)


def name_of_stage(stage: Mapping[str, Any], file: Path) -> str:
    """Return the name of a [[stage]] table in the chain: ``name``, else the name of its code."""
    use = stage.get("use")
    if not isinstance(use, str):
        raise ConfigError(f'{file}: say which stage with use = "..."')
    stem = Path(use).stem if use.endswith(".glsl") else use.rpartition(":")[2]
    return str(stage.get("name", stem))


def sensor_of(settings: Settings, changes: Sequence[StageChange] = ()) -> Sensor:
    """Load the sensor named in the settings, with their changes to its rig and its stages."""
    place = partial(place_of, settings)
    daylight = settings.scene.daylight
    return load_sensor(settings.sensor, settings.stage, settings.rig, place, changes, daylight)


def sensor_code(settings: Settings) -> list[str]:
    """List the stages of the settings' sensor that are Python code, without running them.

    Raises ConfigError if the sensor's file cannot be read.
    """
    if not settings.sensor.endswith(".toml"):
        return []
    stages = read_sensor_tree(Path(settings.sensor)).get("stage", [])
    uses = [s.get("use") for s in stages if isinstance(s, dict)] if isinstance(stages, list) else []
    return [use for use in uses if isinstance(use, str) and is_code(use)]


def stage_parameters(stages: Iterable[Stage]) -> list[str]:
    """Return the names of all parameters of stages, as ``--set`` takes them."""
    return [f"{stage.name}.{key}" for stage in stages for key in stage.settings if key != ENABLED]


def load_sensor(
    name: str,
    overrides: Mapping[str, Mapping[str, Distribution]] | None = None,
    rig_overrides: Mapping[str, Any] | None = None,
    place: _Place = lambda *_: "the overrides",
    changes: Sequence[StageChange] = (),
    daylight: Distribution | None = None,
) -> Sensor:
    """Load a sensor by the name of a shipped sensor or plug-in, or the path of a sensor file.

    Args:
        overrides: stage -> parameter -> setting, which replaces the file's.
        rig_overrides: keys that replace those of the file's [rig].
        place: a function from an override's path, ("rig", key) or ("stage", name, parameter), to
            its place in messages.
        changes: stages with other code than in the file, and new stages.
        daylight: the parameter ``daylight`` of the stage that has one.

    Raises ConfigError: an unknown sensor, key, stage or parameter, or a value out of range.
    """
    file = sensor_file(name)
    tree = read_sensor_tree(file)
    merge_tables(tree.setdefault("rig", {}), rig_overrides or {})
    places: dict[tuple[str, ...], str]
    places = {("rig", key): place("rig", key) for key in rig_overrides or {}}
    table = parse_table(_SensorFile, tree, str(file), places)
    changed = {change.name: change for change in changes}
    stages = [
        _stage(entry, f"{file}: stage {number}", file.parent, changed, daylight)
        for number, entry in enumerate(table.stage, start=1)
    ]
    for change in changed.values():
        _insert(stages, change, place)
    if daylight and not any("daylight" in stage.spec.parameters for stage in stages):
        raise ConfigError(f"scene.daylight: no stage of sensor {file.stem!r} knows daylight")
    names = [stage.name for stage in stages]
    for stage_name in names:
        if names.count(stage_name) > 1:
            raise ConfigError(
                f'{file}: two stages are called {stage_name!r}: give each a name = "..."'
            )
    parameters = stage_parameters(stages)
    for stage_name, values in (overrides or {}).items():
        for key, value in values.items():  # one by one, so that a message names the wrong one
            where = place("stage", stage_name, key)
            if stage_name not in names:
                same = [name for name in parameters if name.endswith(f".{key}")]
                advice = did_you_mean(key if same else stage_name, names, elsewhere=same)
                raise ConfigError(
                    f"{where}: sensor {file.stem!r} has no stage {stage_name!r} ({advice})"
                )
            number = names.index(stage_name)
            spec, before = stages[number].spec, stages[number].settings
            stages[number] = make_stage(stage_name, spec, {**before, key: value}, where, parameters)
    rig = table.rig.rig()
    check_chain(stages, rig, str(file))
    check_rig(stages, rig, str(file))
    keys, view_deg = table.rig, table.rig.projector_view_deg
    pattern = _image_file(
        keys.fixed_pattern_map, "fixed_pattern_map", PATTERN_LAYER, stages, file, "'fixed_pattern'"
    )
    thrown = _image_file(
        keys.projector_image, "projector_image", PROJECTOR_LAYER, stages if rig.emitters else (),
        file, "'stereo_light' or 'pattern_light' and an emitter",
    )  # fmt: skip
    return Sensor(
        file.stem,
        table.title,
        rig,
        tuple(stages),
        file,
        read_pattern_map(pattern, (keys.height, keys.width)) if pattern else None,
        keys.wiggling,
        read_projector_image(thrown, view_deg, keys.focal_px) if thrown and view_deg else None,
        view_deg,
        table.sheet,
        table.modes or ((keys.width, keys.height, keys.focal_px[0]),),
    )


def _insert(stages: list[Stage], change: StageChange, place: _Place) -> None:
    """Insert a new stage into the chain. Raises ConfigError."""
    names = [stage.name for stage in stages]
    if change.before is not None and change.before not in names:
        raise ConfigError(
            f"the new stage {change.name!r} precedes {change.before!r}, which the sensor does not "
            f"have ({did_you_mean(change.before, names)})"
        )
    arrays = (n for n, stage in enumerate(stages) if stage.spec.function is not None)
    last = next(arrays, len(stages))
    before = last if change.before is None else names.index(change.before)
    where = place("stage", change.name)
    stages.insert(before, make_stage(change.name, change.spec, {}, where))


def _image_file(
    name: str, key: str, layer: str, stages: Sequence[Stage], file: Path, adding: str
) -> Path | None:
    """Return the path of an image of the rig, or None. Raises ConfigError if no stage reads it."""
    if not name:
        return None
    if not any(s.spec.source and layer in s.spec.source.reads for s in stages):
        raise ConfigError(
            f"{file}: rig.{key} is read by no stage: add stage {adding}, or leave it out"
        )
    return file.parent / name


def _stage(
    entry: Mapping[str, Any],
    where: str,
    folder: Path,
    changed: dict[str, StageChange],
    daylight: Distribution | None,
) -> Stage:
    """Make the stage of a [[stage]] table; if ``changed`` has a change of it, remove that."""
    settings = dict(entry)
    use = settings.pop("use", None)
    if not isinstance(use, str):
        raise ConfigError(f'{where}: say which stage with use = "..."')
    try:
        spec = find_stage(use, folder)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None
    name = settings.pop("name", spec.name)
    if name in changed:
        spec = changed.pop(name).spec
        settings = {k: v for k, v in settings.items() if k in {ENABLED, *spec.parameters}}
    parameters = {"daylight": daylight} if daylight and "daylight" in spec.parameters else {}
    for key, value in settings.items():
        try:
            parameters[key] = _DISTRIBUTION.validate_python(value)
        except ValidationError as error:
            _, message = first_problem(Distribution, error)
            raise ConfigError(f"{where}: {name}.{key}: {message}") from None
    return make_stage(name, spec, parameters, where)
