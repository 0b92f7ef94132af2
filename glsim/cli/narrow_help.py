"""Help in a narrow terminal: plain text, where Rich's columns would cut words ("--denoi...")."""

from __future__ import annotations

import re
import shutil
from functools import partial
from typing import Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

#: Columns from which on no help loses a word in Rich's boxes; a test counts.
ENOUGH_COLUMNS: Final = 80
#: Widest name of an option, columns, that has its text beside it: others have it below.
_NAME_COLUMNS: Final = 4


class _FittingHelp:
    """Prints the help of a command in boxes, or plain in a narrow terminal."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help; like Rich's, it does not go through the formatter's text."""
        columns = shutil.get_terminal_size().columns
        if columns >= ENOUGH_COLUMNS:
            super().format_help(ctx, formatter)  # type: ignore[misc]
            return
        formatter.width = columns - 1
        formatter.write_dl = partial(formatter.write_dl, col_max=_NAME_COLUMNS)
        command: Any = self
        command.format_usage(ctx, formatter)
        command.format_help_text(ctx, formatter)
        command.format_options(ctx, formatter)
        command.format_epilog(ctx, formatter)
        # Texts are written for Rich: [bold] is its only style, and \[ its bracket.
        typer.echo(re.sub(r"\[/?bold\]|\\(?=\[)", "", formatter.getvalue()).rstrip())
        formatter.buffer.clear()

    def get_short_help_str(self, limit: int = 45) -> str:
        """Return the first sentence of the help in full, for the list of commands."""
        return str(super().get_short_help_str(limit=1000))  # type: ignore[misc]


class Command(_FittingHelp, TyperCommand):
    """A command whose help fits the terminal."""


class Group(_FittingHelp, TyperGroup):
    """A group of commands whose help fits the terminal."""
