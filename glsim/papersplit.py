"""The paper's split: people divided so that the images come near its 32,029 / 5,503 / 8,406."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.config import SPLIT_NAMES
from glsim.stable import stable_seed

PAPER_IMAGES: Final = (32_029, 5_503, 8_406)
"""Training, validation and test images of Kendrick, Yap and Tan."""

_EXACT: Final = 9  # people: 3**9 divisions are tried in full


def split_as_paper(frames: Mapping[str, int], seed: int) -> dict[str, str]:
    """Subject -> split, each person in one, by their numbers of images.

    The images are as near as can be found to the paper's numbers, scaled to their total: the sum
    of the three differences is minimal for up to nine people; for more, neither moving a person
    nor swapping two lowers it. Three people or more leave no split empty. ``seed`` breaks ties.
    """
    names = sorted(frames, key=lambda name: (-frames[name], stable_seed("split", seed, name)))
    sizes = np.array([frames[name] for name in names], dtype=np.int64)
    target = np.array(PAPER_IMAGES) / sum(PAPER_IMAGES) * sizes.sum()
    chosen = _exact(sizes, target) if len(names) <= _EXACT else _descent(sizes, target)
    return {name: SPLIT_NAMES[split] for name, split in zip(names, chosen, strict=True)}


def _exact(sizes: NDArray[np.int64], target: NDArray[np.float64]) -> Sequence[int]:
    def cost(chosen: tuple[int, ...]) -> tuple[int, float]:
        empty = 3 - len(set(chosen)) if len(sizes) >= 3 else 0
        have = [0.0, 0.0, 0.0]
        for split, size in zip(chosen, listed, strict=True):
            have[split] += size
        return empty, sum(abs(h - t) for h, t in zip(have, wanted, strict=True))

    listed, wanted = sizes.tolist(), target.tolist()
    return min(itertools.product(range(3), repeat=len(listed)), key=cost)


def _descent(sizes: NDArray[np.int64], target: NDArray[np.float64]) -> Sequence[int]:
    """Largest first into the emptiest split, then the best move or swap until none helps."""
    have = np.zeros(3)
    chosen = np.zeros(len(sizes), np.int64)
    for person, size in enumerate(sizes):
        chosen[person] = int(np.argmax(target - have))
        have[chosen[person]] += size
    while True:
        gain, moves = min(
            (_best_swap(sizes, target - have, chosen, a, b) for a, b in _PAIRS),
            key=lambda found: found[0],
        )
        if gain > -1e-6:
            return [int(split) for split in chosen]
        for person, split in moves:
            have[chosen[person]] -= sizes[person]
            have[split] += sizes[person]
            chosen[person] = split


_PAIRS: Final = tuple(itertools.combinations(range(3), 2))


def _best_swap(
    sizes: NDArray[np.int64], lack: NDArray[np.float64], chosen: NDArray[np.int64], a: int, b: int
) -> tuple[float, list[tuple[int, int]]]:
    """Change of the sum of differences by the best swap of splits a and b: (person, split)s."""
    # The last of each list stands for nobody: swapping with nobody is a move.
    one, other = (np.append(np.flatnonzero(chosen == split), -1) for split in (a, b))
    out, back = (np.where(who < 0, 0, sizes[who]) for who in (one, other))
    moved = out[:, None] - back[None]
    change = np.abs(lack[a] + moved) + np.abs(lack[b] - moved) - abs(lack[a]) - abs(lack[b])
    if len(one) == 2:
        change[0, -1] = 0.0  # the last person stays
    if len(other) == 2:
        change[-1, 0] = 0.0
    i, j = np.unravel_index(np.argmin(change), change.shape)
    moves = [(int(person), split) for person, split in ((one[i], b), (other[j], a)) if person >= 0]
    return float(change[i, j]), moves
