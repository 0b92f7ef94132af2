"""``glsim generate``: generate a data set of clean and noisy depth frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import (
    MORE,
    BackendOption,
    ConfigOption,
    PresetOption,
    SeedOption,
    SensorOption,
    SetOption,
    WorkersOption,
    overrides,
    split_names,
)
from glsim.cli.generation_summary import print_summary
from glsim.cli.progress import generation_progress
from glsim.errors import ConfigError
from glsim.settings.source_settings import shipped_kinds

EXAMPLES = """
[bold]Examples[/bold]

glsim generate -o data --subjects 10 --frames-per-subject 30

glsim generate -o data --source ict-facekit --root FaceXModel --subjects 100 --crop 128

glsim generate -o data --source people --framing body --set pose.distance_mm=3000

glsim generate -o data --source folder --root scans --format webdataset --workers 4

glsim generate -o data --source d3dfacs --root d3dfacs_alignments --every 5 --split paper --plan

glsim generate -o data --set 'pose.yaw_deg={uniform=[-30,30]}' --sensor kinect-v2-paper

glsim generate -o s3://bucket/faces --format webdataset --subjects 1000 --ray auto

glsim generate -o data --preset office --subjects 200 --frames-per-subject 10

glsim generate -o shared/data --subjects 100000 --part 3/16     one of 16 jobs on many machines

glsim generate --subjects 100000 --plan --price-per-core-hour 0.04

