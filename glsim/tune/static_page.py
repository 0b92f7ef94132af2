"""Write the page without a server: ``glsim tune --static DIR``.

    DIR/index.html, tune.css     the page
    DIR/tune.js                  one script: sensors and GLSL as JSON, then assets/*.js
    DIR/scenes/NAME.js           captured clean layers of a scene, read when it is chosen

Scenes are scripts, because browsers read no other files beside a page opened from a disk.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from glsim.errors import ConfigError
from glsim.files.atomic import write_atomic
from glsim.sensors.inheritance import EXTENDS
from glsim.sensors.sensor import load_sensor, sensor_file, sensor_names
from glsim.settings.schema import DEFAULT_SENSOR
from glsim.settings.tables import read_toml
from glsim.tune.static_captures import UNITS
from glsim.tune.static_chains import describe_chains
from glsim.tune.static_scenes import Scene, capture_scenes, default_scenes

_ASSETS = Path(__file__).parent / "assets"
#: The modules of the script, each after those that it imports.
MODULES = (
    "maps.js", "charts.js", "packet.js", "images.js", "surface_mesh.js", "surface_points.js",
    "surface.js", "figures.js", "rate.js", "tune.js",
    "static/functions.js", "static/declarations.js", "static/captures.js", "static/chain.js",
    "static/editor.js", "static/measure.js", "static/panel.js", "static/page.js",
)  # fmt: skip
_IMPORT = re.compile(r'^import (?:(\{[^}]*\}) from )?"[./]*([\w./]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


def write_static_page(
    folder: Path,
    sensors: Sequence[str] = (),
    scenes: Sequence[Scene] = (),
    *,
    backend: str | None = None,
) -> list[Path]:
    """Write the page into ``folder``, which is made; return the files.

    Raises what ``simulate`` raises, and ConfigError for a sensor with imagers.

    Args:
        sensors: names or files (default: ``page_sensors``).
        scenes: default ten heads, and two with a background.
        backend: "egl" or "osmesa".
    """
    names = list(sensors) or page_sensors()
    chosen = list(scenes) or default_scenes()
    loaded = [load_sensor(name) for name in names]
    for sensor in loaded:
        if sensor.rig.imagers_m:
            raise ConfigError(
                f"{sensor.name}: a page without a server cannot match infrared images: leave "
                "--static out"
            )
    chains = describe_chains(loaded)
    first = DEFAULT_SENSOR if DEFAULT_SENSOR in chains["sensors"] else loaded[0].name
    facts = {
        **chains,
        "units": UNITS,
        "first_sensor": first,
        "scenes": [{"name": scene.name, "title": scene.title} for scene in chosen],
    }
    (folder / "scenes").mkdir(parents=True, exist_ok=True)
    written = [folder / "index.html", folder / "tune.css", folder / "tune.js"]
    write_atomic((_ASSETS / "static/page.html").read_bytes(), written[0])
    styles = [(_ASSETS / name).read_text() for name in ("tune.css", "static/static.css")]
    write_atomic("".join(styles).encode(), written[1])
    write_atomic(join_script(facts).encode(), written[2])
    for scene, captured in capture_scenes(chosen, names, backend):
        written.append(folder / "scenes" / f"{scene.name}.js")
        write_atomic(f"glsimScene({_json(captured)});\n".encode(), written[-1])
    return written


def page_sensors() -> list[str]:
    """Return the names of the sensors of the page: without imagers, and one mode per camera."""
    whole = [name for name in sensor_names() if EXTENDS not in read_toml(sensor_file(name))]
    return [name for name in whole if not load_sensor(name).rig.imagers_m]


def join_script(facts: dict[str, Any]) -> str:
    """Return the page's one script; each module is a function, so that names do not collide."""
    parts = [f"'use strict';\nwindow.glsimFacts = {_json(facts)};\nconst modules = {{}};\n"]
    for name in MODULES:
        text = (_ASSETS / name).read_text()
        exported = [match[2] for match in _EXPORT.finditer(text)]
        text = _IMPORT.sub(_take, text)
        text = _EXPORT.sub(r"\1", text)
        given = f"return {{ {', '.join(exported)} }};"
        parts.append(f'modules["{Path(name).name}"] = (() => {{\n{text}{given}\n}})();\n')
    return "".join(parts)


def _take(match: re.Match[str]) -> str:
    names, file = match.groups()
    return f'const {names} = modules["{Path(file).name}"];\n' if names else ""


def _json(value: Any) -> str:
    # "<" is escaped, so that no text ends a script element.
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
