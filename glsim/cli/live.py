"""``glsim live``: a recording or a camera, measured and denoised side by side in a browser."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import (
    MORE,
    PAGE_PORT,
    CalibratedDeviceOption,
    HostOption,
    NoBrowserOption,
    PortOption,
    announce_page,
    console,
    print_message,
)
from glsim.errors import ConfigError, require_package

if TYPE_CHECKING:
    from glsim.denoise import MapDenoiser
    from glsim.live.source import Source

EXAMPLES = """
[bold]Examples[/bold]

glsim live recording/

glsim live recording.bag -d face-live --around face      30 frames a second on two cores

glsim live --camera realsense                        needs: pip install pyrealsense2

glsim live --camera azure-kinect -d face-video --device my_kinect.toml
"""


def live(
    recording: Annotated[
        list[Path] | None,
        typer.Argument(help="A recording: a folder, a data set, .bag, .mkv, or files of one kind."),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="A connected camera instead: realsense (needs pyrealsense2), azure-kinect (pyk4a) "
            "or oak (depthai)."
        ),
    ] = None,
    denoiser: Annotated[
        str,
        typer.Option(
            "-d",
            "--denoiser",
            help="A name of glsim eval --list, or a checkpoint; face is the shipped network. The "
            "page changes it.",
        ),
    ] = "face",
    around: Annotated[
        str | None,
        typer.Option(
            help="face: denoise only around the nearest head; the rest stays as measured."
        ),
    ] = None,
    device: CalibratedDeviceOption = None,
    depth_unit_mm: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=10,
            help="Step of the recording's depths, mm. Default: what it states, else 1.",
            rich_help_panel=MORE,
        ),
    ] = None,
    host: HostOption = "127.0.0.1",
    port: PortOption = PAGE_PORT,
    no_browser: NoBrowserOption = False,
) -> None:
    """Show what a camera measures beside what a denoiser makes of it, in a browser.

    Needs the extra tune. A recording begins again at its end, at 30 frames a second at most. The
    page pauses, changes the denoiser and shows the frames a second that are on the screen. The
    printed address lets one browser in, once; only you on this machine can open it, unless --host
    is given. Ctrl-C ends.
    """
    if bool(recording) == (camera is not None):
        raise ConfigError("give either a recording or --camera")
    if camera is not None and depth_unit_mm is not None:
        raise ConfigError("--depth-unit-mm does not go with --camera, which states its own step")
    require_package("nicegui", "glsim live", "tune")
    from glsim.denoise import load_denoiser
    from glsim.live.stream import LiveStream
    from glsim.tune.address import listen

    def load(spec: str, around: str | None) -> MapDenoiser:
        return load_denoiser(spec, device=device, around=around)

    load(denoiser, around)  # a mistake is said before a camera is opened
    stream = LiveStream(_source(recording or [], camera, depth_unit_mm), load, denoiser, around)
    address = listen(host, port)
    announce_page(address, "live", no_browser)
    from glsim.live.page import open_page  # with the server, takes a second
    from glsim.live.player import Player
    from glsim.tune.server import serve

    player = Player(stream)
    say = partial(console.print, soft_wrap=True)
    serve(partial(open_page, player), player.stop, address, say, "glsim live")


def _source(recording: list[Path], camera: str | None, unit_mm: float | None) -> Source:
    if camera is not None:
        from glsim.live.cameras import open_camera

        return open_camera(camera)
    from glsim.live.source import RecordingSource
    from glsim.recordings.recording import open_recording

    found = open_recording(recording, unit_mm)
    for note in found.notes:
        print_message(note)
    return RecordingSource(found)
