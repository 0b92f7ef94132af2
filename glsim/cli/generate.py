"""``glsim generate``: a whole data set."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import (
    BackendOption,
    ConfigOption,
    Debug,
    Quiet,
    SeedOption,
    SensorOption,
    SetOption,
    Verbose,
    console,
    options,
    overrides,
    say,
    words,
)
from glsim.errors import ConfigError, DatasetError

if TYPE_CHECKING:
    from glsim.dataset import Progress, Summary, Workers

EXAMPLES = """
[bold]Examples[/bold]

glsim generate -o data --subjects 10 --frames-per-subject 30

glsim generate -o data --source ict-facekit --root FaceXModel --subjects 100 --crop 128

glsim generate -o data --source folder --root scans --format webdataset --workers 4

glsim generate -o data --source d3dfacs --root d3dfacs_alignments --every 5 --split paper --plan

glsim generate -o data --set pose.yaw_deg={uniform=[-30,30]} --sensor kinect-v2-paper

The same command again resumes an interrupted run and checks a finished one.
"""


def generate(
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder of the data set.")] = None,
    source: Annotated[
        str | None,
        typer.Option(help="procedural, ict-facekit, folder, d3dfacs, facewarehouse or biwi."),
    ] = None,
    root: Annotated[
        Path | None, typer.Option(help="Folder of the meshes or of the face model.")
    ] = None,
    subjects: Annotated[
        int | None, typer.Option(help="People. Default: all of a folder, else 10.")
    ] = None,
    frames_per_subject: Annotated[
        int | None, typer.Option(help="Frames of each. Default: all of a folder, else 30.")
    ] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of the meshes, over the rule.")] = None,
    axes: Annotated[str | None, typer.Option(help="Axes of the meshes, over the rule.")] = None,
    every: Annotated[int | None, typer.Option(help="One frame in so many (d3dfacs, biwi).")] = None,
    peak_only: Annotated[
        bool, typer.Option("--peak-only", help="The peak of each sequence (d3dfacs).")
    ] = False,
    steps: Annotated[
        int | None, typer.Option(help="Frames from a shape to the next (facewarehouse).")
    ] = None,
    sensor: SensorOption = None,
    crop: Annotated[int | None, typer.Option(help="Side of the centre crop, pixels.")] = None,
    format: Annotated[str | None, typer.Option(help="png or webdataset.")] = None,
    layers: Annotated[
        str | None,
        typer.Option(help="Of clean,noisy,infrared,reason,regions; default: two."),
    ] = None,
    depth_unit_mm: Annotated[float | None, typer.Option(help="Step of the depth files.")] = None,
    split: Annotated[
        str | None,
        typer.Option(help="Shares of train,val,test (default 0.70,0.12,0.18), or paper."),
    ] = None,
    workers: Annotated[str, typer.Option(help="Processes; auto is one a core.")] = "auto",
    seed: SeedOption = None,
    assignments: SetOption = None,
    config: ConfigOption = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Say what would be made, and make nothing.")
    ] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Stop at the first bad mesh.")] = False,
    backend: BackendOption = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Generate a data set of clean and noisy depth frames, split by subject; resumable."""
    from glsim.config import load_settings
    from glsim.dataset import generate as run

    tree = overrides(
        sensor=sensor,
        seed=seed,
        split=split,
        output__crop=crop,
        output__format=format,
        output__layers=words(layers),
        output__depth_unit_mm=depth_unit_mm,
        strict=strict or None,
    )
    face_options = overrides(
        kind=source,
        root=root,
        subjects=subjects,
        frames_per_subject=frames_per_subject,
        unit=unit,
        axes=axes,
        every=every,
        peak_only=peak_only or None,
        steps=steps,
    )
    settings = load_settings(config, assignments or [], tree, face_options)
    if plan:
        from glsim.cli.planning import print_plan

        print_plan(settings, parse_workers(workers), backend)
        return
    if out is None:
        raise ConfigError("give -o DIR, the folder of the data set (or --plan to look ahead)")
    with progress_bar() as progress:
        summary = run(
            settings, out, workers=parse_workers(workers), backend=backend, progress=progress
        )
    report(summary, out)


def parse_workers(text: str) -> Workers:
    """The option --workers. Raises ConfigError."""
    if text == "auto":
        return "auto"
    if not text.isdigit() or int(text) < 1:
        raise ConfigError(f"--workers {text}: give a number of at least 1, or auto")
    return int(text)


@contextmanager
def progress_bar() -> Iterator[Callable[[Progress], None] | None]:
    """A progress bar on stderr with rate, time left and skipped frames; nothing if --quiet."""
    if options.quiet:
        yield None
        return
    from rich import progress as rich_progress

    columns = (
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn("{task.fields[rate]}  skipped {task.fields[skipped]}  left"),
        rich_progress.TimeRemainingColumn(),
    )
    with rich_progress.Progress(*columns, console=console) as bar:
        task = bar.add_task("frames", total=None, rate="", skipped=0)

        def update(state: Progress) -> None:
            elapsed = bar.tasks[0].elapsed or 0.0
            rate = (state.done - state.reused) / elapsed if elapsed > 0 else 0.0
            bar.update(
                task,
                total=state.total,
                completed=state.done,
                rate=f"{rate:.0f}/s",
                skipped=state.skipped,
            )

        yield update


def report(summary: Summary, out: Path) -> None:
    """What a run did, in a few lines. Raises DatasetError if it could not make any frame."""
    frames = ", ".join(f"{split} {count}" for split, count in summary.frames.items())
    people = ", ".join(f"{split} {count}" for split, count in summary.subjects.items())
    say(f"{out}: {sum(summary.frames.values())} frames ({frames}) of subjects ({people})")
    if summary.reused:
        say(f"{summary.reused} of them were complete already")
    if summary.rendered:
        milliseconds = 1000 * summary.cpu_seconds / summary.rendered
        say(
            f"{summary.rendered} rendered in {summary.seconds:.1f} s: "
            f"{summary.rendered / summary.seconds:.0f}/s, {milliseconds:.1f} ms of CPU each, "
            f"{summary.bytes / 1e6:.1f} MB"
        )
    for why, count in sorted(summary.skipped.items(), key=lambda item: -item[1])[:10]:
        console.print(f"skipped {count}: {why}", style="yellow", markup=False)
    if not sum(summary.frames.values()):
        raise DatasetError(f"{out}: no frame could be made, see {out / 'skipped.jsonl'}")
