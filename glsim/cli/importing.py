"""``glsim import``: real depth maps as a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import BackendOption, Debug, Quiet, Verbose
from glsim.errors import DatasetError

BIWI_EXAMPLES = """
[bold]Examples[/bold]

glsim import biwi hpdb -o real

glsim import biwi hpdb -o real --every 10 --split 0,0,1
"""

app = typer.Typer(help="Bring real depth maps into a data set.", no_args_is_help=True)


@app.callback()
def _importing() -> None:
    """Bring real depth maps into a data set."""


@app.command("biwi", epilog=BIWI_EXAMPLES)
def biwi(
    root: Annotated[Path, typer.Argument(help="Folder with NN.obj and NN/frame_*_depth.bin.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder of the data set.")],
    every: Annotated[int, typer.Option(min=1, help="One frame in so many.")] = 1,
    subjects: Annotated[int | None, typer.Option(help="People. Default: all.")] = None,
    frames_per_subject: Annotated[
        int | None, typer.Option(help="Frames of each. Default: all.")
    ] = None,
    split: Annotated[str | None, typer.Option(help="Shares of train,val,test, or paper.")] = None,
    workers: Annotated[str, typer.Option(help="Processes; auto is one a core.")] = "auto",
    backend: BackendOption = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Write Biwi's real Kinect frames beside the clean maps of the posed templates."""
    from glsim.cli.generate import parse_workers, progress_bar, report
    from glsim.realdepth import import_biwi

    with progress_bar() as progress:
        summary = import_biwi(
            root,
            out,
            every=every,
            subjects=subjects,
            frames_per_subject=frames_per_subject,
            split=split,
            workers=parse_workers(workers),
            backend=backend,
            progress=progress,
        )
    report(summary, out)
    if not sum(summary.frames.values()):
        raise DatasetError(f"{out}: no frame could be made, see {out / 'skipped.jsonl'}")
