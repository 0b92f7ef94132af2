"""The commands of ``glsim`` that belong to the evaluation."""

from __future__ import annotations

import typer

from . import denoise, evaluate, study


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    app.command("eval", epilog=evaluate.EXAMPLES)(evaluate.evaluate)
    app.command("denoise", epilog=denoise.EXAMPLES)(denoise.denoise)
    app.command("study", epilog=study.EXAMPLES)(study.study)
