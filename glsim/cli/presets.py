"""``glsim presets``: list the shipped collections of settings, or print one."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.table import Table

from glsim.cli.common import PRESETS, print_table
from glsim.settings.presets import preset_file, preset_names, preset_title


def presets(name: Annotated[str | None, typer.Argument(autocompletion=PRESETS)] = None) -> None:
    """List the settings for glsim generate --preset with a line each, or print the file of one.

    Args:
        name: Print the settings of this preset.
    """
    if name is not None:
        text = preset_file(name).read_text(encoding="utf-8")
        sys.stdout.write(text.replace("\ntitle =", "\n# title =", 1))  # the title is no setting
        return
    table = Table("preset", "what it is", box=None)
    for each in preset_names():
        table.add_row(each, preset_title(each))
    print_table(table)
