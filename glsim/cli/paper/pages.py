"""``glsim paper figures``, ``page``: pages of a reproduction."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import print_message, print_written

EXAMPLES = """
[bold]Examples[/bold]

glsim paper figures reproduced

glsim paper page reproduced                   a verdict on each printed value
"""

FolderArgument = Annotated[Path, typer.Argument(help="Folder of glsim paper reproduce.")]


def figures(folder: FolderArgument) -> None:
    """Draw the paper's figures 1 to 5 from the data and networks of a reproduction."""
    from glsim.eval.paper.figures.write import write_paper_figures

    print_written(write_paper_figures(folder, lambda name: print_message(f"drawing {name}")))


def page(folder: FolderArgument) -> None:
    """Write verdicts.html: a verdict on each value that the paper prints, from the scores.

    Values whose rows were not scored are listed as not trained yet.
    """
    from glsim.errors import ConfigError
    from glsim.eval.paper.verdict_page import write_verdicts

    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder: run glsim paper reproduce -o {folder} first")
    print_written(write_verdicts(folder))
