"""``glsim tune``: change a sensor's noise in a browser and see the frame at once."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import SENSORS, PresetOption, SetOption, console, overrides


def tune(
    sensor: Annotated[str | None, typer.Argument(autocompletion=SENSORS)] = None,
    face: Annotated[Path | None, typer.Option("--face")] = None,
    source: str | None = None,
    root: Path | None = None,
    real: Annotated[Path | None, typer.Option("--real")] = None,
    assignments: SetOption = None,
    seed: int | None = None,
    preset: PresetOption = None,
    config: Path | None = None,
    host: str = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8137,
    no_browser: Annotated[bool, typer.Option("--no-browser")] = False,
) -> None:
    """Change a sensor's noise in a browser and see frame, figures and code change at once.

    Needs the extra tune. Only browsers that were opened with the printed address see the page,
    which listens on this machine alone unless --host is given. A page that is opened again has its
    last settings.

    Args:
        face: A mesh file: OBJ, PLY, STL, GLB or OFF. Default: heads of --source.
        real: A recording, whose figures stand beside the frame's. Default: none.
        host: Address to listen on; others than loopback are reachable.
        port: Port; a free one is taken if it is in use.
        no_browser: Print the address and open no browser.
    """
    from glsim.core.errors import ConfigError, require_package

    for needed in ("nicegui", "tomlkit"):
        require_package(needed, "glsim tune", "tune")
    from glsim.cli.tune_page.access import listen
    from glsim.cli.tune_page.session import open_session
    from glsim.data.worker_processes import available_workers
    from glsim.sensors.sensor import sensor_of
    from glsim.settings.schema import load_settings

    if face is not None and (source is not None or root is not None):
        raise ConfigError("give --face or --source, not both")
    if real is not None and not real.is_dir():
        raise ConfigError(f"--real {real}: no such folder")
    given = overrides(sensor=sensor, seed=seed) | {"strict": True}
    options = overrides(kind=source, root=root)
    settings = load_settings(config, assignments or [], given, options, preset)
    sensor_of(settings)
    command = {
        "--source": source, "--root": root, "--preset": preset, "--config": config, "--seed": seed,
    }  # fmt: skip
    session = open_session(settings, assignments or [], face, command, real)
    address = listen(host, port)
    console.print(f"glsim tune: {address.url}", soft_wrap=True)
    if not no_browser:
        address.open_browser()
    # A single process draws here, so it may use all cores.
    os.environ.setdefault("LP_NUM_THREADS", str(available_workers()))
    # The page's libraries load in another thread while the face is made. At Python's default of 5
    # ms, each of many short NumPy calls would wait 5 ms for the interpreter.
    sys.setswitchinterval(0.0005)
    session.prepare()
    from glsim.cli.tune_page.page import serve  # takes seconds, while a frame is drawn

    serve(session, address)
