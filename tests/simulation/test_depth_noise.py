"""DepthNoise in data pipelines: NumPy and PyTorch, forked and spawned workers, epochs; splits."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim import load_settings, open_dataset
from glsim.core.errors import ConfigError
from glsim.simulation.depth_noise import DepthNoise
from tests.support.dataset_fakes import make, make_settings, make_tasks

SHAPE = (40, 48)
CLEAN = np.full(SHAPE, 0.9, np.float32)


class Walls:
    """A data set of one wall, 8 times, with noise."""

    def __init__(self, noise: DepthNoise, torch: bool = False) -> None:
        self.noise, self.torch = noise, torch

    def __len__(self) -> int:
        return 8

    def __getitem__(self, number: int) -> Any:
        if not self.torch:
            return self.noise(CLEAN)
        import torch

        return self.noise(torch.from_numpy(CLEAN)[None])


def epochs(noise: DepthNoise, seed: int = 0, **loading: Any) -> list[NDArray[np.float32]]:
    """Two epochs of a DataLoader, (16, H, W)."""
    torch = pytest.importorskip("torch")
    torch.manual_seed(seed)
    loader = torch.utils.data.DataLoader(Walls(noise, torch=True), batch_size=4, **loading)
    return [batch.numpy()[:, 0] for _ in range(2) for batch in loader]


def distinct(maps: NDArray[np.float32]) -> int:
    return len({one.tobytes() for one in maps})


@pytest.mark.parametrize("backend", [None, "numpy"])
def test_each_call_draws_new_noise_and_a_seed_repeats_it(backend: str | None) -> None:
    noise = DepthNoise("kinect-v2-fankhauser", seed=3, backend=backend)
    made = np.concatenate([noise(np.stack([CLEAN] * 2)), noise(CLEAN)[None]])
    assert made.dtype == np.float32
    assert distinct(made) == 3
    error_mm = 1000 * (made - CLEAN)[made > 0]
    assert 0.3 < np.abs(error_mm).mean() < 10
    again = DepthNoise("kinect-v2-fankhauser", seed=3, backend=backend)
    np.testing.assert_array_equal(np.stack([again(CLEAN) for _ in range(3)]), made)
    other = DepthNoise("kinect-v2-fankhauser", seed=4, backend=backend)
    assert (other(CLEAN) != made[0]).any()
    np.testing.assert_array_equal(noise(CLEAN, frame=7), again(CLEAN, frame=7))


def test_p_is_the_share_of_changed_maps() -> None:
    noise = DepthNoise("kinect-v2-fankhauser", p=0.3, backend="numpy")
    small = np.full((8, 8), 0.9, np.float32)
    changed = sum(bool((noise(small) != small).any()) for _ in range(200))
    assert 40 < changed < 80  # 60 +- 3 standard deviations of 6.5
    assert DepthNoise(p=0.0)(small) is small
    for p in (-0.1, 1.1):
        with pytest.raises(ConfigError, match="is a probability"):
            DepthNoise(p=p)


def test_it_is_pickled_as_its_settings() -> None:
    noise = DepthNoise(load_settings(overrides={"sensor": "kinect-v2"}), p=0.5, seed=9)
    before = noise(CLEAN, frame=1)  # a context is open
    copy = pickle.loads(pickle.dumps(noise))
    assert repr(copy) == repr(noise) == "DepthNoise('kinect-v2', p=0.5, seed=9)"
    np.testing.assert_array_equal(copy(CLEAN, frame=1), before)


@pytest.mark.parametrize(
    "loading",
    [
        {"num_workers": 0},
        {"num_workers": 2, "multiprocessing_context": "fork"},
        pytest.param(
            {"num_workers": 2, "multiprocessing_context": "fork", "persistent_workers": True},
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"num_workers": 2, "multiprocessing_context": "spawn"}, marks=pytest.mark.long
        ),
    ],
    ids=["here", "fork", "persistent", "spawn"],
)
def test_workers_draw_new_noise_in_each_epoch(loading: dict[str, Any]) -> None:
    noise = DepthNoise("kinect-v2-fankhauser", seed=1)
    if loading.get("multiprocessing_context") == "fork":
        noise(CLEAN)  # the parent has drawn before
        noise = pickle.loads(pickle.dumps(noise))
    made = np.concatenate(epochs(noise, **loading))
    assert made.shape == (16, *SHAPE)
    assert distinct(made) == 16
    fresh = DepthNoise("kinect-v2-fankhauser", seed=1)
    np.testing.assert_array_equal(np.concatenate(epochs(fresh, **loading)), made)
    if loading["num_workers"]:
        other = DepthNoise("kinect-v2-fankhauser", seed=1)
        assert (np.concatenate(epochs(other, seed=5, **loading)) != made).any()


def test_a_split_makes_batches_as_it_stands(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    make(tmp_path / "data", make_settings(), make_tasks(4, 3))
    split = open_dataset(tmp_path / "data").split("train")
    loader = torch.utils.data.DataLoader(split, batch_size=4, shuffle=True)
    batches = list(loader)
    found = [
        key
        for batch in batches
        for key in zip(batch["subject"], batch["frame"].tolist(), strict=True)
    ]
    assert sorted(found) == sorted((pair.key.subject, pair.key.frame) for pair in split)
    batch = batches[0]
    height, width = split[0].noisy_mm.shape
    for name in ("clean_mm", "noisy_mm"):
        assert batch[name].shape == (4, height, width)
        assert batch[name].dtype == torch.float32
    assert len(batch["subject"]) == 4
    by_key = {(pair.key.subject, pair.key.frame): pair for pair in split}
    for row, key in enumerate(zip(batch["subject"], batch["frame"].tolist(), strict=True)):
        expected = by_key[key].noisy_mm
        np.testing.assert_array_equal(batch["noisy_mm"][row].numpy(), expected)


def test_a_pair_is_a_mapping_of_what_it_has(tmp_path: Path) -> None:
    make(tmp_path / "data", make_settings(), make_tasks(1, 2))
    pair, other = open_dataset(tmp_path / "data")
    assert pair.keys() >= {"clean_mm", "noisy_mm", "subject", "sequence", "frame"}
    assert dict(pair)["subject"] == pair.key.subject
    assert "record" not in pair
    with pytest.raises(KeyError):
        pair["regions"]
    assert pair != other
    assert pair == pair  # without comparing arrays
    assert len({pair, other}) == 2