Repeat the same command to resume an interrupted run or to check a finished one.
"""


def generate(
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            help="Folder for the data set, or a URL such as s3://bucket/faces for shards.",
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            help=f"Source of faces: {', '.join(shipped_kinds())}, or one of an installed package."
        ),
    ] = None,
    root: Annotated[
        Path | None, typer.Option(help="Folder of the meshes or of the face model.")
    ] = None,
    subjects: Annotated[
        int | None, typer.Option(help="Number of people. Default: all of a folder, else 10.")
    ] = None,
    frames_per_subject: Annotated[
        int | None, typer.Option(help="Frames per person. Default: all of a folder, else 30.")
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(help="Unit of the mesh files; overrides detection.", rich_help_panel=MORE),
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(help="Axes of the mesh files; overrides detection.", rich_help_panel=MORE),
    ] = None,
    every: Annotated[
        int | None, typer.Option(help="Use every N-th frame (d3dfacs, biwi).", rich_help_panel=MORE)
    ] = None,
    peak_only: Annotated[
        bool,
        typer.Option(
            "--peak-only",
            help="Use only the peak frame of each sequence (d3dfacs).",
            rich_help_panel=MORE,
        ),
    ] = False,
    steps: Annotated[
        int | None,
        typer.Option(
            help="Number of frames between two shapes (facewarehouse).", rich_help_panel=MORE
        ),
    ] = None,
    framing: Annotated[
        str | None,
        typer.Option(
            help="What the camera looks at: face, bust or body (people).", rich_help_panel=MORE
        ),
    ] = None,
    sensor: SensorOption = None,
    crop: Annotated[int | None, typer.Option(help="Side of the centre crop, pixels.")] = None,
    format: Annotated[
        str | None, typer.Option(help="File format: png or webdataset.", rich_help_panel=MORE)
    ] = None,
    layers: Annotated[
        str | None,
        typer.Option(
            help="Layers to write, with commas: clean, noisy, infrared, infrared_right (stereo), "
            "reason, regions, expected (clean with the sensor's systematic error), normals. "
            "Default: clean,noisy.",
            rich_help_panel=MORE,
        ),
    ] = None,
    depth_unit_mm: Annotated[
        float | None, typer.Option(help="Step of the depth files, mm.", rich_help_panel=MORE)
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Where the files count depth from: depth (as measured) or paper (the nearest "
            "point of each frame at 1 mm; its record has the offset).",
            rich_help_panel=MORE,
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            help="Shares of train,val,test, or paper for the paper's. Default: 0.70,0.12,0.18.",
            rich_help_panel=MORE,
        ),
    ] = None,
    workers: WorkersOption = "auto",
    seed: SeedOption = None,
    assignments: SetOption = None,
    preset: PresetOption = None,
    config: ConfigOption = None,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan",
            help="Print the number of images, and estimates of size and time; render nothing.",
        ),
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json", help="With --plan: print JSON for other programs.", rich_help_panel=MORE
        ),
    ] = False,
    price_per_core_hour: Annotated[
        float | None,
        typer.Option(
            metavar="PRICE",
            help="With --plan: print the price of the run, in any currency.",
            rich_help_panel=MORE,
        ),
    ] = None,
    frames_per_second: Annotated[
        float | None,
        typer.Option(
            help="With --plan: speed of one core. Default: 40, in rooms 8.", rich_help_panel=MORE
        ),
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Make only the chunks whose number modulo N is I (from 0, or from 1 to N); the "
            "last part to end merges. auto takes I and N from Slurm, AWS Batch or SkyPilot, auto/N "
            "takes I from Kubernetes.",
            rich_help_panel=MORE,
        ),
    ] = None,
    merge: Annotated[
        bool,
        typer.Option(
            "--merge",
            help="Complete a data set whose parts are made; needs no OpenGL.",
            rich_help_panel=MORE,
        ),
    ] = False,
    slurm: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Submit N parts as an array of Slurm jobs, and wait.",
            rich_help_panel=MORE,
        ),
    ] = None,
    slurm_set: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="An option of the Slurm jobs in submitit's words, such as cpus_per_task=8, "
            "timeout_min=240, slurm_partition=cpu. Repeatable.",
            rich_help_panel=MORE,
        ),
    ] = None,
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Render on a cluster of Ray: auto, HOST:6379, or local. "
            "pip install 'glsim\\[ray]'",
            rich_help_panel=MORE,
        ),
    ] = None,
    portable: Annotated[
        bool,
        typer.Option(
            "--portable/--native",
            help="The same bytes on all x86-64 processors since 2013, or this processor's own.",
            rich_help_panel=MORE,
        ),
    ] = True,
    leave: Annotated[
        bool,
        typer.Option(
            "--leave",
            help="With --part or --slurm: a machine that renders or computes differently leaves "
            "its chunks to parts that end later, instead of an error.",
            rich_help_panel=MORE,
        ),
    ] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Stop at the first bad frame.", rich_help_panel=MORE)
    ] = False,
    backend: BackendOption = None,
) -> None:
    """Generate a data set of clean and noisy depth frames, split by subject; resumable.

    A seed gives the same bytes on all x86-64 processors since 2013, unless you say --native.
    """
    from glsim.depth_protocol import NEAREST_MM, check_protocol
    from glsim.settings.schema import load_settings
    from glsim.worker_processes import worker_count

    tree = overrides(
        sensor=sensor,
        seed=seed,
        split=split,
        output__crop=crop,
        output__format=format,
        output__layers=split_names(layers),
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
        framing=framing,
    )
    if (chosen := check_protocol(protocol)) is not None:
        nearest_to_mm = NEAREST_MM if chosen == "paper" else None
        tree.setdefault("output", {})["nearest_to_mm"] = nearest_to_mm
    settings = load_settings(config, assignments or [], tree, face_options, preset)
    if plan:
        from glsim.cli.generate_plan import print_plan

        print_plan(settings, worker_count(workers), price_per_core_hour, frames_per_second, as_json)
        return
    _refuse_without("--plan", None, json=as_json, price_per_core_hour=price_per_core_hour,
                    frames_per_second=frames_per_second)  # fmt: skip
    if out is None:
        raise ConfigError("give -o DIR, the folder of the data set (or --plan to print the plan)")
    _refuse_together(part=part, merge=merge, slurm=slurm, ray=ray)
    _refuse_without("--slurm", slurm, slurm_set=slurm_set)
    _refuse_without("--part or --slurm", slurm if part is None else part, leave=leave)
    from glsim.cli.generate_parts import make_one_part, merge_all_parts, submit_parts

    options = {"workers": worker_count(workers), "backend": backend, "portable": portable}
    if merge:
        merge_all_parts(settings, out)
    elif slurm is not None:
        # A job counts the cores of its own node, not those of this machine.
        jobs = {"workers": "auto" if workers == "auto" else options["workers"], "leave": leave}
        submit_parts(settings, out, slurm, slurm_set or [], options | jobs)
    elif part is not None:
        make_one_part(settings, out, part, options | {"leave": leave})
    else:
        from glsim.dataset import generate as run

        with generation_progress() as progress:
            summary = run(settings, out, **options, ray=ray, progress=progress)  # type: ignore[arg-type]
        print_summary(summary, out)


def _refuse_without(wanted: str, value: object, **given: object) -> None:
    """Raise ConfigError for an option that does nothing without another one."""
    for name, option in given.items():
        if value is None and option not in (None, False):
            raise ConfigError(f"--{name.replace('_', '-')} does nothing alone: add {wanted}")


def _refuse_together(**given: object) -> None:
    names = [f"--{name}" for name, value in given.items() if value not in (None, False)]
    if len(names) > 1:
        raise ConfigError(f"{' and '.join(names)} exclude each other: give one of them")
