"""README.md of a data set, and the library that loads its folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.data.export.hub import licence_of, write_card
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


def test_the_card_names_the_splits_and_changes_no_byte_of_the_set(tree: Path) -> None:
    yaml = pytest.importorskip("yaml")
    before = contents(tree)
    path = write_card(tree)
    assert {name: data for name, data in contents(tree).items() if name in before} == before
    assert verify(tree, deep=True) == []
    card = yaml.safe_load(path.read_text().split("---\n")[1])
    assert card["configs"][0]["data_files"] == [
        {"split": "train", "path": "train/**"},
        {"split": "validation", "path": "val/**"},
        {"split": "test", "path": "test/**"},
    ]
    assert card["license"] == "cc0-1.0"


def test_without_the_libraries_it_says_what_to_install(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.core.errors.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'glsim\[hub\]'"):
        write_card(tree)


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
