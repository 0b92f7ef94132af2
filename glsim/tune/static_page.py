"""Write the page without a server: ``glsim tune --static DIR``.

    DIR/index.html, tune.css     the page
    DIR/tune.js                  one script: sensors and GLSL as JSON, then assets/*.js
    DIR/scenes/NAME.js           captured clean layers of a scene, read when it is chosen

and, if asked, what ``glsim.tune.denoise_page`` writes beside it.

Scenes are scripts, because browsers read no other files beside a page opened from a disk.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from glsim.errors import ConfigError
from glsim.files.atomic import write_atomic
from glsim.sensors.inheritance import EXTENDS
from glsim.sensors.sensor import load_sensor, sensor_file, sensor_names
from glsim.settings.schema import DEFAULT_SENSOR
from glsim.settings.tables import read_toml
from glsim.tune.denoise_page import check_runtime, write_denoise_page
from glsim.tune.page_script import ASSETS, join_script, script_json
from glsim.tune.static_captures import UNITS
from glsim.tune.static_chains import describe_chains
from glsim.tune.static_scenes import Scene, capture_scenes, default_scenes

#: The modules of the script, each after those that it imports.
MODULES = (
    "maps.js", "charts.js", "packet.js", "images.js", "surface_mesh.js", "surface_points.js",
    "surface.js", "figures.js", "rate.js", "tune.js",
    "static/theme.js", "static/functions.js", "static/declarations.js", "static/captures.js",
    "static/chain.js", "static/editor.js", "static/measure.js", "static/panel.js", "static/page.js",
)  # fmt: skip


def write_static_page(
    folder: Path,
    sensors: Sequence[str] = (),
    scenes: Sequence[Scene] = (),
    *,
    denoise: bool = False,
    backend: str | None = None,
) -> list[Path]:
    """Write the page into ``folder``, which is made; return the files.

    Raises what ``simulate`` raises, and ConfigError for a sensor with imagers, and without
    onnxruntime-web for ``denoise``.

    Args:
        sensors: names or files (default: ``page_sensors``).
        scenes: default ten heads, and two with a background.
        denoise: also write the page that denoises maps of the visitor.
        backend: "egl" or "osmesa".
    """
    if denoise:
        check_runtime()
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
        "denoise": denoise,
        "first_sensor": first,
        "scenes": [{"name": scene.name, "title": scene.title} for scene in chosen],
    }
    (folder / "scenes").mkdir(parents=True, exist_ok=True)
    written = [folder / "index.html", folder / "tune.css", folder / "tune.js"]
    write_atomic((ASSETS / "static/page.html").read_bytes(), written[0])
    styles = [
        (ASSETS / name).read_text()
        for name in ("tune.css", "static/static.css", "denoise/denoise.css")
    ]
    write_atomic("".join(styles).encode(), written[1])
    write_atomic(join_script(facts, MODULES).encode(), written[2])
    for scene, captured in capture_scenes(chosen, names, backend):
        written.append(folder / "scenes" / f"{scene.name}.js")
        write_atomic(f"glsimScene({script_json(captured)});\n".encode(), written[-1])
    return [*written, *(write_denoise_page(folder, backend) if denoise else [])]


def page_sensors() -> list[str]:
    """Return the names of the sensors of the page: without imagers, and one mode per camera."""
    whole = [name for name in sensor_names() if EXTENDS not in read_toml(sensor_file(name))]
    return [name for name in whole if not load_sensor(name).rig.imagers_m]
