"""Test data sets made in parts: any order, kills, two at once; the bytes are those of one run."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.cloud import open_store
from glsim.core.files.lock import locked
from glsim.data.chunks import Part, parse_part
from glsim.data.dataset_run import DatasetRun, in_processes, run_part
from glsim.data.progress import PartSummary
from glsim.data.run_identity import InputHashes
from glsim.data.verification import verify
from tests.support.dataset_fakes import (
    SENSOR,
    SKIP,
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
    **faults: Any,
) -> PartSummary:
    run = DatasetRun(
        make_settings(format=format), make_tasks() if tasks is None else tasks, open_store(out),
        partial(fake_frames, **(SKIP | faults)), SENSOR, renderer, inputs=inputs,
    )  # fmt: skip
    return run_part(run, parse_part(part), in_processes(workers), progress)


@pytest.mark.parametrize(("format", "order"), [("png", "120"), ("webdataset", "210")])
def test_parts_in_any_order_give_the_bytes_of_one_run(
    tmp_path: Path, undisturbed, format: str, order: str
) -> None:
    for done, number in enumerate(order[:-1], start=1):
        summary = make_part(tmp_path, f"{number}/3", format)
        left = ", ".join(sorted(order[done:].replace("0", "3"))).replace("3", "3 (or 0)")
        assert (summary.dataset, summary.missing) == (None, f"part{'s'[done - 1 :]} {left} of 3")
        assert f"(missing: {summary.missing}): run glsim generate again" in verify(tmp_path)[0]
    last = make_part(tmp_path, f"{order[-1]}/3", format, workers=2)
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
    assert parts[1].dataset.skipped == {"no face: try --set source.unit=cm": 22}


SCRIPT = """
import signal, sys
from pathlib import Path
from tests.data.test_parts import make_part
make_part(Path(sys.argv[1]), sys.argv[2], sys.argv[3], workers=int(sys.argv[4]), delay_s=0.01,
     progress=lambda s: (print(s.done, flush=True), s.done < int(sys.argv[5]) or signal.pause()))
"""


def start_part(
    out: Path, part: str, format: str, workers: int = 1, wait_at: int = 1000
) -> subprocess.Popen[str]:
    """Start a process that makes a part; after ``wait_at`` frames it waits for a signal."""
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(out), part, format, str(workers), str(wait_at)],
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
    process = start_part(tmp_path, "0/2", format, workers, wait_at=5)
    while int(process.stdout.readline()) < 5:
        pass
    with pytest.raises(DatasetError, match="part 0/2 is being made by another process: wait"):
        make_part(tmp_path, "0/2", format)
    with pytest.raises(DatasetError, match="another run is writing here"):
        make(tmp_path, make_settings(format=format), **SKIP)
    other = make_part(tmp_path, "1/2", format)
    assert other.dataset is None
    process.kill()
    process.communicate()
    summary = make_part(tmp_path, "2/2", format)
    assert summary.dataset is not None
    assert contents(tmp_path) == undisturbed[format]


@pytest.mark.long
def test_parts_that_run_at_the_same_time_merge_once(tmp_path: Path, undisturbed) -> None:
    processes = [start_part(tmp_path, f"{number}/3", "png") for number in range(3)]
    assert not any(process.communicate() and process.returncode for process in processes)
    assert contents(tmp_path) == undisturbed["png"]


def test_a_part_waits_for_a_merge_and_more_parts_than_chunks_are_sound(
    tmp_path: Path, undisturbed, caplog: pytest.LogCaptureFixture
) -> None:
    make(tmp_path / "a", **SKIP)
    parts = 1 + len(list((tmp_path / "a/.glsim/chunks").iterdir()))
    with ThreadPoolExecutor() as pool:
        with locked(tmp_path / "a/.glsim/lock", DatasetError()):
            idle = pool.submit(make_part, tmp_path / "a", f"{parts - 1}/{parts}")
            while "waiting until it ends" not in caplog.text:
                assert not idle.done()
        assert idle.result().dataset is not None
    assert contents(tmp_path / "a") == undisturbed["png"]


def test_one_run_completes_parts_and_any_part_merges(
    tmp_path: Path, undisturbed, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_part(tmp_path / "a", "0/3")
    assert make(tmp_path / "a", **SKIP).reused > 0
    assert make_part(tmp_path / "a", "1/3").rendered == 0
    assert contents(tmp_path / "a") == undisturbed["png"]
    # Both parts are complete, and the last process was killed just before it merged.
    assert make_part(tmp_path / "b", "0/2").dataset is None
    with monkeypatch.context() as patch:
        patch.delattr("glsim.data.dataset_run.finish")
        with pytest.raises(NameError):
            make_part(tmp_path / "b", "1/2")
    assert make_part(tmp_path / "b", "0/2").rendered == 0
    assert contents(tmp_path / "b") == undisturbed["png"]


def test_parts_of_other_settings_or_machines_are_refused(tmp_path: Path) -> None:
    make_part(tmp_path / "a", "0/3")
    with pytest.raises(ConfigError, match="planned_frames = 160, not 140"):
        make_part(tmp_path / "a", "1/3", tasks=make_tasks(7))
    with pytest.raises(ConfigError, match='renderer = "fake renderer", not "another"'):
        make_part(tmp_path / "a", "1/3", renderer="another")
    other = partial(InputHashes, {}, {}, "another")
    make_part(tmp_path / "b", "0/3", inputs=partial(InputHashes, {}, {}, "first"))
    with pytest.raises(ConfigError, match="whose last bits differ from this machine's"):
        make_part(tmp_path / "b", "1/3", inputs=other)


def test_parts_are_named_by_both_ways_of_counting() -> None:
    assert [Part(n, 3).chunks(8) for n in (0, 1, 2, 3)] == [
        range(0, 8, 3), range(1, 8, 3), range(2, 8, 3), range(0, 8, 3)
    ]  # fmt: skip
    assert Part(3, 3).name == Part(0, 3).name == "0-of-3"
    assert parse_part("3/16") == Part(3, 16)
    for text in ("3", "3/0", "-1/3", "4/3", "a/3", "auto"):
        with pytest.raises(ConfigError, match=f"--part {text}: "):
            parse_part(text)
