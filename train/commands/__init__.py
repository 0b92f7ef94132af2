"""The commands of ``glsim`` that belong to the training."""

from __future__ import annotations

import typer

from . import train


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    app.command("train", epilog=train.EXAMPLES)(train.train)
