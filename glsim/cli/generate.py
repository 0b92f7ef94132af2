"""``glsim generate``: generate a data set of clean and noisy depth frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from glsim.cli.common import (
    PresetOption,
    SensorOption,
    SetOption,
    make_console,
    overrides,
    print_message,
)
from glsim.cli.progress import frame_progress, print_summary
from glsim.core.errors import ConfigError, MeshError, counted

if TYPE_CHECKING:
    from glsim.data.progress import GenerateSummary
    from glsim.faces.face_source import FaceSource
    from glsim.settings.schema import Settings
    from glsim.simulation.plan.tasks import Plan

#: Preset of embedded heads if neither ``--preset`` nor ``--config`` is given.
DEFAULT_PRESET = "heads"
#: ``--plan`` renders some frames to measure time and size: number of frames per person, number of
#: people, and seconds after which it starts no more frames. Chosen, not measured.
_SAMPLED_FRAMES, _SAMPLED_PEOPLE, _SAMPLING_S = 4, 3, 8.0
#: Number of people in each folder whose unit and pose are printed. Chosen, not measured.
_SHOWN_PEOPLE = 3
#: Seconds in which a worker process imports its modules, measured on a two-core cloud machine.
_PROCESS_S = 1.5
#: Bytes of a frame's record, measured with kinect-v2.
_RECORD_BYTES = 1_600


def generate(
    out: Annotated[str | None, typer.Option("-o", "--out")] = None,
    source: str | None = None,
    root: Path | None = None,
    subjects: int | None = None,
    frames_per_subject: int | None = None,
    sensor: SensorOption = None,
    assignments: SetOption = None,
    seed: int | None = None,
    preset: PresetOption = None,
    plan: Annotated[bool, typer.Option("--plan")] = False,
    config: Path | None = None,
    workers: str = "auto",
    part: Annotated[str | None, typer.Option(metavar="I/N")] = None,
    ray: Annotated[str | None, typer.Option(metavar="ADDRESS")] = None,
) -> None:
    """Generate a data set of clean and noisy depth frames, split by subject; resumable.

    Without options: 10 embedded heads, 30 frames each, dressed, turned, at 0.6 to 1.3 m before a
    kinect-v2, whole images: the preset heads, which embedded heads have without --preset and
    --config. A seed gives the same bytes on all x86-64 processors since 2013. What has no option
    here is a setting: glsim presets lists collections of them, docs/reference/settings.md all.

    Args:
        out: Folder for the data set, or a URL such as s3://bucket/faces for shards. Default: none;
            --plan needs no folder.
        subjects: Number of people. Default: all of a folder, else 10.
        frames_per_subject: Frames per person; a folder's meshes are used again, with other
            noise, and other poses if settings draw them. Default: all of a folder, else 30.
        plan: Print the number of images, their size and time by a dozen of them; write nothing.
        part: Make part I of N (from 0, or from 1 to N), as one of N jobs with the same options;
            the last part to end merges all. Default: the whole data set.
        ray: Render on a cluster of Ray: auto, HOST:6379, or local (needs the extra ray).
            Default: on this machine.
    """
    from glsim.data.worker_processes import worker_count
    from glsim.settings.schema import load_settings

    given = any(text.startswith(("source=", "source.kind")) for text in assignments or ())
    if preset is None and config is None and source in (None, "procedural") and not given:
        preset = DEFAULT_PRESET
    if root is not None and source is None and config is None and not given:
        raise ConfigError(f"--root {root}: say what it holds by --source, for mesh files: folder")
    counts = overrides(subjects=subjects, frames_per_subject=frames_per_subject)
    faces = overrides(kind=source, root=root) | counts
    settings = load_settings(
        config, assignments or [], overrides(sensor=sensor, seed=seed), faces, preset
    )
    if plan:
        _print_plan(settings, worker_count(workers))
        return
    if out is None:
        raise ConfigError("give -o DIR, the folder of the data set (or --plan to print the plan)")
    if part is not None and ray is not None:
        raise ConfigError("--part and --ray exclude each other: give one of them")
    if ray is not None and workers != "auto":
        raise ConfigError("--workers and --ray exclude each other: a cluster uses all its cores")
    from glsim.data.chunks import parse_part
    from glsim.data.driver import generate as make_all
    from glsim.data.driver import generate_part

    count = worker_count(workers)
    _print_poses(settings)
    if part is None:
        with frame_progress() as progress:
            whole = make_all(
                settings, out, workers=count, portable=True, ray=ray, progress=progress
            )
        print_summary(whole, out)
        _print_empty_splits(settings, whole)
        return
    chosen = parse_part(part)
    with frame_progress() as progress:
        made = generate_part(settings, out, chosen, workers=count, portable=True, progress=progress)
    print_message(
        f"{out}: part {chosen}: {counted(made.frames, 'frame')}, {made.skipped} skipped, "
        f"{made.rendered} of them in this run of {made.seconds:.1f} s"
    )
    if made.dataset is not None:
        print_summary(made.dataset, out)
    else:
        print_message(f"not complete yet: {made.missing}; the last part merges")


def _print_poses(settings: Settings) -> None:
    """Print unit and pose of the first meshes of each folder, and doubts about them."""
    from glsim.faces.face_source import BadFace
    from glsim.faces.meshes.alignment import describe_notes
    from glsim.faces.scans.file_source import FileFaces
    from glsim.simulation.pipeline import open_sources

    sources = open_sources(settings)
    _print_doubts(settings, sources)
    for table, source in zip(settings.source, sources, strict=True):
        if isinstance(source, FileFaces):
            people = source.subjects(table.subjects)
            keys = [source.frames(person, 1)[0] for person in people[:_SHOWN_PEOPLE]]
            meshes = sum(len(source.frames(person, None)) for person in people)
            bad = list[MeshError]()
            for face in source.load(keys):
                if isinstance(face, BadFace):
                    bad.append(face.error)  # the run reports them all
                    continue
                placement, doubts = describe_notes(face.notes)
                print_message("; ".join([f"{face.key.path}: {placement}", *doubts]))
            if len(bad) == meshes and len(settings.source) == 1:
                raise MeshError(f"{source.root}: no mesh in it can be used, for example {bad[0]}")
            if len(people) > _SHOWN_PEOPLE:
                print_message(f"{len(people)} people: glsim inspect {source.root} -o faces.png")


def _print_doubts(settings: Settings, sources: Sequence[FaceSource]) -> None:
    """Print which settings have no effect, and which folders another source reads better."""
    from glsim.data.inspection import recognise
    from glsim.simulation.no_effect import no_effect

    for line in no_effect(settings, sources):
        print_message(line)
    for table in settings.source:
        if table.kind == "folder" and table.root and (kind := recognise(table.root)) != "folder":
            print_message(f"{table.root}: looks like {kind}, not like any folder: --source {kind}")


def _print_empty_splits(settings: Settings, whole: GenerateSummary) -> None:
    """Print which splits got no person although their share is above 0, and the cause."""
    from glsim.settings.schema import SPLIT_NAMES
    from glsim.simulation.pipeline import open_sources
    from glsim.simulation.plan.tasks import make_tasks

    if isinstance(settings.split, str):
        return
    shares = zip(SPLIT_NAMES, settings.split, strict=True)
    if empty := [name for name, share in shares if share > 0 and not whole.frames[name]]:
        planned = {person.split for person in make_tasks(settings, open_sources(settings)).people()}
        few = f"people in all: {sum(whole.subjects.values())}, too few for this split"
        for why in (few, "all frames of their people were skipped"):
            if names := [name for name in empty if (name in planned) is (why != few)]:
                print_message(f"nobody is in {' and '.join(names)}: {why}: add people")


def _print_plan(settings: Settings, workers: int) -> None:
    """Print the number of images by source and split, their size, and the estimated time."""
    from rich.filesize import decimal
    from rich.table import Table

    from glsim.data.chunks import CHUNK_FRAMES
    from glsim.sensors.sensor import sensor_code, sensor_of
    from glsim.settings.schema import SPLIT_NAMES
    from glsim.simulation.pipeline import open_sources
    from glsim.simulation.plan.tasks import make_tasks

    if not sensor_code(settings):  # a plan must not run a sensor's code
        sensor_of(settings)
    sources = open_sources(settings)
    _print_doubts(settings, sources)
    plan = make_tasks(settings, sources)
    out = make_console(width=120)
    by_source: dict[str, tuple[int, int]] = {}
    by_split = dict.fromkeys(SPLIT_NAMES, (0, 0))
    for person in plan.people():
        source = f"{person.source} {sources[person.source].name}"
        for sums, key in ((by_source, source), (by_split, person.split)):
            people, images = sums.get(key, (0, 0))
            sums[key] = people + 1, images + person.frames
    for head, sums in (("source", by_source), ("split", by_split)):
        table = Table(head, "people", "images", "share", box=None)
        for name, (people, images) in sums.items():
            table.add_row(name, str(people), str(images), f"{100 * images / len(plan):.1f} %")
        out.print(table)
    if sensor_code(settings):
        how = "no time is estimated: the sensor names code, which a plan does not run"
    elif (cost := _measured_cost(settings, sources, plan)) is None:
        how = "no time is estimated: none of a dozen frames could be drawn"
    else:
        seconds = len(plan) * cost.frame_s + sum(1 for _ in plan.people()) * cost.person_s
        output = settings.output
        chunk = output.frames_per_shard or CHUNK_FRAMES[output.format]
        busiest = min(len(plan), -(-len(plan) // (chunk * workers)) * chunk)  # frames of a worker
        seconds = seconds * max(busiest / len(plan), 1 / workers) + cost.start_s
        how = (
            f"{decimal(int(len(plan) * cost.frame_bytes))}, about {_time(seconds)} with "
            f"{counted(workers, 'worker')} on this machine (measured on "
            f"{counted(cost.sampled, 'frame')})"
        )
    out.print(f"{counted(len(plan), 'image')}, {how}; nothing was written")


class _Cost(NamedTuple):
    """Measured bytes and seconds per frame, seconds per person, and seconds of a worker's start."""

    frame_bytes: float
    frame_s: float
    person_s: float
    start_s: float
    sampled: int


