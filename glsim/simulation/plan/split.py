"""Assignment of subjects to train, val and test: by shares, or by the paper's image counts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from glsim.core.array_types import Array, Whole
from glsim.core.seeds import stable_seed
from glsim.settings.schema import SPLIT_NAMES

#: Training, validation and test images of Kendrick, Yap and Tan.
PAPER_IMAGES: Final = (32_029, 5_503, 8_406)

_MAX_EXACT_PEOPLE: Final = 9  # for up to 9 people all 3**9 divisions are tried


def split_subjects(
    subjects: list[str], shares: tuple[float, float, float], seed: int
) -> dict[str, str]:
    """Assign subjects to splits by shares, in a seeded random order: subject -> split.

    With at least as many subjects as non-zero shares, every split with a share gets a subject.
    """
    wanted = [share * len(subjects) for share in shares]
    counts = [int(w) for w in wanted]
    by_remainder = sorted(range(len(shares)), key=lambda s: (counts[s] - wanted[s], s))
    for s in by_remainder[: len(subjects) - sum(counts)]:
        counts[s] += 1
    nonzero = [s for s in range(len(shares)) if shares[s] > 0]
    if len(subjects) >= len(nonzero):
        for s in nonzero:
            if counts[s] == 0:
                counts[counts.index(max(counts))] -= 1
                counts[s] = 1
    order = sorted(subjects, key=lambda name: stable_seed("split", seed, name))
    names = [SPLIT_NAMES[s] for s in range(len(shares)) for _ in range(counts[s])]
    return dict(zip(order, names, strict=True))


def split_as_paper(frames: Mapping[str, int], seed: int) -> dict[str, str]:
    """Assign subjects to splits near the paper's image counts: subject -> split.

    ``frames`` is subject -> number of frames. The targets are the paper's image counts, scaled to
    the total. For up to nine people the sum of the three differences is minimal; for more people,
    no move of one person and no swap of two lowers it. With three people or more no split is empty.
    ``seed`` breaks ties.
    """
    names = sorted(frames, key=lambda name: (-frames[name], stable_seed("split", seed, name)))
    sizes = np.array([frames[name] for name in names], dtype=np.int64)
    target = np.array(PAPER_IMAGES) / sum(PAPER_IMAGES) * sizes.sum()
    search = _search_all if len(names) <= _MAX_EXACT_PEOPLE else _search_locally
    chosen = search(sizes, target)
    return {name: SPLIT_NAMES[split] for name, split in zip(names, chosen, strict=True)}


def _search_all(sizes: Whole, target: Array) -> Sequence[int]:
    """Return the split number of each person in the best of all possible assignments."""

    def cost(chosen: tuple[int, ...]) -> tuple[int, float]:
        empty = 3 - len(set(chosen)) if len(sizes) >= 3 else 0
        images = [0.0, 0.0, 0.0]
        for split, size in zip(chosen, size_list, strict=True):
            images[split] += size
        return empty, sum(abs(i - t) for i, t in zip(images, target_list, strict=True))

    size_list, target_list = sizes.tolist(), target.tolist()
    return min(itertools.product(range(3), repeat=len(size_list)), key=cost)


def _search_locally(sizes: Whole, target: Array) -> Sequence[int]:
    """Assign people greedily, largest first; then move or swap people while this improves it."""
    images = np.zeros(3)
    chosen = np.zeros(len(sizes), np.int64)
    for person, size in enumerate(sizes):
        chosen[person] = int(np.argmax(target - images))
        images[chosen[person]] += size
    while True:
        swaps = (_best_swap(sizes, target - images, chosen, a, b) for a, b in _PAIRS)
        change, moves = min(swaps, key=lambda swap: swap[0])
        if change > -1e-6:
            return [int(split) for split in chosen]
        for person, split in moves:
            images[chosen[person]] -= sizes[person]
            images[split] += sizes[person]
            chosen[person] = split


_PAIRS: Final = tuple(itertools.combinations(range(3), 2))


def _best_swap(
    sizes: Whole, missing: Array, chosen: Whole, a: int, b: int
) -> tuple[float, list[tuple[int, int]]]:
    """Return the best swap of splits a and b: its cost change and [(person, new split)]."""
    persons_a, persons_b = (np.flatnonzero(chosen == split) for split in (a, b))
    # Of people with equally many images one is enough. The last entry is nobody: a swap is a move.
    from_a, from_b = (
        np.append(who[np.sort(np.unique(sizes[who], return_index=True)[1])], -1)
        for who in (persons_a, persons_b)
    )
    images_a, images_b = (np.where(who < 0, 0, sizes[who]) for who in (from_a, from_b))
    moved = images_a[:, None] - images_b[None]
    change = np.abs(missing[a] + moved) + np.abs(missing[b] - moved)
    change = change - abs(missing[a]) - abs(missing[b])
    if len(persons_a) == 1:
        change[0, -1] = 0.0  # the last person of a split stays
    if len(persons_b) == 1:
        change[-1, 0] = 0.0
    i, j = np.unravel_index(np.argmin(change), change.shape)
    moves = [
        (int(person), split) for person, split in ((from_a[i], b), (from_b[j], a)) if person >= 0
    ]
    return float(change[i, j]), moves
