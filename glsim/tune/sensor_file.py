"""Write a tuning as a sensor file: the original file with other values, its comments kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import Table

from glsim.errors import ConfigError
from glsim.files.atomic import write_atomic
from glsim.sensors.inheritance import EXTENDS, RIG_FILES
from glsim.sensors.sensor import Sensor
from glsim.settings.schema import Settings
from glsim.tune.state import Tuning, toml_value


def save_sensor(tuning: Tuning, sensor: Sensor, file: Path) -> list[Path]:
    """Write FILE.toml, and FILE_STAGE.glsl for each stage with changed code; returns their paths.

    Raises ConfigError for a name without .toml.

    Args:
        sensor: as the tuning's simulator has it. Values of the pose and the scene are no part of a
            sensor and are left out (``other_values`` names them).
    """
    if file.suffix != ".toml":
        raise ConfigError(f"{file}: the name of a sensor file ends in .toml")
    written = []
    for stage, code in tuning.code.items():
        path = code_file(file, stage)
        write_atomic(code.text.encode(), path)
        written.append(path)
    write_atomic(sensor_text(tuning, sensor, file).encode(), file)
    return [file, *written]


def checked_path(text: str) -> Path:
    """Return the path of a file to write, from what somebody typed.

    Raises ConfigError for no name, a name of a folder, and a folder that does not exist: a mistyped
    one is not made.
    """
    if not text.strip() or "\0" in text:
        raise ConfigError("give the name of a file")
    path = Path.cwd() / Path(text).expanduser()
    if text.endswith("/") or path.is_dir():
        raise ConfigError(f"{path}: is a folder: add the name of a file")
    if not path.parent.is_dir():
        raise ConfigError(f"{path.parent}: no such folder: make it, or choose another")
    return path


def code_file(file: Path, stage: str) -> Path:
    """The file of a stage's changed code, beside the sensor file."""
    return file.with_name(f"{file.stem}_{stage}.glsl")


def other_values(tuning: Tuning) -> dict[str, Any]:
    """Return the values that a sensor file does not hold: pose, scene, seed."""
    return {n: v for n, v in tuning.values.items() if not _in_sensor(n)}


def _in_sensor(name: str) -> bool:
    return name.split(".")[0] not in set(Settings.model_fields) - {"rig", "stage"}


def sensor_text(tuning: Tuning, sensor: Sensor, file: Path) -> str:
    """Return the TOML of a tuning; lines that have not changed stay as they are."""
    document = tomlkit.parse(sensor.file.read_text(encoding="utf-8"))
    given = document.get("rig")
    rig = given if isinstance(given, Table) else tomlkit.table()
    entries = document.get("stage", tomlkit.aot())
    by_name = {_name(entry): entry for entry in entries}
    _anchor_paths(document, rig, entries, sensor.file.parent)
    if EXTENDS in document:
        _name_inherited(document, entries, by_name, tuning, sensor)
    for stage, code in tuning.code.items():
        if stage not in by_name:
            entry = tomlkit.table()
            _insert(document, entries, entry, [_name(e) for e in entries], code.before, sensor)
            by_name[stage] = entry
        entry = by_name[stage]
        entry["use"] = code_file(file, stage).name
        entry["name"] = stage
        declared = {s.name: s.spec.parameters for s in sensor.stages}[stage]
        for key in [k for k in entry if k not in {"use", "name", "enabled", *declared}]:
            del entry[key]
    _set_values(tuning, sensor, rig, by_name)
    if given is None and rig:
        document["rig"] = rig
    return tomlkit.dumps(document)


def _anchor_paths(document: tomlkit.TOMLDocument, rig: Table, entries: Any, folder: Path) -> None:
    """Make paths independent of the original's folder: the copy lies elsewhere."""
    if str(document.get(EXTENDS, "")).endswith(".toml"):
        document[EXTENDS] = str((folder / str(document[EXTENDS])).resolve())
    for key in RIG_FILES:
        if rig.get(key):
            rig[key] = str((folder / str(rig[key])).resolve())
    for entry in entries:
        use = str(entry["use"])
        if use.endswith(".glsl") and not Path(use).is_absolute():
            entry["use"] = str((folder / use).resolve())


def _set_values(tuning: Tuning, sensor: Sensor, rig: Table, by_name: Mapping[str, Any]) -> None:
    """Write the tuning's values into the rig and the stages. Raises ConfigError."""
    for name, value in tuning.values.items():
        if not _in_sensor(name):
            continue
        table, _, key = name.removeprefix("stage.").partition(".")
        target = rig if table == "rig" else by_name.get(table)
        if target is None:
            raise ConfigError(f"the sensor has no stage {table!r}")
        target[key] = _plain(value, sensor, table, key)


def _name_inherited(
    document: tomlkit.TOMLDocument,
    entries: Any,
    by_name: dict[str, Any],
    tuning: Tuning,
    sensor: Sensor,
) -> None:
    """Add a [[stage]] for each changed stage that the file has from the one it extends."""
    own = {stage.name: stage for stage in sensor.stages}
    for name, code in tuning.code.items():
        if code.new:
            raise ConfigError(
                f"the new stage {name!r} cannot be saved: {sensor.name} extends another sensor's "
                "file, which says the chain; begin from that one"
            )
    changed = {name.removeprefix("stage.").partition(".")[0] for name in tuning.values}
    for name in own:
        if name in by_name or name not in {*changed, *tuning.code}:
            continue
        entry = tomlkit.table()
        entry["use"] = own[name].spec.name
        if own[name].spec.name != name:
            entry["name"] = name
        entries.append(entry)
        by_name[name] = entry
    if "stage" not in document and len(entries):
        document["stage"] = entries


def _name(entry: Mapping[str, Any]) -> str:
    use = str(entry["use"])
    stem = Path(use).stem if use.endswith(".glsl") else use.rpartition(":")[2]
    return str(entry.get("name", stem))


def _insert(
    document: tomlkit.TOMLDocument,
    entries: Any,
    entry: Table,
    names: list[str],
    before: str | None,
    sensor: Sensor,
) -> None:
    """Put a new [[stage]] where the chain has it."""
    arrays = {s.name for s in sensor.stages if s.spec.function is not None}
    place = next((n for n, name in enumerate(names) if name == before), None)
    if before is None:
        place = next((n for n, name in enumerate(names) if name in arrays), None)
    if place is None:
        entries.append(entry)
    else:
        entries.insert(place, entry)
    if "stage" not in document:
        document["stage"] = entries


def _plain(value: Any, sensor: Sensor, table: str, key: str) -> Any:
    """Return a value for tomlkit; whole numbers and switches as such."""
    if isinstance(value, Mapping | list | tuple):
        return tomlkit.parse(f"v = {toml_value(value)}")["v"]
    declared = {s.name: s.spec.parameters for s in sensor.stages}.get(table, {})
    kind = "bool" if key == "enabled" else declared[key].type if key in declared else "float"
    if kind == "bool":
        return bool(value)
    return int(value) if kind == "int" else value
