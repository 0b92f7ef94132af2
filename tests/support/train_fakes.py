"""Small data and recipes for tests of training: domes in memory, tiny networks."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Subset

from glsim.settings.toml_tables import parse_table
from glsim.train.batches import StoredBatches
from glsim.train.data.stored import PairDataset
from glsim.train.recipe import Recipe
from tests.support.eval_scenes import dome, noisy

SIZE = (24, 24)
torch.set_num_threads(1)  # more threads are slower on images this small


class Domes(PairDataset):
    """Pairs of depth maps in memory, mirrored in odd epochs to show the effect of the epoch."""

    def __init__(self, count: int, first: int = 0) -> None:
        super().__init__()
        clean = dome(SIZE)
        self.noisy = [torch.from_numpy(noisy(clean, first + n))[None] for n in range(count)]
        self.clean = torch.from_numpy(np.ascontiguousarray(clean))[None]

    def __len__(self) -> int:
        return len(self.noisy)

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        pair = self.noisy[index], self.clean
        return (pair[0].flip(-1), pair[1].flip(-1)) if self._epoch % 2 else pair


def recipe(**tables: Any) -> Recipe:
    """Make a recipe of a tiny mask-aware network, 3 epochs; ``training={...}`` changes a table."""
    tree: dict[str, Any] = {
        "title": "tiny",
        "model": {"kind": "mask_aware", "backbone": {"kind": "dncnn", "depth": 2, "width": 4}},
        "loss": {"kind": "masked"},
        "optimiser": {"kind": "adamw", "lr": 1e-2},
        "training": {"batch": 4, "max_epochs": 3, "monitor": "loss"},
    }
    for name, table in tables.items():
        tree[name] = {**tree.get(name, {}), **table} if isinstance(table, dict) else table
    return parse_table(Recipe, tree, "tiny")


def batch_source(recipe: Recipe, count: int = 10, name: str = "domes") -> StoredBatches:
    held_out = Subset(Domes(3, first=100), range(3))
    return StoredBatches(Domes(count), held_out, {"name": name}, recipe)


def crop_places(crop: NDArray[Any], whole: NDArray[Any]) -> set[tuple[int, int, bool]]:
    """Return all places (top, left, mirrored) at which images (C, H, W) contain the crops."""
    (_, height, width), (_, rows, columns) = crop.shape, whole.shape
    return {
        (top, left, mirrored)
        for top in range(rows - height + 1)
        for left in range(columns - width + 1)
        for mirrored, image in ((False, crop), (True, crop[..., ::-1]))
        if np.array_equal(image, whole[:, top : top + height, left : left + width])
    }
