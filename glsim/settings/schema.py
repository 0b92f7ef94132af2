"""Settings: a frozen, validated object made from a TOML file and ``--set`` assignments.

layout.toml and the files of presets/ are examples; docs/reference/settings.md lists all settings.
An unknown key is an error that names similar keys. The GLSL file of a stage declares its
parameters; they are checked when the sensor is loaded (glsim.sensors.sensor).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import BeforeValidator, Field, PrivateAttr, SerializeAsAny, model_validator

from glsim.core.camera import DEFAULT_SENSOR
from glsim.core.errors import ConfigError, UnknownSettingError
from glsim.settings.distribution import Distribution, NumberSetting, Scope, constant
from glsim.settings.presets import read_preset
from glsim.settings.source_settings import SourceSettings, parse_source
from glsim.settings.toml_tables import (
    TomlTable,
    assign,
    flattened,
    meant,
    merge_tables,
    parse_table,
    read_toml,
    split_assignment,
)

LayerName = Literal[
    "clean", "noisy", "infrared", "infrared_right", "reason", "regions", "expected", "normals",
    "color",
]  # fmt: skip
DEPTH_UNIT_MM = (0.01, 10.0)
"""Smallest and largest step of depth files, mm."""
SPLIT_NAMES = ("train", "val", "test")
PAPER_SPLIT = "paper"
"""The value of ``split`` that divides images instead of people: glsim.simulation.plan.split."""
FARTHEST_MM = DEPTH_UNIT_MM[1] * 65_535
"""Largest depth of 16-bit files, mm, with the coarsest step."""
_TURN = (-360.0, 360.0)
POSE_LIMITS = {
    "distance_mm": (50.0, FARTHEST_MM), "x_mm": (-2e4, 2e4), "y_mm": (-2e4, 2e4),
    "yaw_deg": _TURN, "pitch_deg": _TURN, "roll_deg": _TURN, "motion": (0.0, 5.0),
}  # fmt: skip
"""Limits of the numbers in [pose]: a head is 50 mm deep before its centre, and files of 16 bits end
at the largest distance; the others are chosen, motion for turns of 30 degrees in a sequence."""
VARIATION_LIMITS = {"shape_mm": (0.0, 6.0), "albedo": (0.0, 2.0)}
"""Limits of the numbers in [variation]. The values were chosen, not measured."""

#: Limits of a room's numbers, chosen to fit homes and offices.
SCENE_LIMITS = {
    "wall_mm": POSE_LIMITS["distance_mm"], "behind_mm": (400, 8000), "width_mm": (1500, 10_000),
    "height_mm": (2000, 5000), "turn_deg": (-180, 180), "eye_mm": (300, 2300),
    "camera_mm": (100, 2400), "clutter": (0, 1), "people": (0, 6), "albedo": (0.1, 1.5),
    "daylight": (0, 2),
}  # fmt: skip


def _number(default: float | tuple[float, float], description: str) -> Any:
    setting = Distribution(uniform=default) if isinstance(default, tuple) else constant(default)
    return Field(setting, description=description)


#: Numbers of which the median must lie within the limits: a frame with a sample beyond is skipped.
_MEDIANS = ("distance_mm", "wall_mm")


class _Limited(TomlTable):
    """A table whose numbers, and samples of their distributions, must lie within limits."""

    limits: ClassVar[Mapping[str, tuple[float, float]]]

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        for name, (least, most) in self.limits.items():
            if (setting := getattr(self, name)) is None:
                continue
            low, high = [setting.typical] * 2 if name in _MEDIANS else setting.bounds()
            if low < least or high > most:
                wrong = low if low < least else high
                limit = f"[{least:g}, {most:g}]{' mm' if name.endswith('_mm') else ''}"
                hint = meant(name, wrong, least, most)
                raise ValueError(f"{name} may be {wrong:g}, but must lie in {limit}{hint}")
        return self


class PoseSettings(_Limited):
    """Pose of the head in front of the sensor; positive angles turn it to its own left, or up."""

    limits = POSE_LIMITS
    distance_mm: NumberSetting = _number(900.0, "sensor to centre of the face, along z")
    x_mm: NumberSetting = _number(0.0, "to the right in the image")
    y_mm: NumberSetting = _number(0.0, "down in the image")
    yaw_deg: NumberSetting = _number(0.0, "head turned to its own left")
    pitch_deg: NumberSetting = _number(0.0, "head raised")
    roll_deg: NumberSetting = _number(0.0, "head tilted to its own left")
    motion: NumberSetting = _number(1.0, "sway, nods, turns of generated faces, times this")


class MotionSettings(TomlTable):
    """Motion of the head during the exposure of a frame."""

    within_exposure: bool = Field(
        False,
        description="draw the scene at the time of each part of the exposure (rig.exposure): nine "
        "captures of a time-of-flight camera, bands of rows of a rolling shutter",
    )
    x_mm_s: NumberSetting = _number(0.0, "speed to the right, added to that of the sequence")
    y_mm_s: NumberSetting = _number(0.0, "speed down")
    z_mm_s: NumberSetting = _number(0.0, "speed away from the sensor")
    yaw_deg_s: NumberSetting = _number(0.0, "turn to its own left")
    pitch_deg_s: NumberSetting = _number(0.0, "turn upwards")
    roll_deg_s: NumberSetting = _number(0.0, "tilt to its own left")


#: Name of a speed in [motion] -> the number of the pose that it changes.
SPEEDS = {
    f"{name.replace('distance', 'z')}_s": name
    for name in ("x_mm", "y_mm", "distance_mm", "yaw_deg", "pitch_deg", "roll_deg")
}


class VariationSettings(_Limited):
    """Random changes of a head's shape and albedo, to vary the faces of one face model."""

    limits = VARIATION_LIMITS
    shape_mm: NumberSetting = _number(0.0, "standard deviation of a smooth warp of the head")
    albedo: NumberSetting = _number(0.0, "standard deviation of the log of the albedo, in patches")
    per: Scope = Field("subject", description="one draw per frame, sequence or subject")


