"""``glsim tune``: change a sensor's noise in a browser and see the frame at once."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import (
    MORE,
    PAGE_PORT,
    BackendOption,
    ConfigOption,
    HostOption,
    NoBrowserOption,
    PortOption,
    PresetOption,
    SeedOption,
    SetOption,
    announce_page,
    console,
    overrides,
)
from glsim.cli.completion import sensor_words

EXAMPLES = """
[bold]Examples[/bold]

glsim tune

glsim tune kinect-v1 --face face.obj

glsim tune mine.toml --source ict-facekit --root FaceXModel --real recording
"""


def tune(
    sensor: Annotated[
        str | None,
        typer.Argument(
            help="A shipped sensor (glsim sensors) or a .toml file.", autocompletion=sensor_words
        ),
    ] = None,
    face: Annotated[
        Path | None, typer.Option("--face", help="A mesh file: OBJ, PLY, STL, GLB or OFF.")
    ] = None,
    source: Annotated[
        str | None, typer.Option(help="Source of faces, as for glsim generate.")
    ] = None,
    root: Annotated[
        Path | None, typer.Option(help="Folder of the meshes or of the face model.")
    ] = None,
    real: Annotated[
        Path | None,
        typer.Option("--real", help="A recording, whose figures stand beside the frame's."),
    ] = None,
    link: Annotated[
        str | None,
        typer.Option(help="A copied link: start with its settings.", rich_help_panel=MORE),
    ] = None,
    host: HostOption = "127.0.0.1",
    port: PortOption = PAGE_PORT,
    no_browser: NoBrowserOption = False,
    assignments: SetOption = None,
    seed: SeedOption = None,
    preset: PresetOption = None,
    config: ConfigOption = None,
    backend: BackendOption = None,
) -> None:
    """Change a sensor's noise in a browser and see the frame, its figures and its code at once.

    Needs the extra tune. The printed address lets one browser in, once; only you on this
    machine can open it, unless --host is given. A page that is opened again has its last settings.
    """
    from glsim.errors import ConfigError, require_package

    for needed in ("nicegui", "tomlkit"):
        require_package(needed, "glsim tune", "tune")
    from glsim.sensors.sensor import sensor_of
    from glsim.settings.schema import load_settings
    from glsim.tune.address import listen
    from glsim.tune.faces import as_values, face_command, opener
    from glsim.tune.state import Tuning, tuning_of_link
    from glsim.tune.trust import check_link, code_of
    from glsim.tune.workshop import Workshop
    from glsim.worker_processes import available_workers

    if face is not None and (source is not None or root is not None):
        raise ConfigError("give --face or --source, not both")
    given = overrides(sensor=sensor, seed=seed)
    options = overrides(kind=source, root=root)
    settings = load_settings(config, assignments or [], {**given, "strict": True}, options, preset)
    sensor_of(settings)
    settings, values = as_values(settings, assignments or [])
    if real is not None and not real.is_dir():
        raise ConfigError(f"--real {real}: no such folder")
    start = Tuning(settings.sensor, values)
    if link is not None:
        start = tuning_of_link(link.partition("s=")[2].partition("&")[0] or link)
        check_link(start, settings.sensor, Path.cwd())
        if code := code_of(start, settings, settings.sensor):
            raise ConfigError(
                f"the sensor of the link runs code ({', '.join(code)}): if you trust it, name that "
                f"sensor too: glsim tune {start.sensor} --link ..."
            )
    own_sensor = settings.sensor
    settings, open_sources = opener(settings, face)
    command = face_command(face, source, root, preset, config, seed)
    address = listen(host, port)
    announce_page(address, "tune", no_browser)
    # A single process draws here, so it may use all cores.
    os.environ.setdefault("LP_NUM_THREADS", str(available_workers()))
    # The page's libraries load in another thread while the face is made: at Python's default of
    # 5 ms each of many short NumPy calls would wait that long for the interpreter.
    sys.setswitchinterval(0.0005)
    workshop = Workshop(settings, open_sources, command, start, own_sensor, real, backend)
    workshop.prepare()
    from functools import partial

    from glsim.tune.page import open_page  # takes seconds, while the first frame is drawn
    from glsim.tune.server import serve

    say = partial(console.print, soft_wrap=True)
    serve(partial(open_page, workshop), workshop.stop, address, say, "glsim tune")
