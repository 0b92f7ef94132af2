"""Test the array of jobs with submitit's executor for processes of this machine."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from glsim.dataset import GenerateProgress, chunks, generate
from glsim.dataset.slurm import PartJob, generate_on_slurm, in_queue, slurm_options, wait_for
from glsim.errors import ConfigError, DatasetError
from tests.dataset.test_machines import tiny
from tests.support.dataset_fakes import contents

pytest.importorskip("submitit")


@pytest.fixture(autouse=True)
def look_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glsim.dataset.slurm._LOOK_EVERY_S", 0.2)


@pytest.mark.long
def test_an_array_of_jobs_gives_the_bytes_of_one_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = tiny(tmp_path)
    generate(settings, tmp_path / "whole", workers=1)
    states: list[GenerateProgress] = []
    summary = generate_on_slurm(
        settings, tmp_path / "out", 3, cluster="local", workers=1, progress=states.append
    )
    assert summary.rendered == 6
    assert states[-1].done == states[-1].total == 6
    logs = tmp_path / "out" / ".glsim" / "slurm"
    assert list(logs.iterdir())
    made = contents(tmp_path / "out")
    assert {n: b for n, b in made.items() if "/slurm/" not in n} == contents(tmp_path / "whole")


@pytest.mark.long
def test_a_job_that_fails_is_named_with_its_log(tmp_path: Path) -> None:
    settings = tiny(tmp_path)
    with pytest.raises(DatasetError, match=r"Slurm job \d+ ended with: .*: see .*\.err; run the"):
        generate_on_slurm(
            settings, tmp_path / "out", 1, cluster="local", workers=1, backend="no such back end"
        )


def test_a_job_that_is_preempted_comes_back(tmp_path: Path) -> None:
    from glsim.dataset import Part

    job = PartJob(tiny(tmp_path), tmp_path / "out", Part(0, 1), {"workers": 1})
    assert job.checkpoint().function is job
    assert job().dataset is not None


def test_options_of_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = slurm_options(["cpus_per_task=8", "slurm_partition=cpu", "slurm_time=0:30"])
    assert given == {"cpus_per_task": 8, "slurm_partition": "cpu", "slurm_time": "0:30"}
    for wrong in ("mem_gb", "=4", "mem gb=4", "mem_gb="):
        with pytest.raises(ConfigError, match="give NAME=VALUE, such as mem_gb=8"):
            slurm_options([wrong])
    settings = tiny(tmp_path)
    with pytest.raises(ConfigError, match=r"--slurm: .*no_such_option"):
        generate_on_slurm(settings, tmp_path / "a", 1, cluster="local", slurm={"no_such_option": 1})
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(ConfigError, match=r"--slurm needs submitit: pip install 'glsim\[slurm\]'"):
        generate_on_slurm(settings, tmp_path / "a", 1)


class _Lost:
    """A job that was killed where Slurm keeps no accounts: submitit waits for it for ever."""

    job_id = "7_0"
    cancelled = False

    class paths:  # noqa: N801
        stderr = "7_0_0_log.err"

    def done(self) -> bool:
        return False

    def cancel(self, check: bool) -> None:
        self.cancelled = True


def test_a_job_that_vanishes_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    squeue = tmp_path / "squeue"
    squeue.write_text(f"#!/bin/sh\necho asked >> {tmp_path}/asked\nexit 1\n")
    squeue.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("glsim.dataset.slurm._LOOK_EVERY_S", 0.01)
    job = _Lost()
    with pytest.raises(
        DatasetError, match=r"Slurm job 7_0 is gone and left no result: see 7_0_0_lo"
    ):
        wait_for([job], lambda: None, in_queue)
    assert (tmp_path / "asked").read_text().count("asked") == 2


def test_a_job_is_waited_for_while_it_is_in_the_queue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    squeue = tmp_path / "squeue"
    squeue.write_text("#!/bin/sh\necho 7_0\necho 7_1\n")
    squeue.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert in_queue(["7_0", "7_1"]) == {"7_0", "7_1"}
    (tmp_path / "squeue").unlink()
    assert in_queue(["7_0"]) == {"7_0"}, "without squeue nobody knows"


def test_there_are_no_more_jobs_than_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "png", 2)
    asked: list[PartJob] = []
    monkeypatch.setattr("glsim.dataset.slurm._executor", lambda *_: _Refusing(asked))
    with pytest.raises(KeyboardInterrupt):
        generate_on_slurm(tiny(tmp_path), tmp_path / "out", 50)
    assert [str(job.part) for job in asked] == ["0/3"]  # six frames, all of the split train


class _Refusing:
    def __init__(self, asked: list[PartJob]) -> None:
        self._asked = asked

    def batch(self) -> _Refusing:
        return self

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def submit(self, job: PartJob) -> None:
        self._asked.append(job)
        raise KeyboardInterrupt