class AppearanceSettings(TomlTable):
    """Hair, beard, glasses and clothes, sampled for each subject; a share of 0 means nobody."""

    wear: Literal["auto", "always", "never"] = Field(
        "auto", description="auto: people are dressed, procedural and ict-facekit heads are not"
    )
    # Shares without a source were chosen, e.g. that every second man has a beard or stubble.
    hair: float = Field(0.96, ge=0, le=1, description="share of subjects with hair, also shaven")
    beard: float = Field(0.25, ge=0, le=1, description="share with a beard, moustache or stubble")
    brows: float = Field(1.0, ge=0, le=1, description="share with brows in relief")
    # 64 % of adults have glasses (The Vision Council); 54 % of these wear them most of the time.
    glasses: float = Field(0.35, ge=0, le=1, description="share with glasses")
    cloth: float = Field(1.0, ge=0, le=1, description="share with cloth over neck and body")
    hat: float = Field(0.0, ge=0, le=1, description="share with a cap, a beanie or a hat")
    headphones: float = Field(0.0, ge=0, le=1, description="share of the others with headphones")
    hand: float = Field(0.0, ge=0, le=1, description="share of heads without a body with a hand")
    gloss: bool = Field(False, description="mirror light of dressed subjects: skin, eyes, glasses")


class SceneSettings(_Limited):
    """The surroundings of the face: nothing, a plain wall, or a room."""

    limits = SCENE_LIMITS
    wall_mm: NumberSetting | None = Field(None, description="distance of a wall; default: none")
    wall_albedo: float = Field(0.85, ge=0, le=1, description="relative to a white wall")
    room: Literal["none", "empty", "office", "living-room"] = Field(
        "none", description="floor, walls, doors, windows and, unless empty, furniture"
    )
    per: Scope = Field("subject", description="one room per frame, sequence or subject")
    behind_mm: NumberSetting = _number((1000.0, 3000.0), "from the face to the room's back wall")
    width_mm: NumberSetting = _number((3000.0, 5500.0), "width of the room")
    height_mm: NumberSetting = _number((2400.0, 2700.0), "height of the room")
    turn_deg: NumberSetting = _number((-30.0, 30.0), "turn of the room about the vertical axis")
    eye_mm: NumberSetting = _number(1200.0, "height of a head without a body above the floor")
    camera_mm: NumberSetting | None = Field(
        None, description="height of the camera, which tilts to the face; default: the face's"
    )
    clutter: NumberSetting = _number(0.6, "amount of furniture, 0 to 1")
    people: NumberSetting = _number(0.0, "other people behind, for sources of whole bodies")
    albedo: NumberSetting = _number(1.0, "factor of all albedos of the room")
    daylight: NumberSetting | None = Field(
        None, description="irradiance of daylight at 850 nm, W/m^2/nm; default: none"
    )

    @model_validator(mode="after")
    def _check(self) -> SceneSettings:
        if self.room != "none" and self.wall_mm is not None:
            raise ValueError("wall_mm: a room has walls of its own: give a wall or a room")
        return self


def _words(value: object) -> object:
    return [part.strip() for part in value.split(",")] if isinstance(value, str) else value