def _measured_cost(settings: Settings, sources: Sequence[FaceSource], plan: Plan) -> _Cost | None:
    """Render and encode some frames of a plan; None if no frame can be rendered."""
    from statistics import median

    from glsim.data.layer_images import layer_png
    from glsim.simulation.frame import Skipped
    from glsim.simulation.pipeline import simulate

    people = list(plan.people())
    chosen = people[:: -(-len(people) // _SAMPLED_PEOPLE)]
    tasks = [plan[p.first + n] for p in chosen for n in range(min(p.frames, _SAMPLED_FRAMES))]
    layers, sizes = settings.output.layers, []
    first, later = list[float](), list[float]()
    begun = last = perf_counter()
    drawn = simulate(settings, tasks, sources=sources, layers=layers)
    for task, frame in zip(tasks, drawn, strict=True):
        if not isinstance(frame, Skipped):
            images = (layer_png(frame, layer) for layer in layers)
            sizes.append(sum(map(len, images)) + _RECORD_BYTES)
        now = perf_counter()
        (first if any(task.index == p.first for p in chosen) else later).append(now - last)
        last = now
        if now - begun > _SAMPLING_S:
            break
    if not sizes:
        return None
    frame_s = median(later or first[1:] or first)
    person_s = max(0.0, median(first[1:] or first) - frame_s)
    start_s = _PROCESS_S + max(0.0, first[0] - person_s - frame_s)
    return _Cost(sum(sizes) / len(sizes), frame_s, person_s, start_s, len(sizes))


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
