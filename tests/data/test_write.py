"""Test the written data set: files, bytes, records, shards; with one process or several."""

import json
import shutil
import tarfile
from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import DatasetError, GlsimError, MeshError
from glsim.data.maps import open_maps
from glsim.data.progress import FrameProgress
from glsim.data.reader import open_dataset
from glsim.data.verification import verify
from tests.support.dataset_fakes import (
    CAMERA,
    FORMATS,
    SENSOR,
    Fault,
    contents,
    fake_frame,
    make,
    make_settings,
    make_tasks,
)


@pytest.fixture(scope="module", params=FORMATS)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    out = tmp_path_factory.mktemp("made") / "set"
    settings = make_settings(format=request.param)
    return out, settings, make(out, settings, skip_every=7)


def test_layout_of_a_png_tree_is_exact(tmp_path: Path) -> None:
    layers = ["clean", "noisy", "infrared", "reason"]
    make(tmp_path / "a", make_settings(layers=layers), make_tasks(3, 2))
    images = {
        f"{split}/{subject}/smile.1_{frame:05d}_{layer}.png"
        for split, subject in [("train", "s000"), ("test", "s001"), ("train", "s002")]
        for frame in range(2)
        for layer in layers
    }
    others = {"dataset.json", "manifest.jsonl", "skipped.jsonl"}
    others |= {"train/metadata.jsonl", "test/metadata.jsonl"}
    state = {".glsim/plan.json", ".glsim/complete.json"}
    state |= {f".glsim/chunks/{number:08d}.jsonl" for number in range(2)}
    assert set(contents(tmp_path / "a")) == images | others | state
    for layer in ("noisy", "infrared"):  # what is copied elsewhere still says what it is
        image = tmp_path / f"a/test/s001/smile.1_00001_{layer}.png"
        shutil.copy(image, tmp_path / f"{layer[0]}.png")
    said = open_maps(tmp_path / "n.png").sentence(camera=False, real=True)
    assert said.endswith("n.png: is simulated by kinect-v2, and no record of a camera")
    with pytest.raises(DatasetError, match=r"i\.png: is the layer infrared of a frame of glsim"):
        open_maps(tmp_path / "i.png")


def test_round_trip(made) -> None:
    out, _, summary = made
    tasks = {task.index: task for task in make_tasks()}
    pairs = list(open_dataset(out))
    assert len(pairs) == sum(summary.frames.values()) == 138
    for pair in pairs:
        task = tasks[pair.record["index"]]
        frame = fake_frame(task)
        assert (pair.record["split"], pair.key.subject) == (task.split, task.subject)
        assert (pair.key.sequence, pair.key.frame) == (task.key.sequence, task.key.frame)
        assert pair.intrinsics == CAMERA
        assert pair.clean_mm.dtype == np.float32
        np.testing.assert_array_equal(pair.clean_mm, frame.clean)
        np.testing.assert_array_equal(pair.noisy_mm, frame.noisy)


def test_records_hold_everything_drawn(made) -> None:
    out, _, _ = made
    record = json.loads((out / "manifest.jsonl").read_text().splitlines()[1])
    task = next(task for task in make_tasks() if task.index == record["index"])
    frame = fake_frame(task)
    names = ("frame", "sequence", "subject")
    assert record["seeds"] == {name: f"{getattr(task.seeds, name):016x}" for name in names}
    assert record["pose"] == {"yaw_deg": frame.pose["yaw_deg"], "distance_mm": 900.0}
    assert record["parameters"] == dict(frame.parameters)
    assert record["expression"] == {"smile": 0.5}
    assert (record["device"], record["source"], record["window"]) == (0, "fake", [4, 2, 20, 18])
    assert (record["notes"], record["depth_offset_mm"]) == ({"unit": "mm"}, 0.0)


def test_header(made) -> None:
    out, settings, summary = made
    header = json.loads((out / "dataset.json").read_text())
    assert header["frames"] == summary.frames == {"train": 69, "val": 35, "test": 34}
    assert header["skipped"] == 22
    assert header["subjects"]["val"] == ["s003", "s007"]
    assert header["settings"] == settings.model_dump(mode="json", exclude_none=True)
    assert (header["sensor"], header["renderer"]) == (SENSOR, "fake renderer")
    assert header["reasons"]["2"]["name"] == "shadow"
    subjects = [set(names) for names in header["subjects"].values()]
    assert not subjects[0] & subjects[1] | subjects[0] & subjects[2] | subjects[1] & subjects[2]


def test_skipped_frames_are_recorded_and_counted(made) -> None:
    out, _, summary = made
    lines = [json.loads(line) for line in (out / "skipped.jsonl").read_text().splitlines()]
    assert summary.skipped == {"no face: try --set source.unit=cm": 22}
    assert {line["index"] for line in lines} == {i for i in range(160) if i % 7 == 6}
    assert lines[0]["why"] == "no face: try --set source.unit=cm"
    assert {"subject", "sequence", "frame", "split"} <= lines[0].keys()
    assert not (out / "train" / "s000" / "smile.1_00006_clean.png").exists()


