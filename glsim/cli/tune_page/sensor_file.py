"""Writer of a tuning as a sensor file: the original file with new values and its comments."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AoT, Table

from glsim.cli.tune_page.tuning import Tuning
from glsim.core.errors import ConfigError
from glsim.core.files.atomic import write_atomic
from glsim.sensors.sensor import EXTENDS, RIG_FILES, Sensor, name_of_stage
from glsim.settings.schema import Settings
from glsim.settings.toml_tables import toml_value

#: Suffix of the title of a changed sensor.
_TUNED = ", tuned"


def save_sensor(tuning: Tuning, sensor: Sensor, file: Path) -> list[Path]:
    """Write FILE.toml, and FILE_STAGE.glsl for each stage with changed code; return the paths.

    Raises ConfigError for a name without .toml.

    Args:
        sensor: the sensor of the tuning's simulator. Values of pose and scene are left out, since
            they are not part of a sensor (``other_values`` names them).
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
    """Check the file name that the user typed, and return its path.

    Raises ConfigError for an empty name, the name of a folder, and a folder that does not exist; it
    is not created, since its name may be mistyped.
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
    """Return the file for a stage's changed code, in the folder of the sensor file."""
    return file.with_name(f"{file.stem}_{stage}.glsl")


def other_values(tuning: Tuning) -> dict[str, Any]:
    """Return the values that a sensor file cannot hold: pose, scene, seed."""
    return {n: v for n, v in tuning.values.items() if not _in_sensor(n)}


def _in_sensor(name: str) -> bool:
    return name.split(".")[0] not in set(Settings.model_fields) - {"rig", "stage"}


def sensor_text(tuning: Tuning, sensor: Sensor, file: Path) -> str:
    """Return a tuning as TOML; unchanged lines stay as in the original file.

    The comment of a changed line, which gave the former value's source, becomes "tuned, was VALUE".
    """
    document = tomlkit.parse(sensor.file.read_text(encoding="utf-8-sig"))
    given = document.get("rig")
    rig = given if isinstance(given, Table) else tomlkit.table()
    entries = document.get("stage", tomlkit.aot())
    _anchor_paths(document, rig, entries, sensor.file.parent)
    by_name = {name_of_stage(entry, sensor.file): entry for entry in entries}
    _add_missing(entries, by_name, tuning, sensor, extends=EXTENDS in document)
    for stage in tuning.code:
        entry = by_name[stage]
        entry["use"] = code_file(file, stage).name
        entry["name"] = stage
        declared = {s.name: s.spec.parameters for s in sensor.stages}[stage]
        for key in [k for k in entry if k not in {"use", "name", "enabled", *declared}]:
            del entry[key]
    for name, value in tuning.values.items():
        table, _, key = name.removeprefix("stage.").partition(".")
        if _in_sensor(name):
            target = rig if table == "rig" else by_name.get(table)
            if target is None:
                raise ConfigError(f"the sensor has no stage {table!r}")
            _replace(target, key, _plain(value, sensor, table, key))
    title, changed = str(document.get("title", sensor.title)), {*tuning.values, *tuning.code}
    if any(map(_in_sensor, changed)) and not title.endswith(_TUNED):
        document["title"] = title + _TUNED
    if given is None and rig:
        document["rig"] = rig
    if "stage" not in document and len(entries):
        document["stage"] = entries
    return tomlkit.dumps(document)


def _replace(table: Any, key: str, value: Any) -> None:
    """Set a value; the old value replaces the comment, which gave the old value's source."""
    before = table.get(key)
    if before == value:
        return
    table[key] = value
    if isinstance(item := table.item(key), AoT):  # [[rig.emitter]] has no line of its own
        return
    was = (
        "" if before is None or isinstance(before, AoT) else f", was {toml_value(before.unwrap())}"
    )
    item.comment(f"tuned{was}")


def _add_missing(
    entries: Any, by_name: dict[str, Any], tuning: Tuning, sensor: Sensor, *, extends: bool
) -> None:
    """Add a table [[stage]] for each new stage, and for each changed stage of the base sensor."""
    if extends and (new := [name for name, code in tuning.code.items() if code.new]):
        raise ConfigError(
            f"the new stage {new[0]!r} cannot be saved: {sensor.name} extends another sensor's "
            "file, which says the chain; begin from that one"
        )
    changed = {name.removeprefix("stage.").partition(".")[0] for name in tuning.values}
    order = [stage.name for stage in sensor.stages]
    for number, stage in enumerate(sensor.stages):
        if stage.name in by_name or stage.name not in {*changed, *tuning.code}:
            continue
        entry = by_name[stage.name] = tomlkit.table()
        entry["use"] = stage.spec.name
        if stage.spec.name != stage.name:
            entry["name"] = stage.name
        names = [name_of_stage(other, sensor.file) for other in entries]
        places = (n for n, name in enumerate(names) if name in order[number:])
        entries.insert(next(places, len(entries)), entry)


def _anchor_paths(document: tomlkit.TOMLDocument, rig: Table, entries: Any, folder: Path) -> None:
    """Make paths absolute, because the copy lies in another folder than the original."""
    if str(document.get(EXTENDS, "")).endswith(".toml"):
        document[EXTENDS] = str((folder / str(document[EXTENDS])).resolve())
    for key in RIG_FILES:
        if rig.get(key):
            rig[key] = str((folder / str(rig[key])).resolve())
    for entry in entries:
        use = str(entry["use"])
        if use.endswith(".glsl") and not Path(use).is_absolute():
            entry["use"] = str((folder / use).resolve())


def _plain(value: Any, sensor: Sensor, table: str, key: str) -> Any:
    """Convert a value for tomlkit; integers and switches keep their type."""
    if isinstance(value, Mapping | list | tuple):
        return tomlkit.parse(f"v = {toml_value(value)}")["v"]
    declared = {s.name: s.spec.parameters for s in sensor.stages}.get(table, {})
    kind = "bool" if key == "enabled" else declared[key].type if key in declared else "float"
    if kind == "bool":
        return bool(value)
    return int(value) if kind == "int" else value
