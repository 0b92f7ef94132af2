"""A data set's folder for the Hugging Face Hub, its card, and the library that loads it."""

from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError, DatasetError
from glsim.data.export import export_dataset
from glsim.data.export.hub_folder import dataset_card, licence_of
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


def test_the_card_names_the_splits(tree: Path) -> None:
    yaml = pytest.importorskip("yaml")
    header = open_dataset(tree).header
    card = yaml.safe_load(dataset_card(header).split("---\n")[1])
    assert card["configs"][0]["data_files"] == [
        {"split": "train", "path": "train/**"},
        {"split": "validation", "path": "val/**"},
        {"split": "test", "path": "test/**"},
    ]
    assert card["license"] == "cc0-1.0"
    header["settings"]["source"] = [{"kind": "folder"}]
    card = yaml.safe_load(dataset_card(header).split("---\n")[1])
    assert card["license_name"] == "licence-of-the-faces"


def test_only_what_the_manifest_names_is_copied(tree: Path, tmp_path: Path) -> None:
    named = {name: data for name, data in contents(tree).items() if not name.startswith(".glsim/")}
    image = next(tree.rglob("*_clean.png"))
    (tree / ".env").write_text("TOKEN=1")
    (image.parent / ".image.png.tmp").write_bytes(b"half")
    (tree / "train" / "link").symlink_to("/etc/hostname")
    out = tmp_path / "out"
    assert main(["export", str(tree), "-o", str(out), "--to", "hf"]) == 0
    copied = contents(out)
    assert copied.pop("README.md").startswith(b"---\nlicense: ")
    assert copied == named
    assert verify(out, deep=True) == []


@pytest.mark.parametrize("damage", ["cut", "link"])
def test_a_damaged_data_set_is_not_copied(tree: Path, tmp_path: Path, damage: str) -> None:
    image = next(tree.rglob("*_clean.png"))
    content = image.read_bytes()
    if damage == "link":
        (tmp_path / "outside.png").write_bytes(content)
        image.unlink()
        image.symlink_to(tmp_path / "outside.png")
    else:
        image.write_bytes(content[:-9])
    with pytest.raises(DatasetError, match=image.name):
        export_dataset(open_dataset(tree), tmp_path / "out", ["hf"])
    assert not (tmp_path / "out").exists()


def test_hf_stands_alone_and_needs_a_new_folder(tree: Path) -> None:
    for wrong in ({"formats": ["hf", "ply"]}, {"formats": ["hf"], "split": "test"}):
        with pytest.raises(ConfigError, match="give no other format or part"):
            export_dataset(open_dataset(tree), tree.parent / "out", **wrong)
    with pytest.raises(ConfigError, match="is not empty"):
        export_dataset(open_dataset(tree), tree.parent, ["hf"])


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