@pytest.mark.parametrize("format", FORMATS)
def test_a_frame_with_a_depth_beyond_16_bits_is_skipped(tmp_path: Path, format: str) -> None:
    tasks = make_tasks(4, 10)
    farthest_m = [fake_frame(task).noisy_m.max() for task in tasks]
    unit_mm = 1000 * float(np.median(farthest_m)) / 65535
    summary = make(tmp_path, make_settings(format=format, depth_unit_mm=unit_mm), tasks)
    lines = [json.loads(line) for line in (tmp_path / "skipped.jsonl").read_text().splitlines()]
    beyond = {n for n, far_m in enumerate(farthest_m) if round(1000 * far_m / unit_mm) > 65535}
    assert {line["index"] for line in lines} == beyond
    assert 0 < len(beyond) < len(tasks)
    assert "does not fit 16 bits" in lines[0]["why"]
    assert sum(summary.frames.values()) == len(tasks) - len(beyond)
    assert verify(tmp_path, deep=True) == []


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_strict_stops_at_the_first_skipped_frame(tmp_path: Path, workers: int) -> None:
    settings = make_settings().model_copy(update={"strict": True})
    with pytest.raises(MeshError, match=r"train/s00\d/smile\.1_\d+: no face"):
        make(tmp_path, settings, workers=workers, skip_every=7)
    make(tmp_path, make_settings(), skip_every=7)
    assert verify(tmp_path, deep=True) == []


@pytest.mark.parametrize("format", FORMATS)
def test_same_bytes_for_any_workers_and_any_order(tmp_path: Path, format: str) -> None:
    settings = make_settings(format=format)
    one = make(tmp_path / "one", settings, skip_every=7)
    seen: list[FrameProgress] = []
    slow = Fault("sleep", 3)  # the first chunk is the last to be complete
    two = make(
        tmp_path / "two", settings, workers=2, progress=seen.append, skip_every=7, faults=(slow,)
    )
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    done = [progress.done for progress in seen]
    assert done == sorted(done)
    assert seen[-1] == FrameProgress(160, 160, 22, 0, two.bytes)
    assert (one.rendered, one.bytes, one.frames) == (two.rendered, two.bytes, two.frames)


def test_errors_of_a_worker_reach_the_parent(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="the mesh has a hole"):
        make(tmp_path, workers=2, faults=(Fault("mesh", 40),))
    with pytest.raises(GlsimError, match="ZeroDivisionError in a worker: one by zero") as caught:
        make(tmp_path, workers=2, faults=(Fault("bug", 40),))
    assert "in fake_frames" in caught.value.__notes__[0]


def test_a_simulator_that_loses_a_frame_is_found_out(tmp_path: Path) -> None:
    with pytest.raises(GlsimError, match=r"gave no result for train/s000/smile\.1_00000"):
        make(tmp_path / "a", ahead=0)
    with pytest.raises(GlsimError, match=r"gave no result for test/s001/smile\.1_00003"):
        make(tmp_path / "b", faults=(Fault("lose", 23),))


def test_metadata_follows_the_rules_of_the_image_folder_loader(made) -> None:
    out, settings, summary = made
    if settings.output.format != "png":
        assert not list(out.rglob("metadata.jsonl"))
        return
    kinds = set()
    for split, count in summary.frames.items():
        text = (out / split / "metadata.jsonl").read_text()
        rows = [json.loads(line) for line in text.splitlines()]
        assert len(rows) == count
        for row in rows:
            assert (out / split / row["clean_file_name"]).is_file()
            assert (out / split / row["noisy_file_name"]).is_file()
            kinds.add(tuple((name, type(value)) for name, value in row.items()))
    assert len(kinds) == 1  # the same columns and types in every row of every split
    assert all(kind in (int, float, str) for _, kind in next(iter(kinds)))


def test_members_of_a_shard_have_fixed_attributes(tmp_path: Path) -> None:
    make(tmp_path, make_settings(format="webdataset"), make_tasks(1, 2))
    with tarfile.open(tmp_path / "train-000000.tar") as tar:
        members = tar.getmembers()
    keys = ["clean.png", "noisy.png", "json"]
    assert [m.name for m in members] == [f"{i:08d}.{key}" for i in range(2) for key in keys]
    assert {(m.mtime, m.uid, m.gid, m.uname, m.mode) for m in members} == {(0, 0, 0, "", 0o644)}


@pytest.mark.long
def test_long_splits_become_several_shards(tmp_path: Path) -> None:
    tasks = make_tasks(1, 1030)
    make(tmp_path, make_settings(format="webdataset"), tasks)
    names = [path.name for path in sorted(tmp_path.glob("train-*.tar"))]
    assert names == ["train-000000.tar", "train-000001.tar", "train-000002.tar"]
    split = open_dataset(tmp_path).split("train")
    assert [pair.record["index"] for pair in split] == list(range(1030))
    np.testing.assert_array_equal(split[1027].noisy_mm, fake_frame(tasks[1027]).noisy)
