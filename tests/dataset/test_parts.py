"""Test data sets made in parts: any order, kills, two at once; the bytes are those of one run."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from glsim.dataset import (
    GenerateSummary,
    Part,
    PartSummary,
    merge_dataset,
    parse_part,
    verify,
)
from glsim.dataset.dataset_run import DatasetRun, in_processes
from glsim.dataset.identity import InputHashes
from glsim.dataset.part_run import run_part
from glsim.errors import ConfigError, DatasetError, DifferentMachineError
from glsim.files.store import open_store
from tests.support.dataset_fakes import (
    FORMATS,
    SENSOR,
    SKIP,
    Fault,
    contents,
    fake_frames,
    make,
    make_settings,
    make_tasks,
)

ROOT = Path(__file__).parents[2]


def make_part(
    out: Path,
    part: str,
    format: str = "png",
    *,
    tasks: Any = None,
    renderer: str = "fake renderer",
    workers: int = 1,
    inputs: Any = None,
    progress: Any = None,
    leave: bool = False,
    **faults: Any,
) -> PartSummary:
    run = DatasetRun(
        make_settings(format=format),
        make_tasks() if tasks is None else tasks,
        open_store(out),
        partial(fake_frames, **(SKIP | faults)),
        SENSOR,
        renderer,
        inputs=inputs,
    )
    return run_part(run, parse_part(part, {}), in_processes(workers), progress, leave=leave)


def merge_all(out: Path, format: str = "png") -> GenerateSummary:
    return merge_dataset(make_settings(format=format), make_tasks(), out, sensor=SENSOR)


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("order", ["012", "210", "120"])
def test_parts_in_any_order_give_the_bytes_of_one_run(
    tmp_path: Path, undisturbed, format: str, order: str
) -> None:
    for number in order[:-1]:
        summary = make_part(tmp_path, f"{number}/3", format)
        assert summary.dataset is None
        assert summary.absent_chunks > 0
        assert "is not complete: run glsim generate again" in verify(tmp_path)[0]
    last = make_part(tmp_path, f"{order[-1]}/3", format, workers=2)
    assert last.absent_chunks == 0
    assert last.dataset is not None
    assert sum(last.dataset.frames.values()) == 138
    assert contents(tmp_path) == undisturbed[format]
    assert verify(tmp_path, deep=True) == []


def test_a_part_counts_its_own_frames_only(tmp_path: Path) -> None:
    states: list[Any] = []
    parts = [make_part(tmp_path, f"{number}/2", progress=states.append) for number in (1, 2)]
    assert sum(part.frames for part in parts) == 138
    assert sum(part.skipped for part in parts) == 22
    assert [part.rendered for part in parts] == [part.frames + part.skipped for part in parts]
    assert states[-1].done == states[-1].total == parts[1].rendered
    assert parts[1].dataset is not None
    assert parts[1].dataset.skipped == {"no triangles": 22}


def test_a_complete_set_is_left_alone_by_its_parts(tmp_path: Path, undisturbed) -> None:
    make(tmp_path, **SKIP)
    summary = make_part(tmp_path, "1/3")
    assert (summary.rendered, summary.absent_chunks) == (0, 0)
    assert summary.dataset is not None
    assert merge_all(tmp_path).rendered == 0
    assert contents(tmp_path) == undisturbed["png"]


def test_parts_of_a_complete_set_that_cannot_be_written_leave_it_alone(
    tmp_path: Path, read_only
) -> None:
    made = make(tmp_path, **SKIP)
    read_only(tmp_path, errno.EROFS)
    summary = make_part(tmp_path, "1/3")
    assert (summary.rendered, summary.absent_chunks) == (0, 0)
    assert summary.dataset is not None
    assert summary.dataset.frames == merge_all(tmp_path).frames == made.frames
    (tmp_path / "manifest.jsonl").write_bytes(b"")
    for again in (merge_all, partial(make_part, part="1/3")):
        with pytest.raises(DatasetError, match=r"cannot write .*: Read-only file system"):
            again(tmp_path)


def test_a_part_resumes_after_an_error_and_keeps_what_it_has(tmp_path: Path, undisturbed) -> None:
    fault = Fault("bug", 117)
    with pytest.raises(ZeroDivisionError):
        make_part(tmp_path, "0/1", faults=(fault,))
    assert not (tmp_path / ".glsim" / "temporary" / "0-of-1").exists()
    summary = make_part(tmp_path, "0/1")
    assert summary.reused > 0
    assert contents(tmp_path) == undisturbed["png"]


SCRIPT = """
import sys
from pathlib import Path
from tests.dataset.test_parts import make_part
make_part(Path(sys.argv[1]), sys.argv[2], sys.argv[3], workers=int(sys.argv[4]), delay_s=0.01,
          progress=lambda state: print(state.done, flush=True))
