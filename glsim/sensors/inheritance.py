"""Sensor files that extend another one: a mode of a camera says only what differs.

extends = "azure-kinect"   a sensor's name, or a path that ends in .toml, from this file's folder
[rig]                      keys that replace or add to those of the other file
[[stage]]
use = "tof_taps"           a stage of the other file, by its name: these parameters replace its
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from glsim.core.errors import ConfigError, did_you_mean
from glsim.settings.tables import merge_tables, read_toml

#: The key that names the other file.
EXTENDS = "extends"
#: The keys of [rig] that name a file, from the folder of the sensor file.
RIG_FILES = ("fixed_pattern_map", "projector_image")


def read_sensor_tree(file: Path, find: Callable[[str], Path]) -> dict[str, Any]:
    """Read a sensor file with all that it extends. Raises ConfigError.

    Args:
        file: the TOML file.
        find: returns the file of a sensor's name or path.

    Returns:
        The tables of the file, as if nothing was extended.
    """
    return _read(file, find, ())


def _read(file: Path, find: Callable[[str], Path], before: tuple[Path, ...]) -> dict[str, Any]:
    own = read_toml(file)
    base = own.pop(EXTENDS, None)
    if base is None:
        return own
    if not isinstance(base, str):
        raise ConfigError(f"{file}: {EXTENDS} must be the name of a sensor, not {base!r}")
    if file.resolve() in before:
        raise ConfigError(f"{file}: extends itself: let one of the files extend none")
    other = file.parent / base if base.endswith(".toml") else find(base)
    tree = _read(other, find, (*before, file.resolve()))
    _anchor(tree, other.parent)
    stages = own.pop("stage", [])
    merge_tables(tree, own)
    _merge_stages(tree, stages, file, other)
    return tree


def _anchor(tree: dict[str, Any], folder: Path) -> None:
    """Make the paths in a file that is extended independent of the file that extends it."""
    rig = tree.get("rig", {})
    for key in RIG_FILES if isinstance(rig, dict) else ():
        if isinstance(found := rig.get(key), str) and found:
            rig[key] = str(folder.absolute() / found)
    for stage in tree.get("stage", []):
        use = stage.get("use") if isinstance(stage, dict) else None
        if isinstance(use, str) and (use.endswith(".glsl") or ".py:" in use):
            stage["use"] = str(folder.absolute() / use)


def _merge_stages(tree: dict[str, Any], own: Any, file: Path, other: Path) -> None:
    """Merge the parameters of ``own`` stages into those of the other file, in place."""
    stages = tree.get("stage", [])
    given = all(isinstance(table, list) and all(isinstance(s, dict) for s in table)
                for table in (stages, own))  # fmt: skip
    if not given:
        raise ConfigError(f"{file}: write each stage as a table of its own, [[stage]]")
    known = {_name(stage, other): stage for stage in stages}
    for stage in own:
        name = _name(stage, file)
        if name not in known:
            raise ConfigError(
                f"{file}: changes the stage {name!r}, which {other.name} does not have "
                f"({did_you_mean(name, known)}); a file with other stages extends none"
            )
        known[name].update(stage)


def _name(stage: dict[str, Any], file: Path) -> str:
    """Return the name of a stage in the chain."""
    use = stage.get("use")
    if not isinstance(use, str):
        raise ConfigError(f'{file}: say which stage with use = "..."')
    stem = Path(use).stem if use.endswith(".glsl") else use.rpartition(":")[2]
    return str(stage.get("name", stem))
