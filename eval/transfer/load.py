"""Load a study from its file, and adapt it to installed sources and to options."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from glsim.errors import ConfigError
from glsim.eval.transfer.study import FaceFamily, SensorFamily, TransferStudy
from glsim.faces.people.fetch import data_folder
from glsim.faces.sources.ict_facekit import IctFaceKitSettings
from glsim.sensors.sensor import load_sensor, sensor_names, sensor_of
from glsim.settings.tables import parse_table, read_toml


def load_study(file: Path) -> TransferStudy:
    """Load a study; sensor files and folders of faces are relative to it. Raises ConfigError."""
    study = parse_table(TransferStudy, read_toml(file), str(file))
    sensors = [
        s.model_copy(update={"sensor": str(file.parent / s.file)}) if _is_path(s.file) else s
        for s in study.sensor
    ]
    sources = [
        s.model_copy(update={"root": file.parent / s.root}) if s.root is not None else s
        for s in study.source
    ]
    return study.model_copy(update={"sensor": tuple(sensors), "source": tuple(sources)})


def prepare_study(
    study: TransferStudy, sensor_files: Iterable[Path] = (), ict_root: Path | None = None
) -> tuple[TransferStudy, list[str]]:
    """Add sensor files to test on, and leave out optional families that are missing.

    Args:
        study: as loaded.
        sensor_files: further sensors.
        ict_root: folder of ICT-FaceKit.

    Returns:
        The study, and the reasons of what is left out.

    Raises:
        ConfigError: a family is missing and not optional, or a sensor lacks a setting.

    """
    reasons: list[str] = []
    sensors = [*study.sensor, *(_own_family(file) for file in sensor_files)]
    kept_sensors = [s for s in sensors if _keep(s, _missing_sensor(s), reasons)]
    sources = [
        s.model_copy(update={"root": ict_root}) if s.kind == "ict-facekit" and ict_root else s
        for s in study.source
    ]
    kept_sources = [s for s in sources if _keep(s, _missing_source(s), reasons)]
    if not kept_sensors or not kept_sources:
        raise ConfigError(f"nothing is left to test: {'; '.join(reasons)}")
    tree = study.model_dump() | {
        "sensor": [s.model_dump() for s in kept_sensors],
        "source": [s.model_dump() for s in kept_sources],
    }
    chosen = parse_table(TransferStudy, tree, "study")
    source = chosen.source[0]
    for sensor in chosen.sensor:
        sets = chosen.test_sets(sensor, source)
        if sensor.train_people != 0:
            sets += chosen.training_sets(sensor, source)
        for data in sets:
            sensor_of(chosen.settings_of(data))
    return chosen, reasons


def _own_family(file: Path) -> SensorFamily:
    """Make a family of a sensor file, which is only tested. Raises ConfigError."""
    if file.suffix != ".toml":
        raise ConfigError(f"--sensor {file}: give a sensor file, which ends in .toml")
    tof = bool(load_sensor(str(file)).rig.modulation_mhz)
    tree: Mapping[str, Any] = {"name": file.stem, "sensor": str(file), "tof": tof}
    return parse_table(SensorFamily, {**tree, "train_people": 0}, f"--sensor {file}")


def _is_path(sensor: str) -> bool:
    return sensor.endswith(".toml")


def _keep(family: SensorFamily | FaceFamily, missing: str | None, reasons: list[str]) -> bool:
    """Return whether a family can be used; note why not, or raise ConfigError."""
    if missing is None:
        return True
    if not family.optional:
        raise ConfigError(f"{family.name}: {missing}")
    reasons.append(f"{family.name} is left out: {missing}")
    return False


def _missing_sensor(family: SensorFamily) -> str | None:
    if _is_path(family.file):
        return None if Path(family.file).is_file() else f"there is no file {family.file}"
    known = family.file in sensor_names()
    return None if known else f"this glsim has no sensor {family.file}"


def _missing_source(family: FaceFamily) -> str | None:
    if family.kind == "people":
        try:
            data_folder()
        except ConfigError as error:
            return str(error)
    elif family.kind == "ict-facekit":
        if family.root is None:
            return "give its folder with --ict-root FaceXModel"
        if not family.root.is_dir():
            raise ConfigError(f"--ict-root {family.root}: no such folder")
        if not IctFaceKitSettings.likeness(family.root, ()):
            raise ConfigError(f"--ict-root {family.root}: is not ICT-FaceKit's folder FaceXModel")
    return None
