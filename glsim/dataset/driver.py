"""The driver of a run: survey the folder, render missing chunks, merge. It resumes any run.

``generate`` makes a whole data set, ``generate_part`` one part of it, and ``merge_parts`` puts
parts together; ``write_dataset``, ``write_part`` and ``merge_dataset`` do so for given tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from glsim.dataset.chunk_writer import FrameMaker
from glsim.dataset.chunks import CHUNK_FRAMES, ChunkPlan
from glsim.dataset.cloud_output import open_output
from glsim.dataset.identity import Inputs, make_identity
from glsim.dataset.output_folder import PartBusyError
from glsim.dataset.parts import Part
from glsim.dataset.progress import GenerateProgress, GenerateSummary, PartSummary, RunCounts
from glsim.dataset.run import (
    ChunkRenderer,
    DatasetRun,
    absent_chunks,
    finish,
    in_processes,
    make_missing_chunks,
)
from glsim.errors import DatasetError, DifferentMachineError
from glsim.plan.tasks import Task, make_tasks
from glsim.settings.schema import Settings
from glsim.worker_processes import Workers, available_workers, portable_environment

Progress = Callable[[GenerateProgress], None]


def generate(
    settings: Settings,
    out: Path | str,
    *,
    workers: Workers = "auto",
    backend: str | None = None,
    portable: bool = False,
    ray: str | None = None,
    progress: Progress | None = None,
) -> GenerateSummary:
    """Generate the data set that ``settings`` describe in the folder ``out``, or resume it.

    out: a folder, or a URL of object storage such as s3://bucket/faces for the format webdataset.
    ray: the address of a cluster of Ray that renders instead of ``workers``, see
    ``glsim.ray_cluster.ray_cluster``.

    The same settings on the same renderer give the same bytes. backend: "egl" or "osmesa".
    portable: compute alike on all x86-64 processors since Haswell, see ``portable_environment``.
    Raises the errors of ``write_dataset`` and ``glsim.pipeline.simulate``.
    """
    run, render = simulation_run(
        settings, out, workers, backend=backend, portable=portable, ray=ray
    )
    return run_all(run, render, progress)


def generate_part(
    settings: Settings,
    out: Path | str,
    part: Part,
    *,
    workers: Workers = "auto",
    backend: str | None = None,
    portable: bool = False,
    leave: bool = False,
    progress: Progress | None = None,
) -> PartSummary:
    """Generate one part of a data set, and merge all parts if this was the last one.

    Parts may be made in any order, on many machines that share the folder ``out``, and again: the
    bytes are those of ``generate``. portable: as for ``generate``. leave: see ``write_part``.
    Raises the errors of ``write_part`` and ``glsim.pipeline.simulate``.
    """
    run, render = simulation_run(
        settings, out, workers, part=part, backend=backend, portable=portable
    )
    return run_part(run, render, progress, leave=leave)


def merge_parts(settings: Settings, out: Path | str) -> GenerateSummary:
    """Complete the data set of ``settings`` whose parts are all made; OpenGL is not needed.

    Raises DatasetError if a chunk is missing, and ConfigError for other settings than the parts'.
    """
    from glsim.pipeline import open_sources
    from glsim.sensors.sensor import sensor_of

    tasks = make_tasks(settings, open_sources(settings))
    return merge_dataset(settings, tasks, out, sensor=sensor_of(settings).describe())


def simulation_run(
    settings: Settings,
    out: Path | str,
    workers: Workers = "auto",
    *,
    part: Part | None = None,
    backend: str | None = None,
    portable: bool = False,
    ray: str | None = None,
) -> tuple[DatasetRun, ChunkRenderer]:
    """Return the run that simulates the data set, or a part, and what renders its chunks here."""
    # Imported here because reading a data set needs no OpenGL.
    from glsim.appearance.dress import worn_regions
    from glsim.dataset.arithmetic import machine_of_workers, simulate_alike, this_machine
    from glsim.dataset.inputs import source_hashes, stage_hashes
    from glsim.faces.regions import region_numbers
    from glsim.gl.context import borrowed_context
    from glsim.pipeline import open_sources
    from glsim.scene.scenery import scene_regions
    from glsim.sensors.sensor import sensor_of

    sensor = sensor_of(settings)
    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    worn = worn_regions(settings.appearance, sources)
    environment = portable_environment() if portable else {}
    if environment:
        machine = machine_of_workers(environment, backend)
    else:
        with borrowed_context(backend) as context:
            machine = this_machine(context)
    make_frames = partial(
        simulate_alike,
        renderer=machine.renderer,
        arithmetic=machine.arithmetic,
        sources=sources,
        backend=backend,
        layers=settings.output.layers,
    )

    def inputs() -> Inputs:
        stages, files = stage_hashes(sensor.stages), source_hashes(sources, tasks)
        return Inputs(stages, files, machine.arithmetic)

    regions = (
        region_numbers(sources, [*scene_regions(settings.scene), *worn])
        if "regions" in settings.output.layers
        else {}
    )
    described, renderer = sensor.describe(), machine.renderer
    run = DatasetRun(settings, tasks, out, make_frames, described, renderer, regions, inputs, part)
    if ray is not None:
        from glsim.dataset.ray_renderer import on_ray

        return run, on_ray(ray, environment)
    return run, in_processes(available_workers(workers), environment)


def write_dataset(
    settings: Settings,
    tasks: Sequence[Task],
    out: Path | str,
    make_frames: FrameMaker,
    *,
    sensor: Mapping[str, Any],
    renderer: str,
    regions: Mapping[str, int] | None = None,
    inputs: Callable[[], Inputs] | None = None,
    workers: Workers = "auto",
    progress: Progress | None = None,
) -> GenerateSummary:
    """Write the data set of ``tasks`` to the folder ``out``, or the frames that it still lacks.

    Existing files are verified by size and CRC32; missing and damaged files are made again. The
    bytes are the same for any number of workers and interruptions.

    make_frames: see FrameMaker. sensor, renderer: descriptions for the header; a resumed run must
    have the same ones. regions: name -> number in the layer "regions". inputs: hashes what the
    settings only name, as it is at the time of the call; a resumed run must have the same.
    workers: number of processes; 1 renders in this process.

    Raises ConfigError if the folder was begun with other settings or inputs; DatasetError if it is
    in use, cannot be written, or holds other files, if worker processes die, or if an input changes
    during the run; MeshError at the first
    bad mesh if the settings are strict; KeyboardInterrupt after ending the workers. After any of
    these, the same call continues the run.
    """
    render = in_processes(available_workers(workers))
    run = DatasetRun(settings, tasks, out, make_frames, sensor, renderer, regions, inputs)
    return run_all(run, render, progress)


def write_part(
    settings: Settings,
    tasks: Sequence[Task],
    out: Path | str,
    make_frames: FrameMaker,
    part: Part,
    *,
    sensor: Mapping[str, Any],
    renderer: str,
    regions: Mapping[str, int] | None = None,
    inputs: Callable[[], Inputs] | None = None,
    workers: Workers = "auto",
    leave: bool = False,
    progress: Progress | None = None,
) -> PartSummary:
    """Write one part of a data set, and merge all parts if this was the last one.

    leave: if ``renderer`` or the arithmetic of ``inputs`` are not those of the machine that began
    the data set, make nothing, and leave the chunks to parts that end later. Otherwise that raises
    DifferentMachineError. The other arguments and errors are those of ``write_dataset``. Also
    raises DatasetError if another process makes the same part.
    """
    render = in_processes(available_workers(workers))
    run = DatasetRun(settings, tasks, out, make_frames, sensor, renderer, regions, inputs, part)
    return run_part(run, render, progress, leave=leave)


def run_all(run: DatasetRun, render: ChunkRenderer, progress: Progress | None) -> GenerateSummary:
    """Make all chunks with ``render`` under the folder's lock, and merge them."""
    counts = RunCounts(run.frames, progress)
    with run.folder.locked(run.identity, run.found):
        make_missing_chunks(run, render, counts)
        return finish(run.folder, run.plan, run.identity, counts)


