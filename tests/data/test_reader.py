"""Test the reader and the problems that verify reports."""

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import DatasetError
from glsim.core.files.png import encode_png
from glsim.data.dataset_run import write_dataset
from glsim.data.reader import Dataset, open_dataset
from glsim.data.verification import LOST, STRAY, verify
from tests.support.dataset_fakes import (
    FORMATS,
    contents,
    fake_frame,
    make,
    make_settings,
    make_tasks,
    sign,
)

PNG = "test/s001/smile.1_00003_noisy.png"


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("originals")
    for format in FORMATS:
        make(root / format, make_settings(format=format), skip_every=7)
    return {format: root / format for format in FORMATS}


@pytest.fixture
def tree(originals: dict[str, Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(originals["png"], tmp_path / "png"))


@pytest.fixture
def shards(originals: dict[str, Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(originals["webdataset"], tmp_path / "webdataset"))


def pair_of(path: Path, subject: str = "s001", frame: int = 3):
    return next(p for p in Dataset(path) if (p.key.subject, p.key.frame) == (subject, frame))


@pytest.mark.parametrize("format", FORMATS)
def test_splits_are_sequences(originals: dict[str, Path], format: str) -> None:
    dataset = open_dataset(originals[format])
    assert [len(dataset.split(name)) for name in ("train", "val", "test")] == [69, 35, 34]
    assert len(dataset) == 138
    for name in ("train", "val", "test"):
        split = dataset.split(name)
        indices = [pair.record["index"] for pair in split]
        assert {pair.record["split"] for pair in split} == {name}
        assert indices == sorted(indices)
        assert split[-1].record["index"] == indices[-1]
        assert [pair.record["index"] for pair in split[2:9:3]] == indices[2:9:3]
        with pytest.raises(IndexError):
            split[len(split)]
    with pytest.raises(DatasetError, match="no such split 'tests': did you mean 'test'"):
        dataset.split("tests")
    travelled = pickle.loads(pickle.dumps(dataset.split("val")))
    assert travelled[4].clean_mm.shape == (24, 32)


def test_depth_unit_and_offset_are_honoured(tmp_path: Path) -> None:
    tasks = make_tasks(1, 3)

    def shifted(settings, tasks):
        for task in tasks:
            yield fake_frame(task, 0.25, offset_mm=100.0 * task.index)

    settings = make_settings(depth_unit_mm=0.25)
    write_dataset(settings, tasks, tmp_path, shifted, sensor={}, renderer="", workers=1)
    for pair, task in zip(open_dataset(tmp_path).split("train"), tasks, strict=True):
        units = fake_frame(task, 0.25).noisy
        expected = np.where(units > 0, units * 0.25 + 100.0 * task.index, 0)
        np.testing.assert_array_equal(pair.noisy_mm, expected.astype(np.float32))
        assert pair.offset_mm == 0  # its depths are as measured


def test_a_data_set_of_skipped_frames_only(tmp_path: Path) -> None:
    for format in FORMATS:
        make(tmp_path / format, make_settings(format=format), make_tasks(2, 2), skip_every=1)
        dataset = open_dataset(tmp_path / format)
        assert list(dataset) == list(dataset.split("val")) == []
        assert verify(tmp_path / format, deep=True) == []


def test_bad_headers(tmp_path: Path, tree: Path) -> None:
    with pytest.raises(DatasetError, match=r"is no data set of glsim: it has no dataset\.json"):
        open_dataset(tmp_path)
    header = json.loads((tree / "dataset.json").read_text())
    for changes, message in (
        ({"format_version": 99}, r"format version 99 is newer than 1.*update glsim"),
        ({"format": "coco"}, "is not the header of a glsim data set"),
        ({"frames": 3}, "is damaged: frames: "),
    ):
        (tree / "dataset.json").write_text(json.dumps(header | changes))
        with pytest.raises(DatasetError, match=message):
            open_dataset(tree)
    (tree / "dataset.json").unlink()
    with pytest.raises(DatasetError, match="is not complete: run glsim generate again"):
        open_dataset(tree)


def test_bad_manifests(tree: Path) -> None:
    manifest = tree / "manifest.jsonl"
    manifest.write_text(manifest.read_text() + "{}\n")
    sign(tree)
    with pytest.raises(DatasetError, match=r"has 139 lines, dataset\.json says 138"):
        open_dataset(tree)
    manifest.unlink()
    with pytest.raises(DatasetError, match=r"manifest\.jsonl: is missing"):
        open_dataset(tree)


def test_bad_images(tree: Path, shards: Path) -> None:
    (tree / PNG).write_bytes(encode_png(np.zeros((24, 32), np.uint16)))
    with pytest.raises(DatasetError, match="was changed after it was written"):
        _ = pair_of(tree).noisy_mm
    (tree / PNG).unlink()
    with pytest.raises(DatasetError, match=rf"{PNG}: is missing: run glsim generate again"):
        _ = pair_of(tree).noisy_mm
    assert pair_of(tree).clean_mm.any()
    manifest = tree / "manifest.jsonl"
    manifest.write_text(manifest.read_text().replace('"width":32', '"width":33'))
    sign(tree)
    with pytest.raises(DatasetError, match="is 32 x 24 pixels, the record says 33 x 24"):
        _ = pair_of(tree, frame=4).noisy_mm
    shard = shards / "test-000000.tar"
    shard.write_bytes(shard.read_bytes()[:5000])
    with pytest.raises(DatasetError, match=r"test-000000\.tar \(000000..\.noisy\.png\): was ch"):
        _ = pair_of(shards, frame=19).noisy_mm


def flip(path: Path, position: int = -30) -> None:
    data = bytearray(path.read_bytes())
    data[position] ^= 1
    path.write_bytes(data)


def test_verify_lets_sound_data_sets_and_the_users_own_files_be(
    originals: dict[str, Path], tree: Path
) -> None:
    for path in originals.values():
        before = contents(path)
        assert verify(path) == verify(path, deep=True) == []
        assert contents(path) == before
    (tree / "notes.md").write_text("mine")
    (tree / "figures").mkdir()
    assert verify(tree, deep=True) == []


def test_verify_finds_missing_changed_and_stray_files(tree: Path) -> None:
    (tree / PNG).unlink()
    assert verify(tree) == [f"{PNG} is missing"]
    (tree / PNG).write_bytes(b"x")
    assert "has 1 bytes instead of" in verify(tree)[0]
    shutil.rmtree(tree / "test" / "s001")
    assert len(verify(tree)) == 34
    (tree / "val" / "s003" / "extra.png").touch()
    (tree / "val" / "s999").mkdir()
    (tree / "val" / "notes.txt").touch()
    problems = verify(tree)
    found = [problem for problem in problems if "is missing" not in problem]
    assert found == [f"val/{name} {STRAY}" for name in ("s003/extra.png", "notes.txt", "s999")]
    manifest = tree / "manifest.jsonl"
    manifest.write_text("".join(manifest.read_text().splitlines(keepends=True)[1:]))
    kept = [problem for problem in verify(tree) if problem.endswith(LOST)]
    assert f"train/s000/smile.1_00000_clean.png {LOST}" in kept, "its record is lost, not it"
    assert not any(problem.endswith(STRAY) for problem in verify(tree))


def test_verify_finds_changed_bytes_if_deep(tree: Path, shards: Path) -> None:
    flip(tree / PNG)
    flip(shards / "val-000000.tar", 5000)
    assert verify(tree) == verify(shards) == []
    (problem,) = verify(tree, deep=True)
    assert problem.startswith(f"{PNG}: was changed after it was written")
    assert verify(shards, deep=True) == [
        "val-000000.tar is not what was written: its CRC32 differs"
    ]


def test_verify_finds_images_in_two_records_and_records_of_other_bytes(shards: Path) -> None:
    manifest = shards / "manifest.jsonl"
    first, second, *rest = manifest.read_text().splitlines()
    record, other = json.loads(first), json.loads(second)
    other["files"]["noisy"] = record["files"]["noisy"]
    record["files"]["clean"]["crc32"] ^= 1
    manifest.write_text("\n".join([json.dumps(record), json.dumps(other), *rest]) + "\n")
    sign(shards)
    assert "train-000000.tar is in two records" in verify(shards)
    assert any("clean.png): was changed after" in line for line in verify(shards, deep=True))


def test_verify_finds_subjects_in_two_splits(tree: Path) -> None:
    shutil.copytree(tree / "train" / "s000", tree / "test" / "s000")
    assert "subject s000 has a folder in train and in test" in verify(tree)
    manifest = tree / "manifest.jsonl"
    manifest.write_text(
        manifest.read_text().replace('"test","subject":"s001"', '"test","subject":"s000"')
    )
    problems = verify(tree)
    assert "subject s000 is in train and in test" in problems
    assert "manifest.jsonl is not what was written: its CRC32 differs" in problems


def test_verify_finds_wrong_counts_and_strange_shards(tree: Path, shards: Path) -> None:
    sign(tree, frames={"train": 70, "val": 34, "test": 34})
    assert verify(tree) == [
        "train has 69 frames, the header says 70",
        "val has 35 frames, the header says 34",
    ]
    (shards / "train-000007.tar").touch()
    (shards / "val-000000.tar").unlink()
    assert verify(shards) == ["val-000000.tar is missing", f"train-000007.tar {STRAY}"]
