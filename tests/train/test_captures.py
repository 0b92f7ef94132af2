"""Second captures: frames of one sequence, near in time, drawn by seed and epoch alone."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch

from glsim.errors import ConfigError, DatasetError
from glsim.train import Augmentation, StoredPairs, load_recipe, simulated_batches, stored_batches
from glsim.train.data.captures import StoredCaptures
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.train_fakes import crop_places

#: 6 frames of 8 subjects, 4 of which are in train.
FRAMES, OF_EACH = 24, 6


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out: Path = tmp_path_factory.mktemp("data") / "sequences"
    make(out, make_settings(depth_unit_mm=0.1), make_tasks(8, OF_EACH))
    return out


@pytest.mark.parametrize("cache_mb", [0, 1000])
def test_both_maps_are_noisy_frames_of_one_sequence(dataset: Path, cache_mb: float) -> None:
    captures = StoredCaptures(dataset, "train", frames_apart=2, cache_mb=cache_mb)
    single = StoredPairs(dataset, "train")
    noisy = torch.stack([single[n][0] for n in range(FRAMES)])
    for epoch in range(3):
        captures.set_epoch(epoch)
        for number in range(FRAMES):
            first, second = captures[number]
            assert torch.equal(first, noisy[number])
            other = captures.second_of(number)
            assert torch.equal(second, noisy[other])
            assert 1 <= abs(other - number) <= 2
            a, b = captures.split[number], captures.split[other]
            assert (a.subject, a.sequence) == (b.subject, b.sequence)


def test_before_and_after_are_drawn_alike_and_anew_in_each_epoch(dataset: Path) -> None:
    captures = StoredCaptures(dataset, "train", frames_apart=1, seed=4)
    inner = [n for n in range(FRAMES) if 0 < n % OF_EACH < OF_EACH - 1]
    draws: Counter[int] = Counter()
    for epoch in range(60):
        captures.set_epoch(epoch)
        draws.update(captures.second_of(n) - n for n in inner)
    share = draws[1] / draws.total()
    assert set(draws) == {-1, 1}
    assert abs(share - 0.5) < 4 * 0.5 / np.sqrt(draws.total())
    captures.set_epoch(7)
    again = StoredCaptures(dataset, "train", frames_apart=1, seed=4)
    again.set_epoch(7)
    assert [captures.second_of(n) for n in inner] == [again.second_of(n) for n in reversed(inner)][
        ::-1
    ]


def test_crops_and_mirroring_are_those_of_both(dataset: Path) -> None:
    captures = StoredCaptures(
        dataset, "train", crop=16, cut="random", augmentation=Augmentation(flip=True)
    )
    whole = StoredPairs(dataset, "train")
    for number in range(0, FRAMES, 5):
        first, second = captures[number]
        one, other = (whole[n][0].numpy() for n in (number, captures.second_of(number)))
        assert crop_places(first.numpy(), one) & crop_places(second.numpy(), other)


def test_a_frame_without_another_is_refused(tmp_path: Path) -> None:
    make(tmp_path / "single", make_settings(depth_unit_mm=0.1), make_tasks(8, 1))
    with pytest.raises(DatasetError, match=r"only frame of its sequence.*--frames-per-subject"):
        StoredCaptures(tmp_path / "single", "train")


@pytest.mark.parametrize("name", ["selfredepth-small", "sterzentsenko-small"])
def test_a_recipe_trains_on_captures_and_is_validated_with_clean_frames(
    dataset: Path, name: str
) -> None:
    recipe = load_recipe(name, ["data.crop=0", "loss.frames_apart=3", "data.validation_frames=1"])
    source = stored_batches([dataset], recipe)
    captures = StoredCaptures(dataset, "train", frames_apart=3, seed=recipe.seed)
    assert all(torch.equal(*pair) for pair in zip(source._train[5], captures[5], strict=True))
    held_out = StoredPairs(dataset, "val")
    assert torch.equal(source.validation[0][1], held_out[0][1])
    assert not torch.equal(captures[5][1], StoredPairs(dataset, "train")[5][1])
    with pytest.raises(ConfigError, match=r"two frames of a sequence.*give --data"):
        simulated_batches(recipe)
