"""Data sets whose records lie: nothing outside is read, nothing ends in a traceback."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.dataset import open_dataset, verify
from glsim.dataset.records import parse_chunk_record, parse_first_line
from glsim.errors import DatasetError
from glsim.files.png import encode_png
from tests.support.dataset_fakes import make, make_settings, make_tasks, sign

PNG = "train/s000/smile.1_00000_noisy.png"


SHARD = "train-000000.tar"


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sound sets, and beside each the files that no reader may read."""
    root = tmp_path_factory.mktemp("originals")
    for format in ("png", "webdataset"):
        make(root / format / "set", make_settings(format=format), make_tasks(4, 3))
        (root / format / "outside").mkdir()
        source = root / format / "set" / (PNG if format == "png" else SHARD)
        shutil.copyfile(source, root / format / "outside" / "map.png")
    return root


@pytest.fixture
def tree(originals: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(originals / "png" / "set", tmp_path / "png"))


@pytest.fixture
def shards(originals: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(originals / "webdataset" / "set", tmp_path / "webdataset"))


def edit(root: Path, change: Callable[[dict[str, Any]], object], line: int = 0) -> None:
    """Change a record of the manifest and record the checksums again."""
    path = root / "manifest.jsonl"
    lines = path.read_text().splitlines()
    record = json.loads(lines[line])
    change(record)
    lines[line] = json.dumps(record)
    path.write_text("\n".join(lines) + "\n")
    sign(root)


def problem_of(root: Path) -> str:
    """Read everything; return the one-line problem, "" if there is none."""
    problem = ""
    try:
        for pair in open_dataset(root):
            _ = pair.clean_mm, pair.noisy_mm, pair.intrinsics, repr(pair)
    except DatasetError as error:
        problem = str(error)
    assert "\n" not in problem
    assert len(problem) < 600
    return problem


def name(name: str) -> Callable[[Path], None]:
    """Put a name of a file into the first record."""
    return lambda root: edit(root, lambda record: record["files"]["noisy"].update(name=name))


def put(file: str, make_it: Callable[[Path], object]) -> Callable[[Path], None]:
    """Put something else in the place of a file or folder."""

    def change(root: Path) -> None:
        (root / file).rename(root / "moved")
        make_it(root / file)

    return change


def first_line(line: str) -> Callable[[Path], None]:
    """Replace the first record."""

    def change(root: Path) -> None:
        path = root / "manifest.jsonl"
        path.write_text(line + "\n" + path.read_text().partition("\n")[2])
        sign(root)

    return change


@pytest.mark.parametrize(
    ("format", "change", "opened"),
    [
        ("png", name("../outside/map.png"), "line 1 is damaged: files.noisy.name"),
        ("png", name("/dev/zero"), "line 1 is damaged: files.noisy.name"),
        ("png", name("train/a\0b.png"), "line 1 is damaged: files.noisy.name"),
        ("png", put(PNG, lambda p: p.symlink_to("../../../outside/map.png")), "leads out of"),
        ("png", put(PNG, os.mkfifo), "is a pipe"),
        ("png", put(PNG, Path.mkdir), "Is a directory"),
        ("png", put("manifest.jsonl", os.mkfifo), "is a pipe"),
        ("png", first_line("[" * 500_000), "line 1 is damaged"),
        ("png", first_line("x" * 10**7), "it has more than 131072 bytes"),
        ("webdataset", put(SHARD, lambda p: p.symlink_to("../outside/map.png")), "leads out of"),
    ],
)
def test_a_hostile_set_is_refused(
    originals: Path, tmp_path: Path, format: str, change: Callable[[Path], None], opened: str
) -> None:
    shutil.copytree(originals / format, tmp_path / "box")
    root = tmp_path / "box" / "set"
    change(root)
    assert opened in problem_of(root)
    assert verify(root, deep=True)


def test_an_offset_behind_the_end_of_a_shard_is_refused(shards: Path) -> None:
    assert verify(shards, deep=True) == []
    edit(shards, lambda record: record["files"]["noisy"].update(offset=10**9))
    assert "is no readable PNG image" in problem_of(shards)
    assert any("lies behind the shard's end" in p for p in verify(shards))


def _checksum(path: Path) -> dict[str, int]:
    from glsim.files.atomic import file_checksum

    found = file_checksum(path)
    assert found is not None
    return found


def test_a_changed_manifest_is_refused(tree: Path) -> None:
    """Version 0.1 used a changed focal length, subject or offset without a word."""
    manifest = tree / "manifest.jsonl"
    whole = manifest.read_text()
    for before, after in (
        ('"fx":40.0', '"fx":41.0'),
        ('"subject":"s000"', '"subject":"s009"'),
        ('"depth_offset_mm":0.0', '"depth_offset_mm":7.0'),
    ):
        manifest.write_text(whole.replace(before, after, 1))
        assert "manifest.jsonl: was changed after it was written" in problem_of(tree)
    lines = whole.splitlines(keepends=True)
    manifest.write_text("".join([lines[-1], *lines[1:-1], lines[0]]))  # a test frame into train
    assert "was changed" in problem_of(tree)
    sign(tree)
    assert "split: is test, dataset.json counts this frame to train" in problem_of(tree)


