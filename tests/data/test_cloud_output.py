"""Writing to object storage: whatever the store does, its bytes are those of a local run."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from glsim.cli.verify import repair_command
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files import cloud
from glsim.core.files.cloud import CloudStore, open_store
from glsim.data.chunks import Part
from glsim.data.dataset_run import DatasetRun, in_processes, run_part
from glsim.data.reader import open_dataset
from glsim.data.verification import verify
from tests.support.dataset_fakes import (
    SENSOR,
    Fault,
    contents,
    fake_frames,
    make,
    make_settings,
    make_tasks,
)
from tests.support.s3_server import BUCKET, Faults, S3Server, s3_server

SHARDS = make_settings(format="webdataset", frames_per_shard=8)
#: Two shards of the split train, one of each of the others.
TASKS = make_tasks(4, 5)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("expected") / "set"
    make(out, SHARDS, TASKS)
    return contents(out)


@pytest.fixture(scope="module")
def server() -> Iterator[S3Server]:
    with pytest.MonkeyPatch.context() as patch, s3_server(patch) as store:
        yield store


@pytest.fixture
def store(server: S3Server, here: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[S3Server]:
    monkeypatch.setattr(cloud, "FIRST_WAIT_S", 0.0)
    server.faults = Faults()
    server.requests.clear()
    yield server
    server.faults = Faults()


@pytest.fixture
def url(request: pytest.FixtureRequest) -> str:
    return f"s3://{BUCKET}/{abs(hash(request.node.name))}"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Caches and temporary folders in ``tmp_path``; nothing may be left of the latter."""
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    yield
    assert not list(tmp_path.glob("*glsim-*")), "a temporary folder is left"


@pytest.fixture
def memory(request: pytest.FixtureRequest) -> str:
    """A folder in fsspec's store in memory, which needs no server."""
    pytest.importorskip("fsspec")
    return f"memory://{BUCKET}/{abs(hash(request.node.name))}"


def stored(url: str) -> dict[str, bytes]:
    """Return name -> bytes of all objects of a data set."""
    from fsspec.core import url_to_fs

    fs, root = url_to_fs(url)
    fs.invalidate_cache()
    return {path.removeprefix(f"{root}/"): fs.cat_file(path) for path in fs.find(root)}


def test_the_objects_are_the_files_of_a_local_run(store: S3Server, url: str, expected) -> None:
    summary = make(url, SHARDS, TASKS)
    assert stored(url) == expected
    assert summary.rendered == 20
    assert len(open_dataset(url)) == 20
    store.requests.clear()
    again = make(url, SHARDS, TASKS)
    assert (again.rendered, again.reused) == (0, 20)
    assert not any(method == "PUT" and path.endswith(".tar") for method, path in store.requests)


@pytest.mark.long
def test_failing_and_throttled_requests_change_nothing(store: S3Server, url: str, expected) -> None:
    store.faults = Faults(throttled=0.2, failed_puts=0.2, lost_answers=0.2)
    make(url, SHARDS, TASKS, workers=2)
    assert {kind for kind, count in store.faults.counts.items() if count} == {
        "throttled", "failed_puts", "lost_answers",
    }  # fmt: skip
    store.faults = Faults()
    assert stored(url) == expected


def interrupt(url: str, index: int) -> None:
    with pytest.raises(ZeroDivisionError):
        make(url, SHARDS, TASKS, faults=(Fault("bug", index),))


def test_a_list_that_lags_costs_work_and_no_bytes(store: S3Server, url: str, expected) -> None:
    interrupt(url, 18)
    store.faults = Faults(hidden=("00000001.jsonl", "train-000000.tar"))
    summary = make(url, SHARDS, TASKS)
    assert store.faults.counts["hidden"] >= 2
    assert summary.reused == 8  # the first shard is asked for by its name
    store.faults = Faults()
    assert stored(url) == expected


@pytest.mark.parametrize(
    "damage",
    [
        {"train-000000.tar": b"short", "dataset.json": b"{}"},
        {"train-000000.tar": None, ".glsim/complete.json": b"nothing"},
        {"manifest.jsonl": None, "skipped.jsonl": b"more\n"},
    ],
    ids=str,
)
def test_a_damaged_data_set_is_repaired(here: None, memory: str, expected, damage) -> None:
    make(memory, SHARDS, TASKS)
    folder = CloudStore(memory)
    for name, data in damage.items():
        folder.delete([name]) if data is None else folder.put(name, data)
    make(memory, SHARDS, TASKS)
    assert stored(memory) == expected


def test_parts_are_merged_by_the_last_one(here: None, memory: str, expected) -> None:
    def part(number: int):
        run = DatasetRun(SHARDS, TASKS, open_store(memory), fake_frames, SENSOR, "fake renderer")
        return run_part(run, Part(number, 2), in_processes(1), None)

    first = part(1)
    assert first.dataset is None
    assert first.missing == "part 2 (or 0) of 2"
    assert part(0).dataset is not None
    assert stored(memory) == expected


def test_another_data_set_is_refused_and_the_same_resumed(
    here: None, memory: str, expected
) -> None:
    interrupt(memory, 18)
    assert "train-000000.tar" in stored(memory)
    with pytest.raises(DatasetError, match="is not complete"):
        open_dataset(memory)
    with pytest.raises(ConfigError, match=rf"{memory} was begun with seed"):
        make(memory, SHARDS.model_copy(update={"seed": 9}), TASKS)
    with pytest.raises(ConfigError, match="object storage takes shards"):
        make(memory, make_settings(format="png"), TASKS)
    assert make(memory, SHARDS, TASKS).reused == 10
    assert stored(memory) == expected
    CloudStore(f"{memory}-other").put("notes.txt", b"mine")
    with pytest.raises(DatasetError, match="holds no data set of glsim"):
        make(f"{memory}-other", SHARDS, TASKS)


def test_a_bucket_that_is_not_there_is_named(store: S3Server) -> None:
    with pytest.raises(DatasetError, match=r"s3://nobody/set.*no such bucket"):
        make("s3://nobody/set", SHARDS, TASKS)


def test_two_runs_at_once_write_the_same_bytes(store: S3Server, url: str, expected) -> None:
    threads = [threading.Thread(target=make, args=(url, SHARDS, TASKS)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert stored(url) == expected


def test_verify_finds_what_is_wrong_in_a_bucket(here: None, memory: str) -> None:
    make(memory, SHARDS, TASKS)
    folder = CloudStore(memory)
    assert verify(memory) == verify(memory, deep=True) == []
    good = folder.read("train-000001.tar", 1 << 30)
    folder.put("train-000001.tar", good[:-600] + b"x" + good[-599:])
    folder.put("train-000007.tar", b"")
    folder.delete(["test-000000.tar", "skipped.jsonl"])
    assert repair_command(Path(memory)).startswith(f"glsim generate -o {memory} --set ")
    assert verify(memory) == [
        "skipped.jsonl is missing",
        "test-000000.tar is missing",
        "train-000001.tar is not what was written: its CRC32 differs",
        "train-000007.tar is in no record: delete it, or move it out",
    ]
    assert "it has no dataset.json" in verify(f"{memory}-none")[0]
