"""README.md and croissant.json of a data set, and the libraries that read them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from glsim.dataset import open_dataset, verify
from glsim.dataset.cards import croissant, hub_card
from tests.support.dataset_fakes import contents, make, make_settings, make_tasks


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    make(tmp_path / "data", make_settings(), make_tasks(4, 3))
    return tmp_path / "data"


def front_matter(path: Path) -> dict[str, object]:
    return dict(yaml.safe_load((path / "README.md").read_text().split("---\n")[1]))


def test_the_card_tells_the_hub_where_the_splits_are(tree: Path) -> None:
    card = front_matter(tree)
    assert card["size_categories"] == ["n<1K"]
    files = card["configs"][0]["data_files"]  # type: ignore[index]
    assert files == [
        {"split": "train", "path": "train/**"},
        {"split": "validation", "path": "val/**"},
        {"split": "test", "path": "test/**"},
    ]
    text = (tree / "README.md").read_text()
    assert "| train | 6 | 2 |" in text
    assert "12 simulated frames" in text
    assert "No subject is in two splits." in text


@pytest.mark.parametrize(
    ("kinds", "licence", "page"),
    [
        (["procedural"], "cc0-1.0", "https://creativecommons.org/publicdomain/zero/1.0/"),
        (["people", "procedural"], "cc0-1.0", "publicdomain/zero"),
        (["ict-facekit", "procedural"], "mit", "https://opensource.org/license/mit"),
        (["procedural", "folder"], "other", "ask their owners"),
        (["a-plug-in"], "other", "ask their owners"),
    ],
)
def test_cards_state_licence_and_citation(
    tree: Path, kinds: list[str], licence: str, page: str
) -> None:
    header = json.loads((tree / "dataset.json").read_text())
    header["settings"]["source"] = [{"kind": kind} for kind in kinds]
    card = hub_card(header).decode()
    front = yaml.safe_load(card.split("---\n")[1])
    assert front["license"] == licence
    assert ("license_name" in front) == (licence == "other")
    described = json.loads(croissant(header, "0" * 64))
    assert page in described["license"]
    for text in (card, described["citeAs"]):
        assert f"version = {{{header['glsim_version']}}}" in text
    recorded = {**header["settings"]["output"], "layers": ["noisy"]}
    header["settings"]["output"] = recorded  # of a real camera: there is no clean depth
    assert yaml.safe_load(hub_card(header).decode().split("---\n")[1])["license"] == "other"


def test_shards_and_empty_splits_are_named_as_they_are(tmp_path: Path) -> None:
    make(tmp_path / "data", make_settings(format="webdataset"), make_tasks(1, 3))
    files = front_matter(tmp_path / "data")["configs"][0]["data_files"]  # type: ignore[index]
    assert files == [{"split": "train", "path": "train-*.tar"}]
    sets = json.loads((tmp_path / "data/croissant.json").read_text())["distribution"]
    assert [entry["@id"] for entry in sets] == ["manifest.jsonl", "shards"]


def test_cards_have_the_same_bytes_and_are_verified_and_repaired(
    tree: Path, tmp_path: Path
) -> None:
    make(tmp_path / "again", make_settings(), make_tasks(4, 3))
    first = contents(tree)
    assert first == contents(tmp_path / "again")
    for name in ("README.md", "croissant.json"):
        assert not verify(tree)
        (tree / name).write_text("changed")
        assert [problem.split()[0] for problem in verify(tree)] == [name]
        make(tree, make_settings(), make_tasks(4, 3))
        assert contents(tree) == first


@pytest.mark.filterwarnings("ignore")  # of the library's own dependencies
def test_mlcroissant_reads_the_manifest_by_the_card(
    tree: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    mlc = pytest.importorskip("mlcroissant", exc_type=ImportError)
    monkeypatch.chdir(tree)
    described = mlc.Dataset(jsonld=str(tree / "croissant.json"))
    assert not described.metadata.ctx.issues.errors
    assert "not standard" not in caplog.text  # of the context
    rows = list(described.records("frames"))
    assert len(rows) == 12
    records = [pair.record for pair in open_dataset(tree)]
    assert [row["frames/index"] for row in rows] == [record["index"] for record in records]
    assert rows[0]["frames/subject"] == records[0]["subject"].encode()


@pytest.mark.filterwarnings("ignore")  # of the library's own dependencies
@pytest.mark.parametrize("by", ["imagefolder", "card"])
def test_the_library_datasets_loads_the_folder(tree: Path, tmp_path: Path, by: str) -> None:
    datasets = pytest.importorskip("datasets", exc_type=ImportError)
    cache = str(tmp_path / "cache")
    if by == "card":
        loaded = datasets.load_dataset(str(tree), cache_dir=cache)
    else:
        loaded = datasets.load_dataset("imagefolder", data_dir=str(tree), cache_dir=cache)
    assert {name: len(split) for name, split in loaded.items()} == {
        "train": 6,
        "validation": 3,
        "test": 3,
    }
    ours = {pair.record["index"]: pair for pair in open_dataset(tree)}
    for row in loaded["train"]:
        pair = ours[row["index"]]
        assert row["subject"] == pair.key.subject
        for name in ("clean", "noisy"):
            depth_mm = np.asarray(row[name]) * pair.step_mm
            np.testing.assert_allclose(depth_mm, pair[f"{name}_mm"])
