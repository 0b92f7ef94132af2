"""``glsim validate``: check a sensor's noise against published measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from glsim.cli.common import (
    SENSORS,
    STDOUT,
    FigureOption,
    JsonFileOption,
    check_outputs,
    options,
    print_message,
    print_table,
    print_written,
    write_json,
)

if TYPE_CHECKING:
    from glsim.bench.validate.report import ValidationReport

_COLOURS = {"pass": "green", "FAIL": "bold red", "exception": "yellow", "n/a": "dim"}


def validate(
    sensor: Annotated[str, typer.Argument(autocompletion=SENSORS)],
    json_file: JsonFileOption = None,
    markdown_file: Annotated[Path | None, typer.Option("--markdown", metavar="FILE.md")] = None,
    figure: FigureOption = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    frames: Annotated[int, typer.Option(min=8, max=2000)] = 64,
    backend: str | None = None,
) -> int:
    """Check a sensor's noise against published measurements.

    Walls, edges, steps and faces are rendered and measured. Each check names its source, and
    whether this is a measurement, a data sheet or a derivation. The exit status is 0 if every
    check passes or is a documented exception, else 1. The key sheet of a sensor file names the
    checks; a sensor without it has no published measure, and is refused. A sheet that passes is no
    promise: the last line has the AUC on real frames, where there are any (0.5 is the goal).

    Args:
        markdown_file: Write the table as Markdown. Default: print it.
        frames: Number of frames of each wall.
    """
    from glsim.bench.validate import validate_sensor
    from glsim.core.files.atomic import write_atomic

    check_outputs(json_file, markdown_file, figure)
    report = validate_sensor(sensor, seed=seed, frames=frames, backend=backend)
    if not options.quiet and json_file != STDOUT:
        _print(report)
    written = []
    if json_file is not None:
        written += write_json(report.as_json(), json_file)
    if markdown_file is not None:
        write_atomic(report.as_markdown().encode(), markdown_file)
        written.append(markdown_file)
    if figure is not None:
        from glsim.bench.figures import draw_validation

        draw_validation(report, figure)
        written.append(figure)
    print_written(written)
    print_message(report.summary)
    return 0 if report.passed else 1


def _print(report: ValidationReport) -> None:
    from glsim.bench.validate.report import COLUMNS

    table = Table(*COLUMNS, title=f"{report.title}\nchecks of the {report.sheet}")
    for result in report.results:
        *cells, state, note = result.cells
        table.add_row(*cells, Text(state, style=_COLOURS[state]), note)
        table.add_section()
    print_table(table)