"""


def start_part(out: Path, part: str, format: str, workers: int = 1) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(out), part, format, str(workers)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    ("format", "workers"), [("png", 1), pytest.param("webdataset", 2, marks=pytest.mark.long)]
)
def test_a_killed_part_resumes_beside_the_others(
    tmp_path: Path, undisturbed, format: str, workers: int
) -> None:
    process = start_part(tmp_path, "0/2", format, workers)
    assert process.stdout is not None
    while int(process.stdout.readline()) < 5:
        pass
    process.send_signal(signal.SIGSTOP)  # it holds its lock for as long as this test takes
    with pytest.raises(DatasetError, match="part 0/2 is being made by another process: wait"):
        make_part(tmp_path, "0/2", format)
    with pytest.raises(DatasetError, match="another run is writing here"):
        make(tmp_path, make_settings(format=format), **SKIP)
    other = make_part(tmp_path, "1/2", format)
    assert other.dataset is None
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=20)
    with pytest.raises(
        DatasetError, match=r"chunks are not made yet, the first is number \d+: run"
    ):
        merge_all(tmp_path, format)
    summary = make_part(tmp_path, "2/2", format)
    assert summary.dataset is not None
    assert contents(tmp_path) == undisturbed[format]


@pytest.mark.long
def test_parts_that_run_at_the_same_time_merge_once(tmp_path: Path, undisturbed) -> None:
    processes = [start_part(tmp_path, f"{number}/3", "png") for number in range(3)]
    assert [process.communicate(timeout=60) and process.returncode for process in processes] == [
        0, 0, 0
    ]  # fmt: skip
    assert contents(tmp_path) == undisturbed["png"]


def test_one_run_completes_parts_and_merge_alone_works(
    tmp_path: Path, undisturbed, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_part(tmp_path / "a", "0/3")
    assert make(tmp_path / "a", **SKIP).reused > 0
    assert contents(tmp_path / "a") == undisturbed["png"]
    with pytest.raises(DatasetError, match="no data set was begun here"):
        merge_all(tmp_path / "none")
    # Both parts are complete, and the last process was killed just before it merged.
    monkeypatch.setattr("glsim.dataset.part_run.absent_chunks", lambda folder, plan: [0])
    for number in (0, 1):
        assert make_part(tmp_path / "b", f"{number}/2").dataset is None
    monkeypatch.undo()
    merge_all(tmp_path / "b")
    assert contents(tmp_path / "b") == undisturbed["png"]


def test_merge_needs_no_renderer_and_compares_the_settings(tmp_path: Path, undisturbed) -> None:
    whole = make_part(tmp_path, "0/1", inputs=lambda: InputHashes({"a.glsl": "1"}, {}, "x"))
    assert whole.dataset is not None
    assert merge_all(tmp_path).frames == whole.dataset.frames
    with pytest.raises(ConfigError, match=r"was begun with output.format = \"png\", not"):
        merge_all(tmp_path, "webdataset")


def test_parts_of_other_settings_or_machines_are_refused(tmp_path: Path) -> None:
    make_part(tmp_path, "0/3")
    with pytest.raises(ConfigError, match="planned_frames = 160, not 140"):
        make_part(tmp_path, "1/3", tasks=make_tasks(7))
    with pytest.raises(ConfigError, match='renderer = "fake renderer", not "another"'):
        make_part(tmp_path, "1/3", renderer="another")


@pytest.mark.parametrize("different", ["renderer", "arithmetic"])
def test_a_machine_that_differs_leaves_its_chunks_to_the_others(
    tmp_path: Path, different: str
) -> None:
    def part(number: int, other: bool = False, **options: Any) -> PartSummary:
        renderer = "another" if other and different == "renderer" else "fake renderer"
        arithmetic = "another" if other and different == "arithmetic" else "first"
        inputs = partial(InputHashes, {}, {}, arithmetic)
        return make_part(
            tmp_path / "out", f"{number}/3", renderer=renderer, inputs=inputs, **options
        )

    part(0)
    with pytest.raises(DifferentMachineError, match=r"was begun (with renderer|by a version)"):
        part(1, other=True)
    left = part(1, other=True, leave=True)
    assert (left.rendered, left.dataset) == (0, None)
    assert "was begun" in left.left
    last = part(2)
    assert last.taken == (Part(1, 3),)
    assert last.dataset is not None
    assert verify(tmp_path / "out", deep=True) == []
    make(tmp_path / "whole", inputs=partial(InputHashes, {}, {}, "first"), **SKIP)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_parts_are_named_by_both_ways_of_counting() -> None:
    assert [Part(n, 3).chunks(8) for n in (0, 1, 2, 3)] == [
        range(0, 8, 3), range(1, 8, 3), range(2, 8, 3), range(0, 8, 3)
    ]  # fmt: skip
    assert Part(3, 3).name == Part(0, 3).name == "0-of-3"
    assert parse_part("3/16", {}) == Part(3, 16)
    slurm = {"SLURM_ARRAY_TASK_ID": "7", "SLURM_ARRAY_TASK_COUNT": "4", "SLURM_ARRAY_TASK_MIN": "5"}
    assert parse_part("auto", slurm) == Part(2, 4)
    assert parse_part("auto/16", {"SLURM_ARRAY_TASK_ID": "7"}) == Part(7, 16)
    batch = {"AWS_BATCH_JOB_ARRAY_INDEX": "3", "AWS_BATCH_JOB_ARRAY_SIZE": "9"}
    assert parse_part("auto", batch) == Part(3, 9)
    sky = {"SKYPILOT_NODE_RANK": "0", "SKYPILOT_NUM_NODES": "2"}
    assert parse_part("auto", sky) == Part(0, 2)
    assert parse_part("auto/8", {"JOB_COMPLETION_INDEX": "6"}) == Part(6, 8)
    for text, environment, message in [
        ("auto", {}, "--part auto: this is no job of an array: none of SLURM_ARRAY_TASK_ID"),
        ("auto", {"JOB_COMPLETION_INDEX": "6"}, "does not say how many jobs there are: give"),
        ("3", {}, "--part 3: give the number of the part and of all, such as 3/16"),
        ("3/0", {}, "--part 3/0: give the number"),
        ("-1/3", {}, "--part -1/3: give the number"),
        ("4/3", {}, "--part 4/3: parts are numbered 0 to 2, or from 1"),
    ]:
        with pytest.raises(ConfigError, match=message):
            parse_part(text, environment)
