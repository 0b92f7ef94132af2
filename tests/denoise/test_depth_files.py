"""The depth files that ``glsim denoise`` reads: their data set is looked up, and read, once."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.dataset.record_schema import read_object
from glsim.denoise import depth_files, map_steps
from glsim.errors import ConfigError
from tests.support.dataset_fakes import make, make_settings, make_tasks


def test_the_header_of_a_data_set_is_read_once_for_all_of_its_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path, make_settings(depth_unit_mm=0.5), make_tasks(3, 2))
    files = sorted(tmp_path.rglob("*_noisy.png"))
    assert len({file.parent for file in files}) == 3
    read = []
    original = read_object

    def count(path: Path) -> object:
        read.append(path)
        return original(path)

    monkeypatch.setattr(depth_files, "read_object", count)
    assert map_steps.unit_mm(files, None) == 0.5
    assert len(read) == 1


def test_a_header_that_changes_is_read_again(tmp_path: Path) -> None:
    folder = tmp_path / "train" / "anna"
    folder.mkdir(parents=True)
    file = folder / "depth.png"
    cv2.imwrite(str(file), np.full((4, 4), 900, np.uint16))
    header = tmp_path / "dataset.json"
    header.write_text('{"format": "of another program"}')
    assert map_steps.unit_mm([file], None) == 1.0
    make(tmp_path / "other", make_settings(depth_unit_mm=0.5), make_tasks(1, 1))
    header.write_bytes((tmp_path / "other" / "dataset.json").read_bytes())
    assert map_steps.unit_mm([file], None) == 0.5


def test_maps_of_the_same_name_keep_their_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("day/a/x.png", "day/b/x.png", "day/b/c/y.png"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(name, np.full((4, 4), 900, np.uint16))
    out = Path("out")
    different = depth_files.find_maps(["day/a", "day/b/c"], out)
    assert [target for _, target in different] == [out / "x.png", out / "y.png"]
    for inputs in (["day/a", "day/b"], ["day/*/x.png", "day/b/c/y.png"]):
        pairs = depth_files.find_maps(inputs, out)
        assert {str(source): target for source, target in pairs} == {
            "day/a/x.png": out / "a/x.png",
            "day/b/x.png": out / "b/x.png",
            "day/b/c/y.png": out / "b/c/y.png",
        }
    with pytest.raises(ConfigError, match=r"day/a/x.png: is given twice"):
        depth_files.find_maps(["day/a", "day/a/x.png"], out)
