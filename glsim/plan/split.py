"""Assign subjects to train, val and test."""

from __future__ import annotations

from glsim.plan.paper_split import split_as_paper
from glsim.settings.schema import SPLIT_NAMES, Settings
from glsim.settings.seeds import stable_seed


def assign_splits(settings: Settings, frames: dict[str, int]) -> dict[str, str]:
    """Return subject -> split by the setting ``split``.

    Args:
        frames: subject -> number of images.
    """
    if isinstance(settings.split, str):
        return split_as_paper(frames, settings.seed)
    return split_subjects(list(frames), settings.split, settings.seed)


def split_subjects(
    subjects: list[str], shares: tuple[float, float, float], seed: int
) -> dict[str, str]:
    """Split subjects by the largest remainder of the shares, in a seeded order: subject -> split.

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
