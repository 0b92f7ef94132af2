"""The study of ``glsim transfer`` as data: sensors, faces, scenes, test sets, training, goals.

    title = "..."                       description of the study
    [goals]                             see ``Goals``
    [[sensor]]                          one family of sensors each
    name = "kinect-v2"                  name in tables and folders
    sensor = "kinect-v2"                a shipped sensor or a .toml file; default: the name
    tof = true                          time of flight: its goal is stricter
    train_people = 0                    default: as in [train]; 0: only tested, never trained on
    optional = true                     left out, instead of an error, where glsim has no such one
    settings = { devices = 64 }         settings of its data sets, as in a file for glsim generate
    train_variants = { wide = { } }     further settings, each with training sets of its own
    [[source]]                          one source of faces each
    name = "heads"
    kind = "procedural"                 as source.kind of glsim generate; root: its folder
    [[scene]]                           what is around the faces; every cell has all of them
    name = "wall"
    settings = { scene.wall_mm = 2000 }
    [test]                              people, tune_people, frames, seed, crop, settings
    [train]                             the same, and recipe, steps, set

A cell is a sensor with a source of faces. Tables merge in the order [test] or [train], [[scene]],
[[sensor]], [[source]].
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, StringConstraints, model_validator

from glsim.errors import ConfigError
from glsim.settings.schema import Settings, load_settings
from glsim.settings.tables import TomlTable, merge_tables

#: Names become folders, and parts of --leave.
_Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=60)]
#: Step of the depth files, mm; chosen, rounding adds 0.03 mm.
_UNIT_MM: Final = 0.1


class Goals(TomlTable):
    """Goals of a network. Ratios are those of the means over frames."""

    tof_ratio: float = Field(
        0.85, gt=0, description="largest ratio to the best filter, time-of-flight sensors"
    )
    other_ratio: float = Field(
        1.02, gt=0, description="largest ratio to the best filter, other sensors"
    )
    flips_ratio: float = Field(1.0, gt=0, description="largest ratio of flips to the input's")
    flying_ratio: float = Field(
        0.5, gt=0, description="largest ratio of flying pixels to the input's"
    )
    bias_mm: float = Field(0.15, gt=0, description="largest bias in a bin of distance")


class SensorFamily(TomlTable):
    """A family of sensors."""

    name: _Name
    sensor: str = ""
    tof: bool = False
    train_people: int | None = Field(None, ge=0)
    optional: bool = False
    settings: dict[str, Any] = Field(default_factory=dict)
    train_variants: dict[_Name, dict[str, Any]] = Field(default_factory=dict)

    @property
    def file(self) -> str:
        """The shipped sensor or the path of the sensor file."""
        return self.sensor or self.name


class FaceFamily(TomlTable):
    """A source of faces."""

    name: _Name
    kind: Literal["procedural", "ict-facekit", "people"]
    root: Path | None = None
    optional: bool = False
    settings: dict[str, Any] = Field(default_factory=dict)


class SceneFamily(TomlTable):
    """What is around the faces."""

    name: _Name
    settings: dict[str, Any] = Field(default_factory=dict)


class _DataTable(TomlTable):
    frames: int = Field(4, ge=1, description="frames per person")
    crop: int = Field(128, ge=8, le=4096)
    settings: dict[str, Any] = Field(default_factory=dict)


class TestData(_DataTable):
    """The test set of each cell and scene."""

    people: int = Field(20, ge=2, description="scored people")
    tune_people: int = Field(5, ge=1, description="other people, on whom filters are tuned")
    seed: int = Field(2000, ge=0, lt=2**63)


class TrainingPlan(_DataTable):
    """The training of each network, and its part of data of each cell and scene."""

    people: int = Field(100, ge=1)
    val_people: int = Field(6, ge=1, description="other people, for the validation")
    seed: int = Field(1000, ge=0, lt=2**63)
    recipe: str = "face"
    steps: int = Field(5000, ge=1)
    set: tuple[str, ...] = Field((), description="changes to the recipe, as --set of glsim train")


@dataclass(frozen=True)
class DataSet:
    """A data set of the study.

    Attributes:
        people: numbers of people to train, validate and test.
        variant: name of a variant of the sensor; "" for none.
    """

    part: Literal["train", "test"]
    sensor: SensorFamily
    source: FaceFamily
    scene: SceneFamily
    people: tuple[int, int, int]
    frames_per_person: int
    variant: str = ""

    @property
    def cell(self) -> Path:
        """Names of its sensor, source and scene."""
        sensor = f"{self.sensor.name}-{self.variant}" if self.variant else self.sensor.name
        return Path(sensor) / self.source.name / self.scene.name

    @property
    def place(self) -> Path:
        """Its folder in the folder of the study."""
        return Path("data") / self.part / self.cell

    @property
    def frames(self) -> int:
        """Its number of frames."""
        return sum(self.people) * self.frames_per_person


class TransferStudy(TomlTable):
    """A study; the docstring of the module describes the keys."""

    title: str
    truth: Literal["expected", "clean"] = "expected"
    goals: Goals = Goals()
    sensor: tuple[SensorFamily, ...] = Field(min_length=1)
    source: tuple[FaceFamily, ...] = Field(min_length=1)
    scene: tuple[SceneFamily, ...] = (SceneFamily(name="alone"),)
    test: TestData = TestData()
    train: TrainingPlan = TrainingPlan()

    @model_validator(mode="after")
    def _check(self) -> TransferStudy:
        for kind in ("sensor", "source", "scene"):
            names = [entry.name for entry in getattr(self, kind)]
            if twice := {name for name in names if names.count(name) > 1}:
                raise ValueError(f"{kind}: two are called {min(twice)!r}")
        if self.train.seed == self.test.seed:
            raise ValueError(f"train.seed and test.seed are both {self.test.seed}: the same people")
        return self

    @property
    def trainable(self) -> tuple[SensorFamily, ...]:
        """The sensors that training may use."""
        return tuple(sensor for sensor in self.sensor if sensor.train_people != 0)

    def test_sets(self, sensor: SensorFamily, source: FaceFamily) -> list[DataSet]:
        """Return the test sets of a cell, one per scene."""
        people = (0, self.test.tune_people, self.test.people)
        return [
            DataSet("test", sensor, source, scene, people, self.test.frames) for scene in self.scene
        ]

    def training_sets(self, sensor: SensorFamily, source: FaceFamily) -> list[DataSet]:
        """Return what to train on for a sensor and a source: one data set per scene and variant."""
        count = self.train.people if sensor.train_people is None else sensor.train_people
        people = (count, self.train.val_people, 0)
        return [
            DataSet("train", sensor, source, scene, people, self.train.frames, variant)
            for variant in ("", *sensor.train_variants)
            for scene in self.scene
        ]

    def settings_of(self, data: DataSet) -> Settings:
        """Return the settings of a data set. Raises ConfigError."""
        common = self.test if data.part == "test" else self.train
        total = sum(data.people)
        tree: dict[str, Any] = copy.deepcopy(common.settings)
        variant = data.sensor.train_variants[data.variant] if data.variant else {}
        for table in (data.scene.settings, data.sensor.settings, variant, data.source.settings):
            merge_tables(tree, copy.deepcopy(table))
        layers = ("clean", "noisy") if self.truth == "clean" else ("clean", "expected", "noisy")
        fixed = {
            "sensor": data.sensor.file,
            "seed": common.seed,
            "split": [count / total for count in data.people],
            "output": {"crop": common.crop, "depth_unit_mm": _UNIT_MM, "layers": layers},
        }
        merge_tables(tree, fixed)
        source = {
            "kind": data.source.kind,
            "root": data.source.root,
            "subjects": total,
            "frames_per_subject": data.frames_per_person,
        }
        try:
            return load_settings(None, (), tree, source)
        except ConfigError as error:
            raise ConfigError(f"{data.place}: {error}") from None
