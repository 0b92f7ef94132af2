"""Rendering of chunks on a Ray cluster: nodes render, and the driver writes the files.

Nodes need the same glsim and the same files of faces, but no common disk: a task makes its chunk in
a temporary folder and returns the bytes. Only the driver writes the data set, so tasks that run
twice, or after their node was given up, leave no incomplete files.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from glsim.core.files.atomic import temporary_folder
from glsim.core.files.cloud import open_store
from glsim.data.chunk_writer import ChunkEvent, ChunkProgress, RenderJob, write_chunks
from glsim.data.chunks import Chunk, ChunkPlan
from glsim.data.dataset_run import ChunkRenderer
from glsim.data.disk_format import STATE
from glsim.data.frame_maker import SameMachineSimulator
from glsim.data.input_hashes import refuse_other_inputs
from glsim.data.ray_cluster import ray_cluster, run_tasks
from glsim.data.records import ChunkRecord, parse_chunk_record
from glsim.data.worker_processes import WorkerFailure, failure_of


@dataclass(frozen=True)
class MadeChunk:
    """A chunk rendered by a node: its record, its files as name -> bytes, and CPU seconds."""

    record: bytes
    files: dict[str, bytes]
    cpu_s: float


def on_ray(address: str, environment: Mapping[str, str] | None = None) -> ChunkRenderer:
    """A chunk renderer on the Ray cluster at ``address``, with variables for its processes."""

    def render(
        job: RenderJob, numbers: Sequence[int], plan: ChunkPlan
    ) -> Generator[ChunkEvent, None, None]:
        if not numbers:
            return
        with ray_cluster(address) as ray:
            calls = ((number, (plan[number],)) for number in numbers)
            shared = job, str(Path.cwd())
            for _, made in run_tasks(ray, render_on_node, shared, calls, environment):
                store = job.state.store
                record = parse_chunk_record(made.record)
                for name, data in made.files.items():
                    store.put(name, data, sync=False)
                store.flush()
                job.state.save_chunk(record)
                yield ChunkProgress(record.summary.chunk, record.summary.total, made.cpu_s)
                yield record.summary

    return render


#: The reference and the job of this process, which keeps its sources and simulator.
_kept: tuple[Any, RenderJob] | None = None
_counted_s = 0.0  # CPU seconds of this process that are in the chunks before


def render_on_node(reference: list[Any], chunk: Chunk) -> MadeChunk | WorkerFailure:
    """Render a chunk in a Ray task; return errors as WorkerFailure, since Ray wraps raised ones."""
    global _kept
    try:
        if _kept is None or _kept[0] != reference[0]:
            import ray

            job, home = ray.get(reference[0])
            with suppress(OSError):
                os.chdir(home)
            if isinstance(job.make_frames, SameMachineSimulator):
                job.make_frames.keep = True
            _kept = reference[0], job
        with temporary_folder() as folder:
            return _render(_kept[1], chunk, folder)
    except ImportError:
        raise  # the node is left out
    except Exception as error:
        return failure_of(error, f"on {socket.gethostname()}")


def _render(job: RenderJob, chunk: Chunk, folder: Path) -> MadeChunk:
    if job.inputs is not None and isinstance(job.make_frames, SameMachineSimulator):
        sources = job.make_frames.sources
        refuse_other_inputs(job.inputs, sources, chunk.tasks, socket.gethostname())
    target = job.state.store if job.state.store.is_remote else open_store(folder)
    with target.writing(STATE) as store:
        (record,) = (e for e in write_chunks(job, store, [chunk]) if isinstance(e, ChunkRecord))
    paths = [path for path in folder.rglob("*") if path.is_file()]
    files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
    global _counted_s
    before, _counted_s = _counted_s, time.process_time()
    return MadeChunk(record.to_bytes(), files, _counted_s - before)
