"""``glsim study``: the same faces through several sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import Debug, Quiet, SeedOption, Verbose, listed, overrides, say, words

from .common import WorkersOption, processes

EXAMPLES = """
[bold]Examples[/bold]

glsim study -o study

glsim study -o study --sensors kinect-v2,led3d --subjects 40 --frames-per-subject 25
"""


def study(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for data sets and results.")],
    sensors: Annotated[
        str | None, typer.Option(help="Comma-separated names or .toml files; default: the Kinects.")
    ] = None,
    source: Annotated[str, typer.Option(help="procedural, ict-facekit or folder.")] = "procedural",
    root: Annotated[
        Path | None, typer.Option(help="Folder of meshes or of the face model.")
    ] = None,
    subjects: Annotated[
        int, typer.Option(min=3, help="People, a fifth of them to tune with.")
    ] = 20,
    frames_per_subject: Annotated[int, typer.Option(min=1, help="Frames of each.")] = 20,
    crop: Annotated[int, typer.Option(help="Side of the centre crop, pixels.")] = 128,
    seed: SeedOption = None,
    workers: WorkersOption = "auto",
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Table 1 under several noise models: study.md says which filter wins by what.

    Every sensor sees the same faces in the same poses. The same command again resumes.
    """
    from glsim.dataset.files import write_bytes

    from ..paper import paper_table
    from ..study import choose, report
    from ..study import study as run

    chosen, absent = choose(words(sensors))
    for name in absent:
        say(f"no sensor {name} in this glsim: left out")
    results = run(
        out,
        chosen,
        overrides(seed=seed, output__crop=crop),
        overrides(kind=source, root=root, subjects=subjects, frames_per_subject=frames_per_subject),
        workers=processes(workers),
        generating=lambda sensor: say(f"{sensor}: making faces"),
        scoring=lambda sensor: say(f"{sensor}: scoring"),
    )
    paths = [out / "study.md"]
    write_bytes(report(results, absent).encode(), paths[0])
    for result in results:
        paths.append(out / result.sensor / "scores" / "paper_table_1.md")
        write_bytes(paper_table(result.evaluation, result.table).markdown().encode(), paths[-1])
    listed(paths)
