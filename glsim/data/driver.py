"""Functions that generate a data set or a part of it, or resume its generation.

Steps of a run, in the order of the calls:

1. plan: ``simulation.plan.tasks.make_tasks`` lists the frames; ``chunks`` groups them.
2. survey: ``dataset_run`` finds chunks without record or files; ``state_folder`` locks.
3. render: ``worker_processes`` run ``chunk_writer``, which takes frames from ``frame_maker`` (the
   ``Simulator``) and writes their PNG files and one record per chunk.
4. merge: ``merge`` joins the records to the manifest, and writes the header last.
"""

from __future__ import annotations

from pathlib import Path

from glsim.core.files.cloud import open_store
from glsim.data.arithmetic import machine_of_workers, this_machine
from glsim.data.chunks import Part
from glsim.data.dataset_run import ChunkRenderer, DatasetRun, in_processes, run_all, run_part
from glsim.data.frame_maker import SameMachineSimulator
from glsim.data.input_hashes import source_hashes, stage_hashes
from glsim.data.progress import GenerateSummary, PartSummary, Progress
from glsim.data.run_identity import InputHashes
from glsim.data.worker_processes import Workers, available_workers, portable_environment
from glsim.faces.regions import region_numbers
from glsim.gl.context import borrowed_context
from glsim.looks.dress import worn_regions
from glsim.looks.room.scenery import scene_regions
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings
from glsim.simulation.pipeline import open_sources
from glsim.simulation.plan.tasks import make_tasks


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

    The same settings on the same renderer give the same bytes.

    Raises the errors of ``write_dataset`` and ``glsim.simulation.pipeline.simulate``.

    Args:
        out: a folder, or a URL such as s3://bucket/faces for the format webdataset.
        portable: compute alike on all x86-64 processors since Haswell, see
            ``portable_environment``.
        ray: address of a Ray cluster that renders instead of ``workers``, see
            ``glsim.data.ray_cluster.ray_cluster``.
    """
    run, render = _simulation(settings, out, workers, backend, portable, ray)
    return run_all(run, render, progress)


def generate_part(
    settings: Settings,
    out: Path | str,
    part: Part,
    *,
    workers: Workers = "auto",
    backend: str | None = None,
    portable: bool = False,
    progress: Progress | None = None,
) -> PartSummary:
    """Generate one part of a data set; the last part to finish also merges all parts.

    Parts may be made in any order, repeatedly, on many machines that share the folder ``out``, with
    the bytes of ``generate``. Raises its errors, and DatasetError if another makes the same part.
    """
    run, render = _simulation(settings, out, workers, backend, portable)
    return run_part(run, part, render, progress)


def _simulation(
    settings: Settings, out: Path | str, workers: Workers, backend: str | None, portable: bool,
    ray: str | None = None,
) -> tuple[DatasetRun, ChunkRenderer]:  # fmt: skip
    """Return the run of a simulated data set, and the function that renders its chunks."""
    sensor = sensor_of(settings)
    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    environment = portable_environment() if portable else {}
    if environment:
        machine = machine_of_workers(environment, backend)
    else:
        with borrowed_context(backend) as context:
            machine = this_machine(context)
    make_frames = SameMachineSimulator(machine, sources, backend, settings.output.layers)

    def inputs() -> InputHashes:
        stages, files = stage_hashes(sensor.stages), source_hashes(sources, tasks)
        return InputHashes(stages, files, machine.arithmetic)

    regions = {}
    if "regions" in settings.output.layers:
        worn = worn_regions(settings.appearance, sources)
        regions = region_numbers(sources, [*scene_regions(settings.scene), *worn])
    described, renderer = sensor.describe(), machine.renderer
    store = open_store(out)
    run = DatasetRun(settings, tasks, store, make_frames, described, renderer, regions, inputs)
    if ray is not None:
        from glsim.data.ray_renderer import on_ray

        return run, on_ray(ray, environment)
    return run, in_processes(available_workers(workers), environment)
