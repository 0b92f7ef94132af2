"""How many images each of several sources gives: by count, by weight, or all it has."""

from __future__ import annotations

from collections.abc import Sequence

from glsim.config import SourceSettings
from glsim.errors import ConfigError
from glsim.faces.base import FaceKey


def mixed(
    sources: Sequence[SourceSettings], frames: Sequence[tuple[int, list[FaceKey]]]
) -> list[list[FaceKey]]:
    """The frames of each person that are taken, thinned evenly over all of a source.

    frames: (number of the source, frames) of each person. Raises ConfigError as ``wanted`` does.
    """
    available = [sum(len(k) for n, k in frames if n == number) for number in range(len(sources))]
    counts = wanted(sources, available)
    seen = [0] * len(sources)
    taken = []
    for number, keys in frames:
        have, some = available[number], counts[number]
        start = seen[number]
        # True ``some`` times in ``have``, at even distances.
        kept = [
            key for at, key in enumerate(keys, start) if (at + 1) * some // have > at * some // have
        ]
        seen[number] += len(keys)
        taken.append(kept)
    return taken


def wanted(sources: Sequence[SourceSettings], available: Sequence[int]) -> list[int]:
    """Images from each source. Weights share as many as the scarcest of the weighted ones allows.

    Raises ConfigError for a count that a source does not have, and for a source that has neither
    weight nor count beside one with a weight.
    """
    weighted = any(source.weight for source in sources)
    for number, (source, have) in enumerate(zip(sources, available, strict=True)):
        name = f"source {number} ({source.kind})"
        if source.count is not None and source.count > have:
            raise ConfigError(f"{name}: count = {source.count}, but it has {have} images")
        if weighted and source.weight is None and source.count is None:
            raise ConfigError(f"{name}: give it a weight or a count, as other sources have")
    pairs = list(zip(sources, available, strict=True))
    total = min((have / s.weight for s, have in pairs if s.weight is not None), default=0.0)
    return [s.count or (have if s.weight is None else round(total * s.weight)) for s, have in pairs]
