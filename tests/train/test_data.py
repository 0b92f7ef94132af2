"""Stored pairs: values, dependence on (seed, epoch, index) alone, and bad data sets."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.png import read_image
from glsim.data.reader import open_dataset
from glsim.train import Augmentation, StoredPairs, stored_batches
from glsim.train.data.checks import fingerprint
from glsim.train.data.stored import sample_texture
from tests.support.dataset_fakes import make, make_settings, make_tasks, sign
from tests.support.train_fakes import crop_places, recipe

#: The fakes are 32 x 24 pixels, 4 frames of 8 subjects, 4 of which are in train.
FRAMES = 16


@pytest.fixture(scope="module", params=["png", "webdataset"])
def dataset(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out: Path = tmp_path_factory.mktemp("data") / request.param
    make(out, make_settings(format=request.param, depth_unit_mm=0.1), make_tasks(8, 4))
    return out


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(dataset, tmp_path / "copy"))


@pytest.mark.parametrize("cache_mb", [0, 1000])
def test_a_pair_is_the_data_sets_in_millimetres(dataset: Path, cache_mb: float) -> None:
    pairs = StoredPairs(dataset, "train", cache_mb=cache_mb)
    stored = open_dataset(dataset).split("train")
    assert len(pairs) == len(stored) == FRAMES
    for _ in range(2):  # the second time from the cache, if there is one
        for number in (0, 7, -1):
            noisy_mm, clean_mm = pairs[number]
            assert noisy_mm.shape == clean_mm.shape == (1, 24, 32)
            assert noisy_mm.dtype == clean_mm.dtype == torch.float32
            np.testing.assert_array_equal(noisy_mm[0], stored[number].noisy_mm)
            np.testing.assert_array_equal(clean_mm[0], stored[number].clean_mm)
    with pytest.raises(IndexError):
        pairs[FRAMES]


def test_the_target_is_in_the_recipe_and_in_the_fingerprint(tmp_path: Path) -> None:
    layers = ["clean", "expected", "noisy"]
    make(tmp_path / "d", make_settings(layers=layers), make_tasks(8, 2))
    both = [
        stored_batches([tmp_path / "d"], recipe(data={"crop": 0, "target": target}))
        for target in ("clean", "expected")
    ]
    prints = [source.fingerprint for source in both]
    assert prints[0] == fingerprint(tmp_path / "d")
    assert prints[1] == prints[0] | {"target": "expected"}
    truths = [source.validation[0][1] for source in both]
    np.testing.assert_array_equal(*(truth > 0 for truth in truths))
    assert float((truths[1] - truths[0])[truths[0] > 0].mean()) == pytest.approx(2.0, abs=0.1)


def test_the_cache_spares_the_files_and_its_limit_is_kept(copy: Path) -> None:
    size_mb = FRAMES * 2 * 24 * 32 * 2 / 1e6
    kept, small = (StoredPairs(copy, "train", cache_mb=size_mb * f) for f in (1.01, 0.99))
    first = kept[3][0]
    small[3]
    for file in [*copy.rglob("*.png"), *copy.rglob("*.tar")]:
        file.unlink()
    assert torch.equal(kept[3][0], first)
    with pytest.raises(DatasetError, match="is missing"):
        small[3]


def test_a_normalised_data_set_has_its_offset_back(tmp_path: Path) -> None:
    """Noise is a function of distance, so a network must see the measured distance."""
    out = tmp_path / "near"
    make(out, tasks=make_tasks(4, 1))
    manifest = out / "manifest.jsonl"
    manifest.write_text(
        manifest.read_text().replace('"depth_offset_mm":0.0', '"depth_offset_mm":7.0')
    )
    sign(out)
    pairs = StoredPairs(out, "train")
    for _ in range(2):
        noisy_mm, _ = pairs[0]
        (file, *_) = sorted((out / "train").rglob("*_noisy.png"))
        units = read_image(file)
        np.testing.assert_array_equal(noisy_mm[0], np.where(units > 0, units + np.float32(7), 0))


def test_augmentation_is_a_function_of_seed_epoch_and_index(dataset: Path) -> None:
    def pairs(seed: int) -> StoredPairs:
        return StoredPairs(
            dataset, "train", crop=16, cut="random", augmentation=Augmentation(flip=True), seed=seed
        )

    def all_of(source: StoredPairs, order: range) -> list[torch.Tensor]:
        pairs_of = {n: torch.stack(source[n]) for n in order}
        return [pairs_of[n] for n in range(FRAMES)]

    one, other = pairs(1), pairs(1)
    one.set_epoch(3)
    other.set_epoch(3)
    forward = all_of(one, range(FRAMES))
    backward = all_of(other, range(FRAMES - 1, -1, -1))
    assert all(map(torch.equal, forward, backward))
    one.set_epoch(4)
    assert not all(map(torch.equal, forward, all_of(one, range(FRAMES))))
    different = pairs(2)
    different.set_epoch(3)
    assert not all(map(torch.equal, forward, all_of(different, range(FRAMES))))


@pytest.mark.parametrize("augmentation", [Augmentation(False, 2.0), Augmentation(False, 0.0, 5.0)])
def test_bumps_and_slopes_lie_on_both_maps_alike_and_fill_no_hole(
    dataset: Path, augmentation: Augmentation
) -> None:
    plain = StoredPairs(dataset, "train")
    pairs, again = (
        StoredPairs(dataset, "train", augmentation=augmentation, seed=3) for _ in range(2)
    )
    heights = []
    for number in range(FRAMES):
        before, after = (torch.stack(source[number])[:, 0] for source in (plain, pairs))
        assert torch.equal(after, torch.stack(again[number])[:, 0])
        assert torch.equal(before > 0, after > 0)
        added = torch.where(before > 0, after - before, torch.nan)
        both = ~added.isnan().any(0)
        torch.testing.assert_close(added[0][both], added[1][both], atol=2e-4, rtol=0)
        if augmentation.slope_mm_per_px:  # a plane
            for steps in (torch.diff(added[0], dim=axis) for axis in (0, 1)):
                known = steps[~steps.isnan()]
                assert known.max() - known.min() < 1e-3
        heights.append(float(added.nan_to_num().abs().max()))
    assert min(heights) == 0, "some frames stay as they are"
    assert 0.1 < max(heights) < 20 * (1 + augmentation.slope_mm_per_px)


def test_textures_have_their_size_and_averaged_frames_less_noise(dataset: Path) -> None:
    rng = np.random.default_rng(0)
    drawn = [sample_texture((96, 96), rng) for _ in range(40)]
    inside = [texture[texture != 0].std() for texture in drawn]
    assert min(inside) > 0.1
    assert max(inside) < 5
    assert all(np.count_nonzero(texture == 0) for texture in drawn), "in patches"
    plain, averaged, textured = (
        StoredPairs(dataset, "train", augmentation=change)
        for change in (None, Augmentation(averaged=1.0), Augmentation(texture=1.0))
    )
    added_mm = []
    for number in range(3):
        (noisy, clean), (less, same), (rough, form) = (
            pairs[number] for pairs in (plain, averaged, textured)
        )
        assert torch.equal(clean, same)
        near = (noisy > 0) & (clean > 0) & ((noisy - clean).abs() < 50)
        ratio = ((less - clean)[near] / (noisy - clean)[near]).nanmedian().item()
        assert min(abs(ratio - n**-0.5) for n in (2, 4, 9)) < 1e-3
        assert torch.equal(less[~near], noisy[~near])
        both = (rough > 0) & (form > 0)
        torch.testing.assert_close((rough - form)[both], (noisy - clean)[both], atol=1e-3, rtol=0)
        added_mm.append((form - clean)[both].std().item())
    assert max(added_mm) > 0.1


def test_cuts_and_flips_move_both_maps_alike(dataset: Path) -> None:
    pairs = StoredPairs(
        dataset, "train", crop=16, cut="random", augmentation=Augmentation(flip=True), seed=5
    )
    seen_places = set()
    for number, stored in enumerate(open_dataset(dataset).split("train")):
        noisy_mm, clean_mm = pairs[number]
        whole = np.stack([stored.noisy_mm, stored.clean_mm])
        places = crop_places(np.stack([noisy_mm[0], clean_mm[0]]), whole)
        assert len(places) == 1
        seen_places |= places
    assert {flip for _, _, flip in seen_places} == {False, True}
    assert len({top for top, _, _ in seen_places}) > 4
    assert len({left for _, left, _ in seen_places}) > 4
    centred = StoredPairs(dataset, "train", crop=16, cut="centre")
    np.testing.assert_array_equal(
        centred[0][1][0], open_dataset(dataset).split("train")[0].clean_mm[4:20, 8:24]
    )


def test_workers_give_the_same_and_hear_of_the_epoch(dataset: Path) -> None:
    pairs = StoredPairs(dataset, "train", crop=16, cut="random", seed=1)
    loader = DataLoader(pairs, batch_size=4, num_workers=2, persistent_workers=True)
    seen = []
    for epoch in (0, 1):
        pairs.set_epoch(epoch)
        seen.append(torch.cat([noisy for noisy, _ in loader]))
        assert torch.equal(seen[-1], torch.stack([pairs[n][0] for n in range(FRAMES)]))
    assert not torch.equal(*seen)


def edit_manifest(root: Path, change: Callable[[list[dict[str, Any]]], None]) -> None:
    path = root / "manifest.jsonl"
    records = [json.loads(line) for line in path.read_text().splitlines()]
    change(records)
    path.write_text("".join(json.dumps(r) + "\n" for r in records))
    sign(root)


def test_a_split_that_is_not_there(tmp_path: Path) -> None:
    out = tmp_path / "two"
    make(out, tasks=[task for task in make_tasks(8, 2) if task.split != "val"])
    with pytest.raises(DatasetError, match=r"no frames in its split 'val' .*train 8, val 0"):
        StoredPairs(out, "val")
    with pytest.raises(DatasetError, match=r"no such split 'valid'.*'val'"):
        StoredPairs(out, "valid")
    with pytest.raises(DatasetError, match="no data set of glsim"):
        StoredPairs(tmp_path, "train")


def test_another_size_than_the_training_asks_for(dataset: Path) -> None:
    with pytest.raises(
        DatasetError, match=r"32 x 24 pixels, the training asks for 16 x 16.*--set output\.crop=16"
    ):
        StoredPairs(dataset, "train", crop=16)
    with pytest.raises(DatasetError, match=r"asks for 28 x 28"):
        StoredPairs(dataset, "train", crop=28, cut="random")
    with pytest.raises(ConfigError, match="a crop of 0"):
        StoredPairs(dataset, "train", crop=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r[-1].update(subject=r[0]["subject"]), r"subject s\d+ is in train and in "),
        (lambda r: r[5]["intrinsics"].update(width=40), r"40 x 24 pixels, frames before it 32 x"),
    ],
)
def test_mixed_people_and_sizes(copy: Path, change: Any, message: str) -> None:
    edit_manifest(copy, change)
    with pytest.raises(DatasetError, match=message):
        StoredPairs(copy, "train")


@pytest.mark.parametrize(
    ("written", "options", "message"),
    [
        (["clean"], {}, r"no layer 'noisy'"),
        (["clean", "noisy"], {"target": "expected"}, r"no layer 'expected'"),
    ],
)
def test_a_layer_that_was_not_written(
    tmp_path: Path, written: list[str], options: dict[str, Any], message: str
) -> None:
    make(tmp_path / "set", make_settings(layers=written), make_tasks(4, 1))
    with pytest.raises(DatasetError, match=message):
        StoredPairs(tmp_path / "set", "train", **options)


def test_the_fingerprint_is_of_the_content(copy: Path, dataset: Path, tmp_path: Path) -> None:
    same, first = fingerprint(dataset), fingerprint(copy)
    assert first == same
    assert json.loads(json.dumps(first)) == first
    assert str(tmp_path) not in json.dumps(first)
    assert first["frames"] == {"train": FRAMES, "val": 8, "test": 8}
    edit_manifest(copy, lambda records: records[0]["files"]["clean"].update(crc32=1))
    assert fingerprint(copy) != first
    (copy / "manifest.jsonl").unlink()
    with pytest.raises(DatasetError, match="manifest"):
        fingerprint(copy)
