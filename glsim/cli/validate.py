"""``glsim validate``: a sensor against what is published about it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from glsim.cli.common import BackendOption, Debug, Quiet, Verbose, listed, options, say

if TYPE_CHECKING:
    from glsim.validate import Report

EXAMPLES = """
[bold]Examples[/bold]

glsim validate kinect-v2

glsim validate my_sensor.toml --json checks.json --figure checks.png

glsim validate kinect-v1 --frames 200 --seed 3
"""

_COLOURS = {"pass": "green", "FAIL": "bold red", "exception": "yellow", "n/a": "dim"}


def validate(
    sensor: Annotated[str, typer.Argument(help="A shipped sensor (glsim sensors) or a .toml.")],
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the table as JSON.")
    ] = None,
    figure_file: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE.png", help="Draw noise and edges.")
    ] = None,
    markdown_file: Annotated[
        Path | None, typer.Option("--markdown", metavar="FILE.md", help="Write it as Markdown.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same numbers.")] = 0,
    frames: Annotated[int, typer.Option(min=8, max=2000, help="Frames of each wall.")] = 64,
    backend: BackendOption = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> int:
    """Check a sensor's noise against published measurements.

    Walls, edges, steps and faces are rendered and measured. Exit status: 0 if every check passes
    (or is a documented exception), else 1. The checks of kinect-v2 serve for sensors of your own.
    """
    from glsim.dataset.files import write_bytes
    from glsim.errors import ConfigError
    from glsim.gl.context import open_context
    from glsim.validate import Bench, Lab, check_matplotlib, examine, figure

    if figure_file is not None and figure_file.suffix.lower() != ".png":
        raise ConfigError(f"--figure {figure_file}: give a name that ends in .png")
    if figure_file is not None:
        check_matplotlib()
    context = open_context(backend)
    try:
        lab = Lab(Bench(sensor, context, seed, frames))
        report = examine(lab)
        picture = figure(lab) if figure_file is not None else None
    finally:
        context.release()
    if not options.quiet:
        _print(report)
    written = []
    if json_file is not None:
        write_bytes((json.dumps(report.as_json(), indent=1) + "\n").encode(), json_file)
        written.append(json_file)
    if markdown_file is not None:
        write_bytes(report.as_markdown().encode(), markdown_file)
        written.append(markdown_file)
    if figure_file is not None and picture is not None:
        write_bytes(picture, figure_file)
        written.append(figure_file)
    listed(written)
    say(report.summary)
    return 0 if report.passed else 1


def _print(report: Report) -> None:
    """The table on stdout; full width when piped, so that nothing is cut for grep."""
    from glsim.validate import band_texts, measured_texts

    table = Table(
        "#",
        "check",
        "measured",
        "band",
        "source",
        "",
        "note",
        title=f"{report.title}\nchecks of the {report.sheet}",
    )
    for outcome in report.outcomes:
        colour = _COLOURS[outcome.state]
        table.add_row(
            outcome.check.number,
            outcome.check.what,
            "\n".join(measured_texts(outcome)),
            "\n".join(band_texts(outcome)),
            outcome.check.source,
            f"[{colour}]{outcome.state}[/{colour}]",
            outcome.note,
        )
        table.add_section()
    out = Console(highlight=False)
    (out if out.is_terminal else Console(width=200, highlight=False)).print(table)
