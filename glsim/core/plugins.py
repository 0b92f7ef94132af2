"""Find the entries of registries: files in folders of glsim, and installed plug-ins.

A registry (of sources, metrics, ...) has two kinds of entries. Files in a folder of glsim are its
shipped entries. Other packages declare plug-ins as entry points:

    [project.entry-points."glsim.stages"]
    speckle = "my_lab.stages:speckle"      # an object, or a package that holds a file of that name

Listing names imports nothing; an entry is imported when it is used.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any, Final, TypeVar

from glsim.core.errors import ConfigError, GlsimError, one_line

log = logging.getLogger(__name__)
_T = TypeVar("_T")

#: Group "glsim.NAME" of entry points -> what its entries are, for messages.
GROUPS: Final = {
    "sources": "a class derived from glsim.FaceSettings",
    "stages": "a function decorated with @glsim.array_stage, or a package with {name}.glsl",
    "sensors": "a package with {name}.toml",
    "denoisers": "a class or function (noisy_mm, valid) -> (depth_mm, valid)",
    "metrics": "a glsim.Metric",
    "exports": "a glsim.Export",
    "checks": "a function decorated with @glsim.validation_check",
}
#: Suffixes of the files of a package that decide what its code does.
_CODE: Final = (".py", ".glsl", ".toml")


def module_names(folder: str) -> list[str]:
    """Return the names of the modules in a folder of glsim, such as "faces/sources", sorted."""
    package = find_spec(".".join(("glsim", *folder.split("/"))))
    places = package.submodule_search_locations if package else ()
    return sorted(module.name for module in iter_modules(places))


def shipped_module(folder: str, name: str) -> ModuleType:
    """Import a module from a folder of glsim."""
    return import_module(".".join(("glsim", *folder.split("/"), name)))


def shipped_objects(folder: str, wanted: Callable[[Any], bool]) -> list[Any]:
    """Collect the ``wanted`` objects of all modules of a folder, in tuples too, without repeats."""
    found: dict[int, Any] = {}
    for name in module_names(folder):
        for value in vars(shipped_module(folder, name)).values():
            values = value if isinstance(value, tuple) else (value,)
            found |= {id(each): each for each in values if wanted(each)}
    return list(found.values())


_all_entry_points = cache(entry_points)  # reads the files of all installed packages


@cache
def _entry_points(group: str) -> Mapping[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for entry in _all_entry_points().select(group=f"glsim.{group}"):
        if (other := found.setdefault(entry.name, entry)) is not entry:
            raise ConfigError(
                f"{_place(entry)}: {_package(other)} brings one of this name too: uninstall one of "
                "the two packages"
            )
    return found


def plugin_names(group: str, shipped: Iterable[str] = ()) -> list[str]:
    """Return a group's plug-in names, sorted, without imports; ConfigError if two are equal."""
    found = _entry_points(group)
    for name in set(shipped) & set(found):
        raise ConfigError(
            f"{_place(found[name])}: glsim has one of this name: rename it in the package, or "
            "uninstall the package"
        )
    return sorted(found)


def load_plugin(group: str, name: str, valid: Callable[[Any], bool]) -> Any:
    """Import a plug-in's object. Raises ConfigError if that fails or the object is invalid."""
    entry = _entry_points(group)[name]
    with plugin_errors(group, name):
        found = entry.load()
        is_valid = valid(found)
    if not is_valid:
        raise ConfigError(
            f"{_place(entry)}: {entry.value} is not {GROUPS[group].format(name=name)}: mend or "
            "uninstall the package"
        )
    return found


@contextmanager
def plugin_errors(group: str, name: str) -> Iterator[None]:
    """Turn what a plug-in raises in the block into a ConfigError that names its package."""
    try:
        yield
    except (KeyboardInterrupt, GlsimError):
        raise
    except BaseException as error:  # another package may raise anything, or exit
        entry = _entry_points(group)[name]
        raise ConfigError(
            f"{_place(entry)}: {entry.value} cannot be loaded ({one_line(error)}): mend or "
            "uninstall the package"
        ) from error


def each_usable(names: Iterable[str], load: Callable[[str], _T]) -> Iterator[tuple[str, _T]]:
    """Yield each name with its loaded entry; warn of names whose loading fails."""
    for name in names:
        try:
            entry = load(name)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # an object of a package may raise anything when it is asked
            reason = error if isinstance(error, GlsimError) else f"{name}: {one_line(error)}"
            log.warning("left out: %s", reason)
        else:
            yield name, entry


def plugin_file(package: object, name: str) -> Path | None:
    """Return the path of a file in a package; None if there is no such file or no package."""
    folders = getattr(package, "__path__", ()) if isinstance(package, ModuleType) else ()
    return next((Path(f) / name for f in folders if (Path(f) / name).is_file()), None)


def plugin_code(group: str, name: str) -> dict[str, Path]:
    """Return the code files of a plug-in's package: name -> path; {} for shipped code."""
    entry = _entry_points(group).get(name)
    if entry is None:
        return {}
    package = import_module(entry.module.split(".")[0])
    if not hasattr(package, "__path__"):
        file = Path(str(package.__file__))
        return {file.name: file}
    return {
        f"{package.__name__}/{file.relative_to(folder).as_posix()}": file
        for folder in map(Path, package.__path__)
        for file in sorted(folder.rglob("*"))
        if file.suffix in _CODE
    }


def _package(entry: EntryPoint) -> str:
    return f"package {entry.dist.name}" if entry.dist is not None else "a package"


def _place(entry: EntryPoint) -> str:
    return f"{_package(entry)}: entry point {entry.group}: {entry.name}"