def run_part(
    run: DatasetRun, render: ChunkRenderer, progress: Progress | None, *, leave: bool = False
) -> PartSummary:
    """Make the chunks of the run's part with ``render``, and merge if no chunk is missing then."""
    assert run.part is not None
    counts = RunCounts(run.frames, progress)
    left, taken = "", []
    try:
        make_part(run, render, counts)
        taken = take_left_parts(run, render)
    except DifferentMachineError as error:
        if not leave:
            raise
        left = str(error)
        run.folder.leave_part(run.part)
    counts.report(last=True)
    # The part that completes the last chunk sees all records here, after its lock is free: two
    # parts that end together both come to this line, and the second finds the work done.
    absent = absent_chunks(run.folder, run.plan)
    whole = None
    if not absent and not left:
        folder = open_output(run.out)
        with folder.locked(run.identity, run.found, wait=True):
            whole = finish(folder, run.plan, run.identity, RunCounts(run.frames))
    return PartSummary(
        part=run.part,
        frames=counts.frames,
        skipped=counts.skipped,
        rendered=counts.rendered,
        reused=counts.reused,
        bytes=counts.bytes,
        seconds=counts.seconds,
        cpu_seconds=counts.cpu_seconds,
        absent_chunks=len(absent),
        dataset=whole,
        left=left,
        taken=tuple(taken),
    )


def make_part(run: DatasetRun, render: ChunkRenderer, counts: RunCounts) -> None:
    """Make the chunks of the run's part under its lock; a merged data set is left alone."""
    with run.folder.locked_part(run.identity, run.found):
        if not run.folder.is_merged:
            make_missing_chunks(run, render, counts)


def take_left_parts(run: DatasetRun, render: ChunkRenderer) -> list[Part]:
    """Make the chunks that other machines left; return their parts, without those in work."""
    taken = []
    for part in run.folder.left_parts():
        other = replace(run, part=part)
        with suppress(PartBusyError):
            make_part(other, render, RunCounts(other.frames))
            other.folder.take_part(part)
            taken.append(part)
    return taken


def merge_dataset(
    settings: Settings, tasks: Sequence[Task], out: Path | str, *, sensor: Mapping[str, Any]
) -> GenerateSummary:
    """Complete the data set of ``tasks`` whose parts are all made.

    The renderer and the inputs are those of the parts, and not this machine's. Raises DatasetError
    if a chunk is missing, and the errors of ``write_dataset``.
    """
    plan = ChunkPlan(tasks, CHUNK_FRAMES[settings.output.format])
    folder = open_output(out)
    begun = folder.begun_identity()
    identity = make_identity(settings, plan, sensor, begun["renderer"])
    identity |= {name: begun[name] for name in ("regions", "inputs") if name in begun}
    with folder.locked(identity):
        absent = absent_chunks(folder, plan)
        if absent:
            raise DatasetError(
                f"{out}: {len(absent)} of {len(plan)} chunks are not made yet, the first is number "
                f"{absent[0]}: run the parts that are missing, or glsim generate without --part"
            )
        return finish(folder, plan, identity, RunCounts(plan.frames))