class OutputSettings(TomlTable):
    """Layers, file format and size of the frames that are written."""

    format: Literal["png", "webdataset"] = Field("png", description="PNG files, or shards")
    frames_per_shard: int | None = Field(None, ge=1, le=8192, description="default: 512")
    layers: Annotated[tuple[LayerName, ...], BeforeValidator(_words)] = Field(
        ("clean", "noisy"), description="images of each frame"
    )
    crop: int | None = Field(None, ge=8, le=4096, description="side of the centre crop, pixels")
    depth_unit_mm: float = Field(
        1.0, ge=DEPTH_UNIT_MM[0], le=DEPTH_UNIT_MM[1], description="one step of a depth file"
    )
    clean_mask: Literal["dense", "as-noisy"] = Field(
        "dense", description="as-noisy: remove clean depth where the noisy map has none"
    )
    landmarks: bool = Field(False, description="record 68 landmarks: 3D, pixels, visibility")
    nearest_to_mm: float | None = Field(
        None, ge=1, description="shift each frame so that its nearest clean point has this depth"
    )

    @model_validator(mode="after")
    def _check(self) -> OutputSettings:
        if len(set(self.layers)) != len(self.layers) or not self.layers:
            raise ValueError(
                f"layers must be one or more of {', '.join(get_args(LayerName))}, once"
            )
        if self.frames_per_shard is not None and self.format != "webdataset":
            raise ValueError("frames_per_shard needs format=webdataset: PNG files have no shards")
        return self


_Shares = tuple[float, float, float]


_Source = Annotated[
    SerializeAsAny[SourceSettings],
    BeforeValidator(lambda given: parse_source(given) if isinstance(given, Mapping) else given),
]


def _split(value: object) -> object:
    if value == PAPER_SPLIT:
        return value
    value = _words(value)
    if isinstance(value, list | tuple) and len(value) != len(SPLIT_NAMES):
        raise ValueError(f"give {len(SPLIT_NAMES)} shares ({', '.join(SPLIT_NAMES)})")
    return value


class Settings(TomlTable):
    """All settings of a data set; equal settings give equal bytes."""

    sensor: str = Field(DEFAULT_SENSOR, description="a shipped sensor, or the path of a .toml file")
    seed: int = Field(0, ge=0, lt=2**63, description="the same seed gives the same bytes")
    devices: int = Field(1, ge=1, description="virtual devices, each with its own fixed pattern")
    split: Annotated[_Shares | Literal["paper"], BeforeValidator(_split)] = Field(
        (0.70, 0.12, 0.18), description="shares of train, val, test by subject; paper: the paper's"
    )
    source: Annotated[
        tuple[_Source, ...],
        BeforeValidator(lambda one: (one,) if isinstance(one, Mapping | SourceSettings) else one),
    ] = Field(({},), validate_default=True)
    pose: PoseSettings = PoseSettings()
    motion: MotionSettings = MotionSettings()
    variation: VariationSettings = VariationSettings()
    appearance: AppearanceSettings = AppearanceSettings()
    redraw: Literal["sequence"] | None = Field(
        None,
        description="sequence: what would be drawn for each frame is drawn once per sequence, as "
        "in a video of one device; only the noise is new in each frame",
    )
    scene: SceneSettings = SceneSettings()
    rig: dict[str, Any] = Field(default_factory=dict, description="overrides the sensor's [rig]")
    #: Path of a setting -> "--set TEXT", as the user wrote it.
    _places: dict[tuple[str, ...], str] = PrivateAttr(default_factory=dict)
    _given: frozenset[str] = PrivateAttr(frozenset())  # by the user, not by a preset: dotted names
    stage: dict[str, dict[str, NumberSetting]] = Field(
        default_factory=dict, description="parameters of the sensor's noise stages, by stage"
    )
    output: OutputSettings = OutputSettings()
    strict: bool = Field(False, description="stop at the first bad frame instead of recording it")

    def __eq__(self, other: object) -> bool:
        """Compare the values of settings, but not where the user wrote them."""
        return isinstance(other, Settings) and self.__dict__ == other.__dict__

    @model_validator(mode="after")
    def _check(self) -> Settings:
        if not isinstance(self.split, str) and (
            any(s < 0 or not math.isfinite(s) for s in self.split)
            or abs(sum(self.split) - 1) > 1e-6
        ):
            raise ValueError(f"split {list(self.split)}: the shares must be >= 0 and add up to 1")
        if not self.source:
            raise ValueError("source: at least one is needed")
        problem = next(filter(None, (source.room_problem() for source in self.source)), "")
        if problem and self.scene.room != "none":
            raise ValueError(problem)
        wall, face = self.scene.wall_mm, self.pose.distance_mm
        if wall is not None and wall.bounds()[1] <= face.bounds()[0]:
            raise ValueError(
                f"scene.wall_mm: the wall, at {wall.bounds()[1]:g} mm at most, always stands in "
                f"front of the face, at {face.bounds()[0]:g} mm at least"
            )
        return self


