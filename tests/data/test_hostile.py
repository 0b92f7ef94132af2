"""Data sets whose records lie: nothing outside is read, nothing ends in a traceback."""

import dataclasses
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from glsim.core.errors import DatasetError
from glsim.data.reader import open_dataset
from glsim.data.record_schema import parse_frame, parse_header
from glsim.data.records import parse_chunk_record
from glsim.data.verification import verify
from tests.support.dataset_fakes import make, make_settings, make_tasks, sign

PNG, SHARD = "train/s000/smile.1_00000_noisy.png", "train-000000.tar"


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


def first_line(change_record: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    """Change the first record, and record the checksums again."""

    def change(root: Path) -> None:
        path = root / "manifest.jsonl"
        first, _, rest = path.read_bytes().partition(b"\n")
        record = json.loads(first)
        change_record(record)
        path.write_bytes(json.dumps(record).encode() + b"\n" + rest)
        sign(root)

    return change


def name(name: str) -> Callable[[Path], None]:
    """Put a name of a file into the first record."""
    return first_line(lambda record: record["files"]["noisy"].update(name=name))


def put(file: str, make_it: Callable[[Path], object]) -> Callable[[Path], None]:
    """Put something else in the place of a file or folder."""

    def change(root: Path) -> None:
        (root / file).rename(root / "moved")
        make_it(root / file)

    return change


def problem_of(root: Path) -> str:
    """Read everything; return the one-line problem, "" if there is none."""
    problem = ""
    try:
        for pair in open_dataset(root):
            _ = pair.clean_mm, pair.noisy_mm, pair.intrinsics, repr(pair)
    except DatasetError as error:
        problem = str(error)
    assert len(problem) < 600
    return problem


@pytest.mark.parametrize(
    ("format", "change", "opened"),
    [
        ("png", name("../outside/map.png"), "line 1 is damaged: files.noisy.name"),
        ("png", put(PNG, lambda p: p.symlink_to("../../../outside/map.png")), "leads out of"),
        ("png", put(PNG, os.mkfifo), "is a pipe"),
        ("png", put("manifest.jsonl", os.mkfifo), "is a pipe"),
        (
            "png",
            first_line(lambda record: record.update(notes="x" * 10**6)),
            "it has more than 131072 bytes",
        ),
        ("webdataset", put(SHARD, lambda p: p.symlink_to("../outside/map.png")), "leads out of"),
        (
            "webdataset",
            first_line(lambda record: record["files"]["noisy"].update(offset=10**9)),
            "was changed after it was written",
        ),
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


def test_a_changed_manifest_or_header_is_refused(tree: Path) -> None:
    manifest, file = tree / "manifest.jsonl", tree / "dataset.json"
    whole = manifest.read_text()
    manifest.write_text(whole.replace('"fx":40.0', '"fx":41.0', 1))
    assert "manifest.jsonl: was changed after it was written" in problem_of(tree)
    lines = whole.splitlines(keepends=True)
    manifest.write_text("".join([lines[-1], *lines[1:-1], lines[0]]))  # a test frame into train
    sign(tree)
    assert "split: is test, dataset.json counts this frame to train" in problem_of(tree)
    file.write_text(file.read_text().replace('"depth_unit_mm": 1.0', '"depth_unit_mm": 0.5'))
    assert "dataset.json: was changed after it was written" in problem_of(tree)
    assert "dataset.json was changed" in verify(tree)[0]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=5,
)


def places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of each value below a tree of JSON."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    found = []
    for key, value in items:
        found.append((*path, key))
        if isinstance(value, dict | list):
            found += places(value, (*path, key))
    return found


@given(data=st.data())
def test_any_value_in_a_record_is_checked_or_one_line(originals: Path, data: st.DataObject) -> None:
    """A record that is taken names files inside, and reads without another error."""
    root = originals / "png" / "set"
    kind = data.draw(st.sampled_from(["dataset.json", "manifest.jsonl"]))
    text = (root / kind).read_bytes()
    record = json.loads(text if kind == "dataset.json" else text.partition(b"\n")[0])
    path = data.draw(st.sampled_from(places(record)))
    node = record
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = data.draw(JSON)
    line = json.dumps(record).encode()
    try:
        if kind == "dataset.json":
            assert set(parse_header(line, "x")["frames"]) == {"train", "val", "test"}
        else:
            for file in parse_frame(line, "x")["files"].values():
                assert not {"", ".", ".."} & set(file["name"].split("/"))
    except DatasetError as error:
        refused = str(error)
        assert refused.startswith("x is damaged: ")


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_any_bytes_of_a_chunk_record_are_one_line(data: bytes) -> None:
    for text in (data, b"00000000 " + data):
        with pytest.raises(DatasetError, match="damaged"):
            parse_chunk_record(text)


@pytest.mark.parametrize("subject", ["../../x", "..", "/x", "a/b", "a\0b", ""])
def test_nothing_is_written_outside(tmp_path: Path, subject: str) -> None:
    tasks = [dataclasses.replace(task, subject=subject) for task in make_tasks(1, 1)]
    with pytest.raises(DatasetError, match="does not name a file inside the data set"):
        make(tmp_path / "a" / "b", tasks=tasks)
    assert list(tmp_path.rglob("*")) == []


def test_verify_lists_no_folder_that_a_link_leads_to(tree: Path) -> None:
    outside = tree.parent / "outside"
    outside.mkdir()
    (outside / "secret").touch()
    shutil.rmtree(tree / "val")
    (tree / "val").symlink_to(outside)
    problems = verify(tree)
    assert f"val: leads out of {tree}" in problems
    assert not any("secret" in problem for problem in problems)
