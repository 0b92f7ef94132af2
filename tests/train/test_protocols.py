"""Depths of training pairs count from 1 mm; data and checkpoints record that protocol."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.core.files.atomic import read_json
from glsim.data.reader import open_dataset
from glsim.denoise.registry import load_denoiser
from glsim.train import StoredPairs, stored_batches
from glsim.train.data.checks import moved_pair
from tests.support.moved_sets import write_domes
from tests.support.train_fakes import recipe


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("sets")
    return {
        "depth": write_domes(root / "depth", "depth", subjects=4, frames=4),
        "paper": write_domes(root / "paper", "paper", subjects=4, frames=4),
    }


@pytest.mark.parametrize("stored", ["depth", "paper"])
def test_pairs_have_the_nearest_point_at_1_mm(sets: dict[str, Path], stored: str) -> None:
    pairs = StoredPairs(sets[stored], "train", protocol="paper")
    measured = open_dataset(sets["depth"]).split("train")
    for number in (0, 3, 3):  # the second time from the cache
        noisy_mm, clean_mm = (image[0].numpy() for image in pairs[number])
        pair = measured[number]
        offset_mm = pair.clean_mm[pair.clean_mm > 0].min() - 1
        assert clean_mm[clean_mm > 0].min() == 1
        for moved, depth in ((noisy_mm, pair.noisy_mm), (clean_mm, pair.clean_mm)):
            wanted = np.where(depth > 0, np.maximum(depth - offset_mm, 1), 0)
            np.testing.assert_allclose(moved, wanted, atol=1e-3)
    assert StoredPairs(sets[stored], "train").protocol == stored
    as_measured = StoredPairs(sets[stored], "train", protocol="depth")[3][1]
    assert as_measured[as_measured > 0].min() > 900


def test_a_crop_is_moved_by_its_own_nearest_point(sets: dict[str, Path]) -> None:
    pairs = StoredPairs(sets["depth"], "train", crop=16, cut="random", protocol="paper")
    for epoch in range(3):
        pairs.set_epoch(epoch)
        clean_mm = pairs[1][1].numpy()
        assert clean_mm[clean_mm > 0].min() == 1


def test_neighbours_move_with_the_frame() -> None:
    depth = np.full((3, 2, 2), 900, np.float32) + np.arange(3, dtype=np.float32)[:, None, None]
    depth[1, 0, 0] = 0
    moved = moved_pair(depth)
    np.testing.assert_array_equal(moved[0], 1)  # 900 is before the target's 902
    np.testing.assert_array_equal(moved[1], [[0, 1], [1, 1]])
    np.testing.assert_array_equal(moved[2], 1)
    further = depth + np.array([[[10]], [[20]], [[0]]], np.float32)
    np.testing.assert_array_equal(moved_pair(further)[0], 9)


def test_the_fingerprint_of_the_data_has_the_protocol(sets: dict[str, Path]) -> None:
    tiny: Any = {"crop": 0}
    assert "protocol" not in stored_batches([sets["depth"]], recipe(data=tiny)).fingerprint
    found = stored_batches([sets["paper"]], recipe(data=tiny)).fingerprint
    assert found["protocol"] == "paper"
    both = list(sets.values())
    with pytest.raises(ConfigError, match=r"different protocols \(depth, paper\): choose one"):
        stored_batches(both, recipe(data=tiny))
    joined = stored_batches(both, recipe(data=tiny | {"protocol": "paper"}))
    assert joined.fingerprint["protocol"] == "paper"


def test_a_training_records_its_protocol_and_its_network_keeps_it(
    sets: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    command = ["train", "paper-d7-small", "--data", str(sets["depth"]), "-o", str(out), "-q"]
    command += ["--steps", "1", "--set", "training.batch=1", "--set", "data.crop=0"]
    command += ["--set", "model.backbone.width=4", "--set", "model.backbone.depth=3"]
    assert main([*command, "--protocol", "paper"]) == 0
    assert read_json(out / "run.json")["data"]["protocol"] == "paper"
    assert load_denoiser(str(out / "best.pt")).protocol == "paper"
    assert main([*command, "--resume", "--protocol", "depth"]) == 1
    assert "was trained on other data (protocol differ)" in capsys.readouterr().err
