"""Reading a data set from object storage: what is on disk is what is read."""

import os
import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files import cloud
from glsim.core.files.cloud import CloudStore, cloud_url
from glsim.data.reader import open_dataset
from glsim.data.verification import verify
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.s3_server import BUCKET, Faults, S3Server, s3_server

URL = f"s3://{BUCKET}/a/set"


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("local")
    layers = ["clean", "noisy", "infrared"]
    make(out, make_settings(format="webdataset", layers=layers), make_tasks(4, 5))
    return out


@pytest.fixture(scope="module")
def served(local: Path) -> Iterator[S3Server]:
    with pytest.MonkeyPatch.context() as patch, s3_server(patch) as store:
        folder = CloudStore(URL)
        for file in (path for path in local.rglob("*") if path.is_file() and path.name != "lock"):
            folder.put(file.relative_to(local).as_posix(), file.read_bytes())
        yield store


@pytest.fixture
def store(served: S3Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[S3Server]:
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cloud, "FIRST_WAIT_S", 0.0)
    yield served
    served.faults = Faults()
    served.requests.clear()


def same(found, expected) -> None:
    assert [pair.record for pair in found] == [pair.record for pair in expected]
    for pair, other in zip(found, expected, strict=True):
        for name in other:
            np.testing.assert_array_equal(pair[name], other[name])


def test_pairs_are_those_of_the_disk(store: S3Server, local: Path) -> None:
    dataset, expected = open_dataset(URL), open_dataset(local)
    same(dataset, expected)
    same(dataset.split("test"), expected.split("test"))
    assert str(dataset) == URL
    same(pickle.loads(pickle.dumps(dataset)), expected)
    same(open_dataset(Path(URL)), expected)  # pathlib joins the slashes


def test_a_frame_takes_one_request_and_the_manifest_is_copied_once(store: S3Server) -> None:
    dataset = open_dataset(URL)
    store.requests.clear()
    pair = dataset.frames()[3]
    assert pair.noisy_mm.any()
    assert pair.clean_mm.any()
    assert [method for method, _ in store.requests] == ["GET"]
    store.requests.clear()
    for pair in dataset:  # in order: blocks of many frames
        assert pair.noisy_mm.any()
    assert len(store.requests) <= 3 + 2 * 3  # three frames, then a HEAD and a GET for each shard
    before = len(store.requests)
    assert verify(URL, deep=True) == []
    assert [kind for kind, _ in store.requests[before:]].count("GET") < len(dataset)
    store.requests.clear()
    open_dataset(URL)
    assert not [path for method, path in store.requests if "manifest" in path]


def test_a_throttled_store_is_asked_again(store: S3Server, local: Path) -> None:
    store.faults = Faults(throttled=0.3)
    same(open_dataset(URL), open_dataset(local))
    assert store.faults.counts["throttled"] >= 3


def test_a_process_that_was_forked_reads_on_its_own(store: S3Server) -> None:
    dataset = open_dataset(URL)
    assert dataset.frames()[0].noisy_mm.any()
    child = os.fork()
    if child == 0:
        os._exit(0 if dataset.frames()[1].noisy_mm.any() else 1)
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("train-000000.tar", lambda data: data[:600] + b"x" + data[601:], "was changed"),
        ("train-000000.tar", lambda data: data[:700], "was changed"),
        ("manifest.jsonl", lambda data: data.replace(b"s000", b"s009", 1), "was changed"),
        ("dataset.json", lambda data: data.replace(b'"seed": 0', b'"seed": 1'), "was changed"),
    ],
)
def test_a_changed_object_is_noticed(
    store: S3Server, local: Path, name: str, change, message: str
) -> None:
    folder, data = CloudStore(URL), (local / name).read_bytes()
    assert change(data) != data
    folder.put(name, change(data))
    try:
        with pytest.raises(DatasetError, match=message):
            _ = open_dataset(URL).frames()[0].clean_mm
    finally:
        folder.put(name, data)
    assert open_dataset(URL).frames()[0].clean_mm.any()


def test_what_is_not_there_is_said_in_one_line(store: S3Server, local: Path) -> None:
    with pytest.raises(DatasetError, match=r"no data set of glsim: it has no dataset\.json"):
        open_dataset(f"s3://{BUCKET}/nothing")
    with pytest.raises(DatasetError, match=r"s3://nobody/set: is no data set"):
        open_dataset("s3://nobody/set")
    dataset, folder = open_dataset(URL), CloudStore(URL)
    folder.delete(["test-000000.tar"])
    try:
        with pytest.raises(DatasetError, match=r"test-000000\.tar: is missing"):
            _ = dataset.split("test")[0].noisy_mm
    finally:
        folder.put("test-000000.tar", (local / "test-000000.tar").read_bytes())


@pytest.mark.parametrize(
    ("faults", "refused"),
    [(Faults(throttled=1.0), "(slow down|Service Unavail)"), (Faults(silent_s=0.4), "no answer")],
)
def test_a_store_that_stays_away_is_an_error(
    store: S3Server, monkeypatch: pytest.MonkeyPatch, caplog, faults: Faults, refused: str
) -> None:
    monkeypatch.setattr(cloud, "GIVE_UP_S", 0.0)
    monkeypatch.setattr(cloud, "_ANSWER_S", 0.2 if faults.silent_s else 20.0)
    monkeypatch.setattr(CloudStore, "_warned_s", float("-inf"))
    store.faults = faults
    store.requests.clear()
    with pytest.raises(DatasetError, match=rf"{refused}.*run the same command again"):
        open_dataset(URL)
    assert len(store.requests) == 3  # one layer repeats requests
    assert "trying again for 0 s" in caplog.text


def test_urls_of_other_kinds_make_no_folders(tmp_path: Path) -> None:
    assert {cloud_url(path) for path in ("data", "/data", "s3", "c:/data", "a/s3://b")} == {None}
    for url in ("s3://", "file:///data", "http:/host"):
        with pytest.raises(ConfigError, match="is no URL that glsim reads or writes"):
            cloud_url(url)
    (tmp_path / "file:").mkdir()
    assert cloud_url(tmp_path / "file:") is None


def test_a_scheme_without_its_package_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fsspec")
    monkeypatch.setitem(__import__("sys").modules, "gcsfs", None)
    with pytest.raises(ConfigError, match="needs the package gcsfs"):
        open_dataset("gs://bucket/set")
