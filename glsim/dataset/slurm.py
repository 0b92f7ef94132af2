"""Submit the parts of a data set as an array of Slurm jobs, through the library submitit."""

from __future__ import annotations

import logging
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from glsim.dataset.chunks import CHUNK_FRAMES, ChunkPlan
from glsim.dataset.disk_format import STATE
from glsim.dataset.driver import generate_part, merge_dataset
from glsim.dataset.parts import Part
from glsim.dataset.progress import GenerateProgress, GenerateSummary, PartSummary
from glsim.dataset.run_state import RunState
from glsim.errors import ConfigError, DatasetError
from glsim.files.store import open_store
from glsim.plan.tasks import make_tasks
from glsim.settings.schema import Settings

#: Seconds between two looks at the folder and the queue. Slurm's developers ask for few queries.
_LOOK_EVERY_S = 5.0
#: Minutes that a job may run unless the caller says otherwise: a day, as most queues allow.
TIMEOUT_MIN = 24 * 60


@dataclass(frozen=True)
class PartJob:
    """What a job of the array does; picklable. ``options``: of ``generate_part``."""

    settings: Settings
    out: Path
    part: Part
    options: Mapping[str, Any]

    def __call__(self) -> PartSummary:
        """Make the part, or what is missing of it."""
        return generate_part(self.settings, self.out, self.part, **self.options)

    def checkpoint(self) -> Any:
        """Ask for the same job again: Slurm preempts it or its time is over."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self)


def generate_on_slurm(
    settings: Settings,
    out: Path,
    parts: int,
    *,
    slurm: Mapping[str, Any] | None = None,
    cluster: str | None = None,
    progress: Callable[[GenerateProgress], None] | None = None,
    **options: Any,
) -> GenerateSummary:
    """Submit ``parts`` jobs as one array, wait for them, and complete the data set.

    Ctrl-C cancels the jobs; what they made stays. Logs are in ``out/.glsim/slurm``.
    Raises ConfigError without submitit or Slurm, DatasetError if jobs fail.

    Args:
        slurm: options of submitit's executor, such as cpus_per_task, timeout_min, slurm_partition.
        cluster: "slurm", or submitit's "local" for processes of this machine; None: Slurm.
        options: of ``generate_part``.
    """
    # Imported here because reading a data set needs no OpenGL.
    from glsim.pipeline import open_sources
    from glsim.sensors.sensor import sensor_of

    executor = _executor(out, cluster or "slurm", slurm or {})
    tasks = make_tasks(settings, open_sources(settings))
    plan = ChunkPlan(tasks, CHUNK_FRAMES[settings.output.format])
    count = min(parts, len(plan))
    jobs_of = [PartJob(settings, out, Part(number, count), options) for number in range(count)]
    started = time.monotonic()
    with executor.batch():
        jobs: Sequence[Any] = [executor.submit(job) for job in jobs_of]
    watch = _Watch(RunState(open_store(out)), plan, progress)
    wait_for(jobs, watch.look, in_queue if executor.cluster == "slurm" else None)
    watch.look()
    results = [_result(job) for job in jobs]
    # The last part has merged; this reads what it made, or says what is missing.
    whole = merge_dataset(settings, tasks, out, sensor=sensor_of(settings).describe())
    return GenerateSummary(
        frames=whole.frames,
        subjects=whole.subjects,
        skipped=whole.skipped,
        rendered=sum(part.rendered for part in results),
        reused=sum(part.reused for part in results),
        bytes=sum(part.bytes for part in results),
        seconds=time.monotonic() - started,
        cpu_seconds=sum(part.cpu_seconds for part in results),
    )


def wait_for(
    jobs: Sequence[Any],
    look: Callable[[], None],
    queued: Callable[[Sequence[str]], set[str]] | None,
) -> None:
    """Wait until all jobs have ended, and call ``look`` now and then; cancel them after an error.

    Raises DatasetError if a job is gone without a result.

    Args:
        queued: returns which of these jobs Slurm still knows. Where Slurm keeps no accounts,
            submitit waits for a killed job for ever.
    """
    gone: set[str] = set()
    try:
        while waiting := [job for job in jobs if not job.done()]:
            look()
            time.sleep(_LOOK_EVERY_S)
            if queued is None:
                continue
            before, gone = gone, {job.job_id for job in waiting}
            gone -= queued([job.job_id for job in waiting])
            for job in waiting:
                # Twice: its result may arrive after it has left the queue.
                if job.job_id in before & gone and not job.done():
                    raise DatasetError(
                        f"Slurm job {job.job_id} is gone and left no result: see "
                        f"{job.paths.stderr}; run the same command again to continue"
                    )
    except BaseException:
        for job in jobs:
            job.cancel(check=False)
        raise


def in_queue(job_ids: Sequence[str]) -> set[str]:
    """Return which of these jobs squeue lists, and all of them if it cannot be run."""
    arrays = {job_id.partition("_")[0] for job_id in job_ids}
    command = ["squeue", "--noheader", "--array", "--format=%i", f"--jobs={','.join(arrays)}"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return set(job_ids)
    return set(done.stdout.split())  # none if it fails: it does not know the array any more


def _executor(out: Path, cluster: str, options: Mapping[str, Any]) -> Any:
    try:
        import submitit
    except ImportError:
        raise ConfigError("--slurm needs submitit: pip install 'glsim[slurm]'") from None
    logging.getLogger("submitit").setLevel(logging.ERROR)  # it warns of missing accounts
    folder = out / STATE / "slurm"
    try:
        executor = submitit.AutoExecutor(folder=folder, cluster=cluster)
        executor.update_parameters(**{"name": "glsim", "timeout_min": TIMEOUT_MIN} | dict(options))
    except (RuntimeError, TypeError, NameError, ValueError) as error:
        raise ConfigError(f"--slurm: {error}") from None
    return executor


class _Watch:
    """Reads the progress from the chunk records that the jobs have written."""

    def __init__(
        self,
        state: RunState,
        plan: ChunkPlan,
        callback: Callable[[GenerateProgress], None] | None,
    ) -> None:
        self._state, self._plan, self._callback = state, plan, callback
        self._before: int | None = None

    def look(self) -> None:
        if self._callback is None:
            return
        recorded = self._state.recorded_chunks()
        done = sum(self._plan.frames_in(n) for n in recorded if n < len(self._plan))
        if self._state.is_merged:
            done = self._plan.frames
        if self._before is None:
            self._before = done
        self._callback(GenerateProgress(done, self._plan.frames, 0, self._before, 0))


def _result(job: Any) -> PartSummary:
    error = job.exception()
    if error is not None:
        lines = str(error).strip().splitlines() or [type(error).__name__]
        raise DatasetError(
            f"Slurm job {job.job_id} ended with: {lines[-1].strip()}: see {job.paths.stderr}; run "
            "the same command again to continue"
        )
    result = job.result()
    assert isinstance(result, PartSummary)
    return result


def slurm_options(assignments: Sequence[str]) -> dict[str, Any]:
    """Parse "cpus_per_task=8" and "slurm_partition=cpu". Raises ConfigError."""
    options: dict[str, Any] = {}
    for assignment in assignments:
        name, equals, value = assignment.partition("=")
        if not equals or not name.isidentifier() or not value:
            raise ConfigError(f"--slurm-set {assignment}: give NAME=VALUE, such as mem_gb=8")
        options[name] = int(value) if value.lstrip("-").isdigit() else value
    return options
