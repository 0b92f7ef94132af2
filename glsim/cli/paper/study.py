"""``glsim paper study``: compare filters on the same faces under several sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import (
    SeedOption,
    WorkersOption,
    overrides,
    print_message,
    print_written,
    split_names,
)

EXAMPLES = """
[bold]Examples[/bold]

glsim paper study -o study

glsim paper study -o study --sensors kinect-v2,led3d --subjects 40 --frames-per-subject 25
"""


def study(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for data sets and results.")],
    sensors: Annotated[
        str | None, typer.Option(help="Comma-separated names or .toml files. Default: the Kinects.")
    ] = None,
    source: Annotated[
        str, typer.Option(help="Source of faces: procedural, ict-facekit, people or folder.")
    ] = "procedural",
    root: Annotated[
        Path | None, typer.Option(help="Folder of meshes or of the face model.")
    ] = None,
    subjects: Annotated[
        int, typer.Option(min=3, help="Number of people; a fifth of them is used for tuning.")
    ] = 20,
    frames_per_subject: Annotated[int, typer.Option(min=1, help="Frames per person.")] = 20,
    crop: Annotated[int, typer.Option(help="Side of the centre crop, pixels.")] = 128,
    seed: SeedOption = None,
    workers: WorkersOption = "auto",
) -> None:
    """Compute table 1 under several noise models; study.md compares the best filters.

    Every sensor sees the same faces in the same poses. Repeat the same command to resume.
    """
    from glsim.eval.paper.filter_table import filter_table
    from glsim.eval.study import choose_sensors, run_study, study_markdown
    from glsim.files.atomic import write_atomic
    from glsim.worker_processes import worker_count

    chosen, absent = choose_sensors(split_names(sensors))
    for name in absent:
        print_message(f"no sensor {name} in this glsim: skipped")
    results = run_study(
        out,
        chosen,
        overrides(seed=seed, output__crop=crop),
        overrides(kind=source, root=root, subjects=subjects, frames_per_subject=frames_per_subject),
        workers=worker_count(workers),
        generating=lambda sensor: print_message(f"{sensor}: generating frames"),
        scoring=lambda sensor: print_message(f"{sensor}: scoring"),
    )
    paths = [out / "study.md"]
    write_atomic(study_markdown(results, absent).encode(), paths[0])
    for result in results:
        paths.append(out / result.sensor / "scores" / "paper_table_1.md")
        write_atomic(filter_table(result.evaluation, result.table).markdown().encode(), paths[-1])
    print_written(paths)
