"""``glsim paper reproduce``: make the paper's tables and figures by a series of commands.

Each command resumes its own work; this module only skips trainings that are finished.
"""

from __future__ import annotations

import shlex
import time
from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import console, options, print_message, run_command_line
from glsim.cli.paper.plan import load_plan
from glsim.cli.paper.plan_hours import print_hours
from glsim.depth_protocol import check_protocol
from glsim.errors import DatasetError, GlsimError

EXAMPLES = """
[bold]Examples[/bold]

glsim paper reproduce -o reproduced               small, for a CPU: an hour of one core

glsim paper reproduce -o tiny --size tiny         every step once, as a check: two minutes

glsim paper reproduce -o paper --size full        the paper's size, for a GPU

glsim paper reproduce -o mine --size mine.toml    your own plan, in the format of the shipped ones

glsim paper reproduce -o reproduced --plan        print commands and hours, run nothing

glsim paper reproduce -o paper --d3dfacs d3dfacs_alignments --biwi hpdb     with the paper's faces

Repeat the same command to resume an interrupted one.
"""

RootOption = Annotated[
    Path | None,
    typer.Option(help="Folder of this face set of the paper. Without it: embedded heads."),
]


def reproduce(
    context: typer.Context,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for all results.")],
    size: Annotated[
        str,
        typer.Option(help="Plan: tiny (a check), small (CPU), full (GPU), or your own .toml."),
    ] = "small",
    plan: Annotated[
        bool, typer.Option("--plan", help="Print the commands and hours without running them.")
    ] = False,
    hours: Annotated[
        bool,
        typer.Option(help="With --plan: measure steps of each network here, and print its hours."),
    ] = True,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Train and score under one protocol only: depth (as measured) or paper (the "
            "nearest point of each face at 1 mm). Default: those of the plan, both."
        ),
    ] = None,
    d3dfacs: RootOption = None,
    facewarehouse: RootOption = None,
    biwi: RootOption = None,
) -> None:
    """Generate the data, train the networks, and write the paper's tables 1 to 3 beside ours.

    One folder contains all results: data/, runs/, paper_table_1.md to _3.md, figures/,
    report.html, verdicts.html (a verdict on each printed value), and the paper's figures in
    paper_figures/. protocol_paper/ holds the networks and tables under the paper's protocol
    (nearest point at 1 mm), mask_as-noisy/ those with BlenSor's mask. Rows with artefact removal
    are their partners' networks. Each command is printed before it runs.
    A finished training is not repeated: delete its folder in runs/ to train again.
    """
    root_command = context.find_root().command
    chosen = load_plan(size)
    given = {"d3dfacs": d3dfacs, "facewarehouse": facewarehouse, "biwi": biwi}
    roots = {kind: root for kind, root in given.items() if root is not None}
    if (only := check_protocol(protocol)) is not None:
        chosen = chosen.model_copy(update={"protocols": (only,)})
    commands = list(chosen.commands(out, roots))
    flags = options.flags
    if plan:
        for command in commands:
            typer.echo(shlex.join(["glsim", *command]))
        if hours:
            print_hours(commands, root_command, chosen.training_images())
        return
    print_message(f"{chosen.title}: {len(commands)} commands")
    start = time.monotonic()
    for number, command in enumerate(commands, 1):
        text = shlex.join(["glsim", *command])
        minutes = (time.monotonic() - start) / 60
        finished = command[0] == "train" and _is_finished(Path(command[-1]))
        state = ", finished before" if finished else ""
        line = f"{number}/{len(commands)}, {minutes:.0f} min{state}: {text}"
        if not options.quiet:  # on one line and without markup, so that it can be copied
            console.print(line, soft_wrap=True)
        if not finished and run_command_line(root_command, [*command, *flags]) != 0:
            raise GlsimError(f"stopped in command {number} of {len(commands)}: {text}: repeat "
                             "the same glsim paper reproduce to go on there")  # fmt: skip
    minutes = (time.monotonic() - start) / 60
    print_message(f"done in {minutes:.0f} min: read {out / 'verdicts.html'}")


def _is_finished(run: Path) -> bool:
    """Return whether a training has ended and its best weights are there."""
    from glsim.files.atomic import read_json

    try:
        return (
            read_json(run / "run.json").get("state") == "finished" and (run / "best.pt").is_file()
        )
    except DatasetError:
        return False