def test_a_changed_header_is_refused(tree: Path) -> None:
    """Shifted counts made frames for validation frames for training; half the depth was halved."""
    file = tree / "dataset.json"
    header = json.loads(file.read_text())
    file.write_text(json.dumps(header | {"depth_unit_mm": 0.5}))
    assert "dataset.json: was changed after it was written" in problem_of(tree)
    assert "dataset.json was changed" in verify(tree)[0]
    shutil.rmtree(tree / ".glsim")  # a copy without it: counts are compared with the records
    file.write_text(json.dumps(header | {"frames": {"train": 7, "val": 2, "test": 3}}))
    assert "split: is val" in problem_of(tree)
    assert verify(tree)[-2:] == [
        "train has 6 frames, the header says 7",
        "val has 3 frames, the header says 2",
    ]


def test_a_data_set_without_a_checksum_opens_with_a_warning(
    tree: Path, caplog: pytest.LogCaptureFixture
) -> None:
    header = json.loads((tree / "dataset.json").read_text())
    sign(tree, files={})
    assert "manifest.jsonl" in header["files"]
    assert problem_of(tree) == ""
    assert "has no checksum in dataset.json" in caplog.text


@pytest.mark.parametrize("unit", ["0", "NaN", "-1", "1e9", "null", "true", '"1"'])
def test_the_depth_unit_is_a_number_from_a_hundredth_to_ten(tree: Path, unit: str) -> None:
    file = tree / "dataset.json"
    file.write_text(file.read_text().replace('"depth_unit_mm": 1.0', f'"depth_unit_mm": {unit}'))
    assert "dataset.json: is damaged:" in problem_of(tree)
    assert "depth_unit_mm" in verify(tree)[0]


VALUES: list[Any] = [None, True, -1, 0, 1.5, 10**400, float("nan"), "x", "", [], {}, [[[]]]]


@pytest.mark.long
def test_changed_values_of_records_and_header_are_one_line(tree: Path) -> None:
    """Each value of a record and of the header in turn becomes a value of another kind."""
    rng = np.random.default_rng(1)
    whole = (tree / "manifest.jsonl").read_text()
    first, _, rest = whole.partition("\n")
    places = [*_places(json.loads(first))]
    for place in places:
        record = json.loads(first)
        _put(record, place, VALUES[int(rng.integers(len(VALUES)))])
        (tree / "manifest.jsonl").write_text(json.dumps(record) + "\n" + rest)
        sign(tree)
        problem_of(tree)
        for line in verify(tree, deep=True):
            assert "\n" not in line
    (tree / "manifest.jsonl").write_text(whole)
    sign(tree)
    header = json.loads((tree / "dataset.json").read_text())
    for place in _places(header):
        if place[0] in ("units", "reasons"):
            continue
        changed = json.loads(json.dumps(header))
        _put(changed, place, VALUES[int(rng.integers(len(VALUES)))])
        (tree / "dataset.json").write_text(json.dumps(changed))
        problem_of(tree)
        verify(tree)


def _places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of each value below a tree of JSON."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    found = []
    for key, value in items:
        found.append((*path, key))
        if isinstance(value, dict | list):
            found += _places(value, (*path, key))
    return found


def _put(tree: Any, path: tuple[Any, ...], value: Any) -> None:
    for key in path[:-1]:
        tree = tree[key]
    if value == "x" and isinstance(tree, dict):
        del tree[path[-1]]
    else:
        tree[path[-1]] = value


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "9" * 5000, "{" * 10, "\0"])
def test_nesting_and_long_numbers_of_chunk_records_are_one_line(text: str) -> None:
    with pytest.raises(DatasetError, match="damaged"):
        parse_first_line("00000000 " + text)
    with pytest.raises(DatasetError, match="damaged"):
        parse_chunk_record(text.encode())


def test_an_image_with_codes_that_mean_nothing(tmp_path: Path) -> None:
    make(tmp_path, make_settings(layers=["clean", "reason"]), make_tasks(4, 1))
    file = tmp_path / "train/s000/smile.1_00000_reason.png"
    file.write_bytes(encode_png(np.full((24, 32), 200, np.uint8)))
    edit(tmp_path, lambda r: r["files"]["reason"].update(_checksum(file)))
    with pytest.raises(DatasetError, match="holds 200, which is no code of a reason"):
        _ = open_dataset(tmp_path).frames()[0].reason


@pytest.mark.parametrize("subject", ["../../x", "..", "/x", "a/b", "a\0b", ""])
def test_nothing_is_written_outside(tmp_path: Path, subject: str) -> None:
    tasks = [dataclasses.replace(task, subject=subject) for task in make_tasks(1, 1)]
    with pytest.raises(DatasetError, match="does not name a file inside the data set"):
        make(tmp_path / "a" / "b", tasks=tasks)
    assert list(tmp_path.rglob("*")) == []


@pytest.mark.parametrize("name", ["dataset.json", ".glsim", ".glsim/chunks.jsonl"])
def test_what_describes_the_set_may_not_lie_outside(tree: Path, name: str) -> None:
    """The index outside says that the header was changed; nobody may read that."""
    moved = tree.parent / "moved"
    (tree / name).rename(moved)
    (tree / name).symlink_to(moved)
    index = moved / "chunks.jsonl" if moved.is_dir() else moved
    if name != "dataset.json":
        index.write_text('{"size":1,"crc32":1}\n')
    assert ("leads out of" in problem_of(tree)) is (name == "dataset.json")
    assert ("leads out of" in "".join(verify(tree))) is (name != ".glsim/chunks.jsonl")


def test_verify_lists_no_folder_that_a_link_leads_to(tree: Path) -> None:
    outside = tree.parent / "outside"
    outside.mkdir()
    (outside / "secret").touch()
    shutil.rmtree(tree / "val")
    (tree / "val").symlink_to(outside)
    problems = verify(tree)
    assert f"val: leads out of {tree}" in problems
    assert not any("secret" in problem for problem in problems)