def place_of(settings: Settings, *path: str) -> str:
    """Return where the user gave a setting, for messages: a --set option, or the settings."""
    options = (text for at, text in settings._places.items() if at[: len(path)] == path)
    return next(options, "settings (--set or --config)")


def changed(settings: Settings) -> set[str]:
    """Return the names, such as pose.yaw_deg, of settings that the user changed, not a preset."""
    now, default = (flattened(each.model_dump(mode="json")) for each in (settings, Settings()))
    differ = [f"{name}." for name, value in now.items() if value != default.get(name)]
    return {name for name in settings._given if any(d.startswith(f"{name}.") for d in differ)}


def load_settings(
    file: Path | None = None,
    assignments: Iterable[str] = (),
    overrides: Mapping[str, Any] | None = None,
    source: Mapping[str, Any] | None = None,
    preset: str | None = None,
) -> Settings:
    """Load settings from a preset, a TOML file, assignments ``a.b=value`` and nested ``overrides``.

    Args:
        overrides: nested dicts, which replace values of the file.
        source: overrides of the single [source] table.
        preset: name of a shipped preset. If ``source`` is of another kind, only the numbers of
            subjects and frames are taken from the preset's [source].

    Raises ConfigError: a file that cannot be read, an unknown key or an invalid value.
    """
    tree: dict[str, Any] = read_toml(file) if file is not None else {}
    if "extends" in tree or isinstance(tree.get("stage"), list):
        raise ConfigError(
            f"{file}: holds no settings: give a sensor as --sensor, a recipe to train"
        )
    where = str(file) if file is not None else "settings"
    places: dict[tuple[str, ...], str] = {}
    for text in assignments:
        path, value = parse_assignment(text)
        assign(tree, path, value, text)
        places[tuple(path)] = f"--set {text}"
    merge_tables(tree, overrides or {})
    if source:
        if isinstance(tree.get("source"), list):
            raise ConfigError(f"{where}: has several [[source]] tables: set them there")
        merge_tables(tree.setdefault("source", {}), source)
    given = frozenset(flattened(tree))
    if preset is not None:
        tree = _over_preset(read_preset(preset), tree)
    try:
        settings = parse_table(Settings, tree, where, places)
    except UnknownSettingError as error:
        error.sensor = tree.get("sensor", DEFAULT_SENSOR)
        raise
    settings = settings.model_copy(update={"source": tuple(map(_with_counts, settings.source))})
    settings._places, settings._given = places, given
    return settings


def with_assignments(settings: Settings, values: Mapping[str, Any]) -> Settings:
    """Return settings with changed values, named as for ``--set``: {"tof_floor.sigma_mm": 2}.

    A value is a number, a distribution as in a file ({"uniform": [1, 3]}), or any other value of
    a settings file. Raises ConfigError for a name or value that ``load_settings`` would refuse.
    """
    tree = settings.model_dump(exclude_none=True)
    places: dict[tuple[str, ...], str] = {}
    for name, value in values.items():
        path = _settings_path(name.split("."))
        assign(tree, path, value, f"{name}={value}")
        places[tuple(path)] = name
    return parse_table(Settings, tree, "settings", places)


def _settings_path(path: list[str]) -> list[str]:
    """Prefix the path of a stage's parameter with "stage"."""
    return ["stage", *path] if len(path) == 2 and path[0] not in Settings.model_fields else path


#: The settings that every kind of source has, and their defaults for a source that never ends.
_COUNTS = {"subjects": 10, "frames_per_subject": 30}


def _over_preset(tree: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    preset_source, source = tree.get("source", {}), given.get("source", {})
    kinds = {s.get("kind") for s in (source if isinstance(source, list) else [source])}
    if kinds - {None, preset_source.get("kind")}:
        counts = {name: preset_source[name] for name in _COUNTS if name in preset_source}
        tree["source"] = {} if isinstance(source, list) else counts
    if "wall_mm" in given.get("scene", {}):
        tree.get("scene", {}).pop("room", None)
    merge_tables(tree, given)
    return tree


def _with_counts(source: SourceSettings) -> SourceSettings:
    counts = {name: getattr(source, name) or count for name, count in _COUNTS.items()}
    return source.model_copy(update=counts) if source.endless else source


def parse_assignment(text: str) -> tuple[list[str], Any]:
    """Split ``"axial.base_sigma_mm=2.5"`` into (["stage", "axial", "base_sigma_mm"], 2.5).

    Like ``split_assignment``, but a first word that is not a settings table names a noise stage.
    """
    path, value = split_assignment(text, "axial.base_sigma_mm=2.5 or pose.yaw_deg=20")
    return _settings_path(path), value
