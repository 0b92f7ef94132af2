"""Definition of a transfer study in TOML: sensors, faces, scenes, test sets and training.

    title = "..."                       description of the study
    truth = "expected"                  layer that maps are compared with, or clean
    [[sensor]]                          one family of sensors each
    name = "kinect-v2"                  name in tables and folders
    sensor = "kinect-v2"                a shipped sensor or a .toml file; default: the name
    train_people = 0                    default: as in [train]; 0: only tested, never trained on
    settings = { devices = 64 }         settings of its data sets, as in a file for glsim generate
    train_variants = { wide = { } }     further settings, each with training sets of its own
    [[source]]                          one source of faces each: name, kind, root, settings
    optional = true                     left out, instead of an error, where there are no such faces
    [[scene]]                           what is around the faces: name, settings
    [test]                              people, tune_people, frames, seed, crop, settings
    [train]                             people, val_people, the same, and recipe, steps, set

A cell is a sensor with a source of faces in a scene. Tables merge in the order [test] or [train],
[[scene]], [[sensor]], [[source]].
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import Field, StringConstraints, model_validator

from glsim.core.errors import ConfigError, did_you_mean
from glsim.faces.people.fetch import data_folder
from glsim.settings.schema import Settings, load_settings
from glsim.settings.toml_tables import TomlTable, merge_tables, parse_table, read_toml

_FOLDER: Final = Path(__file__).parent / "transfers"
#: Names become folders, and parts of --leave.
_Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=60)]
#: Step of the depth files, mm; chosen, rounding adds 0.03 mm.
_UNIT_MM: Final = 0.1


class Family(TomlTable):
    """A choice along one axis of a study (sensors, faces, scenes); the base class is a scene."""

    name: _Name
    settings: dict[str, Any] = Field(default_factory=dict)


class SensorFamily(Family):
    """A family of sensors: a shipped sensor or a file; ``load_study`` fills in ``sensor``."""

    sensor: str = ""
    train_people: int | None = Field(None, ge=0)
    train_variants: dict[_Name, dict[str, Any]] = Field(default_factory=dict)


class FaceFamily(Family):
    """A source of faces in a study."""

    kind: Literal["procedural", "ict-facekit", "people"]
    root: Path | None = None
    optional: bool = False

    def missing(self) -> str | None:
        """Return why the faces cannot be used; None if they can."""
        if self.kind == "ict-facekit" and self.root is None:
            return "give its folder with --ict-root FaceXModel"
        if self.kind == "people":
            try:
                data_folder()
            except ConfigError as error:
                return str(error)
        return None


class _DataTable(TomlTable):
    frames: int = Field(4, ge=1, description="frames per person")
    crop: int = Field(128, ge=8, le=4096)
    settings: dict[str, Any] = Field(default_factory=dict)


class TestData(_DataTable):
    """Settings of the test set of each cell."""

    people: int = Field(20, ge=2, description="scored people")
    tune_people: int = Field(5, ge=1, description="other people, on whom filters are tuned")
    seed: int = Field(2000, ge=0, lt=2**63)


class TrainingPlan(_DataTable):
    """Settings of the training of each network, and of the training data of each cell."""

    people: int = Field(100, ge=1)
    val_people: int = Field(6, ge=1, description="other people, for the validation")
    seed: int = Field(1000, ge=0, lt=2**63)
    recipe: str = "face"
    steps: int = Field(5000, ge=1)
    set: tuple[str, ...] = Field((), description="changes to the recipe, as --set of glsim train")


class Cell(NamedTuple):
    """A combination of a sensor, a source of faces and a scene."""

    sensor: SensorFamily
    source: FaceFamily
    scene: Family

    @property
    def place(self) -> Path:
        """Relative folder of the cell, from the names of its sensor, source and scene."""
        return Path(self.sensor.name) / self.source.name / self.scene.name


@dataclass(frozen=True)
class Training:
    """A network of the study, with its training data and the cells that test it."""

    name: str
    sensors: tuple[SensorFamily, ...]
    sources: tuple[FaceFamily, ...]
    cells: tuple[Cell, ...]


class TransferStudy(TomlTable):
    """A transfer study; the docstring of the module describes its keys."""

    title: str
    truth: Literal["expected", "clean"] = "expected"
    sensor: tuple[SensorFamily, ...] = Field(min_length=1)
    source: tuple[FaceFamily, ...] = Field(min_length=1)
    scene: tuple[Family, ...] = (Family(name="alone"),)
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

    def cells(self) -> tuple[Cell, ...]:
        """Return all cells of the study."""
        return tuple(Cell(*cell) for cell in product(self.sensor, self.source, self.scene))

    def trainings(self, leave: Sequence[str], train_on: Sequence[str]) -> list[Training]:
        """Return the networks to train.

        Args:
            leave: ``sensor:NAME`` or ``source:NAME``, one network without each, or ``all``.
            train_on: names of sensors; one network is trained on them alone.

        Raises:
            ConfigError: a name is unknown, or nothing is left to train on.
        """
        trainable = tuple(sensor for sensor in self.sensor if sensor.train_people != 0)
        if "all" in leave:
            leave = [f"sensor:{s.name}" for s in self.sensor] if len(trainable) > 1 else []
            leave += [f"source:{s.name}" for s in self.source] if len(self.source) > 1 else []
        found = []
        for text in leave:
            kind, _, name = text.partition(":")
            if kind not in ("sensor", "source"):
                raise ConfigError(f"--leave {text}: write sensor:NAME, source:NAME or all")
            _check_names(f"--leave {text}", [name], [f.name for f in getattr(self, kind)])
            sensors = tuple(s for s in trainable if kind != "sensor" or s.name != name)
            sources = tuple(s for s in self.source if kind != "source" or s.name != name)
            if not sensors or not sources:
                raise ConfigError(f"--leave {text}: nothing else is left to train on")
            cells = tuple(c for c in self.cells() if getattr(c, kind).name == name)
            found.append(Training(f"without-{name}", sensors, sources, cells))
        if train_on:
            _check_names("--train-on", train_on, [sensor.name for sensor in trainable])
            sensors = tuple(sensor for sensor in trainable if sensor.name in train_on)
            cells = tuple(cell for cell in self.cells() if cell.sensor not in sensors)
            found.append(Training(f"on-{'-'.join(train_on)}", sensors, self.source, cells))
        return found

    def test_settings(self, cell: Cell) -> Settings:
        """Return the settings of the test set of a cell. Raises ConfigError."""
        return self._settings(cell, self.test, (0, self.test.tune_people, self.test.people), {})

    def training_settings(self, training: Training) -> dict[Path, Settings]:
        """Return folder -> settings of each data set of a training. Raises ConfigError."""
        return {
            Path(f"{sensor.name}-{variant}" if variant else sensor.name)
            / source.name
            / scene.name: self._settings(
                Cell(sensor, source, scene),
                self.train,
                (sensor.train_people or self.train.people, self.train.val_people, 0),
                sensor.train_variants.get(variant, {}),
            )
            for sensor, source, scene in product(training.sensors, training.sources, self.scene)
            for variant in ("", *sensor.train_variants)
        }

    def _settings(
        self,
        cell: Cell,
        common: TestData | TrainingPlan,
        people: tuple[int, int, int],
        variant: dict[str, Any],
    ) -> Settings:
        total = sum(people)
        tree: dict[str, Any] = copy.deepcopy(common.settings)
        for table in (cell.scene.settings, cell.sensor.settings, variant, cell.source.settings):
            merge_tables(tree, copy.deepcopy(table))
        layers = ("clean", "noisy") if self.truth == "clean" else ("clean", "expected", "noisy")
        fixed = {
            "sensor": cell.sensor.sensor,
            "seed": common.seed,
            "split": [count / total for count in people],
            "output": {"crop": common.crop, "depth_unit_mm": _UNIT_MM, "layers": layers},
        }
        merge_tables(tree, fixed)
        source = {
            "kind": cell.source.kind,
            "root": cell.source.root,
            "subjects": total,
            "frames_per_subject": common.frames,
        }
        try:
            return load_settings(None, (), tree, source)
        except ConfigError as error:
            raise ConfigError(f"{cell.place}: {error}") from None


def _check_names(option: str, names: Sequence[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise ConfigError(f"{option}: {name}: not in this study ({did_you_mean(name, known)})")


def load_study(size: str, ict_root: Path | None = None) -> tuple[TransferStudy, list[str]]:
    """Load a shipped study by its name, or a study from a TOML file.

    Sensor files and folders of faces are relative to the file.

    Args:
        size: full or small, or the path of a .toml file.
        ict_root: folder of ICT-FaceKit.

    Returns:
        The study without the optional faces that are missing, and the reasons.

    Raises:
        ConfigError: a wrong study, or faces are missing and not optional.
    """
    file = Path(size) if size.endswith(".toml") else _FOLDER / f"{size}.toml"
    if not file.is_file():
        known = [shipped.stem for shipped in _FOLDER.glob("*.toml")]
        raise ConfigError(f"--study {size}: no such study ({did_you_mean(size, known)})")
    study = parse_table(TransferStudy, read_toml(file), str(file))
    sensors, sources, reasons = [], [], []
    for sensor in study.sensor:
        used = sensor.sensor or sensor.name
        used = str(file.parent / used) if used.endswith(".toml") else used
        sensors.append(sensor.model_copy(update={"sensor": used}))
    for source in study.source:
        root = None if source.root is None else file.parent / source.root
        root = ict_root if ict_root and source.kind == "ict-facekit" else root
        faces = source.model_copy(update={"root": root})
        if (why := faces.missing()) is None:
            sources.append(faces)
        elif faces.optional:
            reasons.append(f"{faces.name} is left out: {why}")
        else:
            raise ConfigError(f"{faces.name}: {why}")
    if not sources:
        raise ConfigError(f"nothing is left to test: {'; '.join(reasons)}")
    return study.model_copy(update={"sensor": tuple(sensors), "source": tuple(sources)}), reasons
