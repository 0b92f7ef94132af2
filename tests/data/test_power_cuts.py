"""Test that what a data set calls complete is on the disk, whenever the power fails."""

import json
import os
import shutil
from pathlib import Path

import pytest

from glsim.core.errors import DatasetError
from glsim.core.files import flush
from glsim.core.files.atomic import file_checksum
from glsim.core.files.store import Store
from glsim.data import chunks
from glsim.data.disk_format import HEADER, MANIFEST
from glsim.data.records import parse_chunk_record
from tests.support.dataset_fakes import contents, make, make_settings, make_tasks
from tests.support.power_cuts import PowerCuts

TASKS = make_tasks(4, 3)


@pytest.fixture(autouse=True)
def small_chunks_and_no_real_flushes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    monkeypatch.setattr(flush, "_syncfs", lambda: lambda descriptor: 0)
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "png", 2)
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "webdataset", 2)


def lies(state: Path) -> list[str]:
    """List what header, manifest and chunk records of a folder call complete, and is not."""
    found = []
    records = []
    if (state / HEADER).is_file() and (data := (state / HEADER).read_bytes()):
        header = json.loads(data)
        found += [n for n, file in header["files"].items() if file_checksum(state / n) != file]
        lines = (state / MANIFEST).read_text().splitlines() if not found else []
        records += [json.loads(line) for line in lines]
        if len(lines) != sum(header["frames"].values()):
            found.append(f"{len(lines)} records")
    for path in state.glob(".glsim/chunks/*.jsonl"):
        try:
            chunk = parse_chunk_record(path.read_bytes())
        except DatasetError:
            continue  # seen by a run, which makes the chunk again
        records += [json.loads(line) for line in chunk.frames]
        shard = chunk.summary.shard
        if (
            shard is not None
            and (file_checksum(state / shard["name"]) or {})["crc32"] != (shard["crc32"])
        ):
            found.append(shard["name"])
    for record in records:
        for file in record["files"].values():
            size = (file_checksum(state / file["name"]) or {"size": 0})["size"]
            if ("offset" not in file and size != file["size"]) or not size:
                found.append(file["name"])
    return found


def cut_everywhere(
    monkeypatch: pytest.MonkeyPatch, folder: Path, format: str = "png", *, resumes: int = 0
) -> list[str]:
    """Cut the power at every step of a run; return the lies. Resumes some of the states."""
    found: list[str] = []
    states: list[Path] = []

    def cut(disk: PowerCuts, step: int) -> None:
        state = folder / f"state-{step}"
        disk.write_state(state, names=step % 2 == 0)  # the two kinds of cut in turn
        found.extend(f"step {step}: {lie}" for lie in lies(state))
        states.append(state)

    (folder / "kept").mkdir(parents=True)
    with monkeypatch.context() as patch:
        PowerCuts(patch, folder / "out", folder / "kept", cut)
        make(folder / "out", make_settings(format=format), TASKS, skip_every=5)
    assert len(states) > 50
    expected = contents(folder / "out")
    for state in states[:: max(1, len(states) // resumes)] if resumes else []:
        make(state, make_settings(format=format), TASKS, skip_every=5)
        assert contents(state) == expected, state.name
    shutil.rmtree(folder)
    return found


@pytest.mark.parametrize("format", ["png", pytest.param("webdataset", marks=pytest.mark.long)])
def test_what_is_called_complete_is_on_the_disk_at_every_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    assert cut_everywhere(monkeypatch, tmp_path / "a", format, resumes=20) == []


@pytest.mark.long
def test_a_repair_is_not_called_complete_either(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path / "out", make_settings(), TASKS)
    next((tmp_path / "out").rglob("*_noisy.png")).unlink()
    found: list[str] = []
    with_header: list[bool] = []

    def cut(disk: PowerCuts, step: int) -> None:
        state = tmp_path / str(step)
        disk.write_state(state, names=True)
        with_header.append((state / HEADER).exists())
        if with_header[-1] and not all(with_header):  # the damage itself is no lie of the run
            found.extend(lies(state))

    (tmp_path / "kept").mkdir()
    disk = PowerCuts(monkeypatch, tmp_path / "out", tmp_path / "kept", cut)
    disk._flush_all(0)
    make(tmp_path / "out", make_settings(), TASKS)
    assert with_header[0]
    assert with_header[-1]
    assert not all(with_header)
    assert found == []


def test_the_cuts_find_a_header_before_its_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Store, "flush", lambda self: None)
    found = cut_everywhere(monkeypatch, tmp_path / "a")
    assert any("_clean.png" in lie for lie in found)
