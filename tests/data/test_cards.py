"""README.md and croissant.json of a data set, and the libraries that read them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.data.cards import licence_of, write_cards
from glsim.data.reader import open_dataset
from glsim.data.verification import verify
from tests.support.dataset_fakes import contents, make, make_settings, make_tasks


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    make(tmp_path / "data", make_settings(), make_tasks(4, 3))
    return tmp_path / "data"


@pytest.mark.parametrize(
    ("kinds", "licence"),
    [
        (["people", "procedural"], "cc0-1.0"),
        (["ict-facekit", "procedural"], "mit"),
        (["procedural", "folder"], "other"),
        (["a-plug-in"], "other"),
        ([], "other"),
    ],
)
def test_the_licence_is_that_of_the_faces(kinds: list[str], licence: str) -> None:
    output = {"layers": ["clean", "noisy"]}
    settings = {"source": [{"kind": kind} for kind in kinds], "output": output}
    assert licence_of({"settings": settings}) == licence
    output["layers"] = ["noisy"]  # of a real camera: there is no clean depth
    assert licence_of({"settings": settings}) == "other"


def test_cards_name_the_splits_and_change_no_byte_of_the_set(tree: Path) -> None:
    yaml = pytest.importorskip("yaml")
    pytest.importorskip("mlcroissant")
    before = contents(tree)
    paths = write_cards(tree)
    assert [path.name for path in paths] == ["README.md", "croissant.json"]
    assert {name: data for name, data in contents(tree).items() if name in before} == before
    assert verify(tree, deep=True) == []
    card = yaml.safe_load(paths[0].read_text().split("---\n")[1])
    assert card["configs"][0]["data_files"] == [
        {"split": "train", "path": "train/**"},
        {"split": "validation", "path": "val/**"},
        {"split": "test", "path": "test/**"},
    ]
    assert json.loads(paths[1].read_text())["license"] == card["license"] == "cc0-1.0"


def test_without_the_libraries_it_says_what_to_install(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.core.errors.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'glsim\[hub\]'"):
        write_cards(tree)


@pytest.mark.filterwarnings("ignore")  # of the library's own dependencies
def test_mlcroissant_reads_the_manifest_by_the_card(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mlc = pytest.importorskip("mlcroissant", exc_type=ImportError)
    monkeypatch.chdir(tree)
    write_cards(tree)
    described = mlc.Dataset(jsonld=str(tree / "croissant.json"))
    rows = list(described.records("frames"))
    records = [pair.record for pair in open_dataset(tree)]
    assert [row["frames/index"] for row in rows] == [record["index"] for record in records]


@pytest.mark.filterwarnings("ignore")  # of the library's own dependencies
def test_the_library_datasets_loads_the_folder(tree: Path, tmp_path: Path) -> None:
    datasets = pytest.importorskip("datasets", exc_type=ImportError)
    cache = str(tmp_path / "cache")
    loaded = datasets.load_dataset("imagefolder", data_dir=str(tree), cache_dir=cache)
    assert {name: len(split) for name, split in loaded.items()} == {
        "train": 6, "validation": 3, "test": 3,
    }  # fmt: skip
    ours = {pair.record["index"]: pair for pair in open_dataset(tree)}
    for row in loaded["train"]:
        pair = ours[row["index"]]
        for name in ("clean", "noisy"):
            np.testing.assert_allclose(np.asarray(row[name]) * pair.step_mm, pair[f"{name}_mm"])
