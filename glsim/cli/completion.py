"""What a shell completes with Tab: names of sensors, recipes, stages, presets and denoisers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


def sensor_words(incomplete: str) -> list[str]:
    """Return the sensors, or the sensor files, that begin with a word."""
    from glsim.sensors.sensor import sensor_names

    return _beginning(sensor_names(), incomplete)


def recipe_words(incomplete: str) -> list[str]:
    """Return the recipes, or the recipe files, that begin with a word."""
    from glsim.train.recipe import recipe_names

    return _beginning(recipe_names(), incomplete)


def stage_words(incomplete: str) -> list[str]:
    """Return the noise stages that begin with a word."""
    from glsim.noise.registry import shipped_stages

    return _beginning(shipped_stages(), incomplete, suffix=".glsl")


def preset_words(incomplete: str) -> list[str]:
    """Return the presets that begin with a word."""
    from glsim.settings.presets import preset_names

    return [name for name in preset_names() if name.startswith(incomplete)]


def _beginning(names: Iterable[str], incomplete: str, suffix: str = ".toml") -> list[str]:
    """Return the names and files that begin with a word; folders end in a slash, to go on."""
    found = [name for name in names if name.startswith(incomplete)]
    folder, _, start = incomplete.rpartition("/")
    place = f"{folder}/" if folder or incomplete.startswith("/") else ""
    try:
        here = sorted(Path(place or ".").iterdir())
    except OSError:
        return found
    for path in here:
        if path.name.startswith(start) and (start or not path.name.startswith(".")):
            if path.is_dir():
                found.append(f"{place}{path.name}/")
            elif path.suffix == suffix:
                found.append(f"{place}{path.name}")
    return found
