"""Mix several face sources: choose which of their frames a data set uses, by count or by weight."""

from __future__ import annotations

from collections.abc import Sequence

from glsim.errors import ConfigError
from glsim.faces.base import FaceKey
from glsim.settings.schema import SourceSettings


def mix_sources(
    sources: Sequence[SourceSettings], frames: Sequence[tuple[int, list[FaceKey]]]
) -> list[list[FaceKey]]:
    """Choose the frames of each person, thinned evenly over each source.

    frames: (number of the source, frames) of each person. Raises ConfigError as ``image_counts``.
    """
    available = [sum(len(k) for n, k in frames if n == number) for number in range(len(sources))]
    counts = image_counts(sources, available)
    seen = [0] * len(sources)
    chosen = []
    for number, keys in frames:
        total, count = available[number], counts[number]
        start = seen[number]
        # The condition is true ``count`` times in ``total``, at even distances.
        kept = [
            key
            for at, key in enumerate(keys, start)
            if (at + 1) * count // total > at * count // total
        ]
        seen[number] += len(keys)
        chosen.append(kept)
    return chosen


def image_counts(sources: Sequence[SourceSettings], available: Sequence[int]) -> list[int]:
    """Return the number of images from each source, by its count, its weight, or all it has.

    The scarcest of the weighted sources limits the images that they share. Raises ConfigError for
    a count above the available images, and for a source without weight or count beside a weighted
    one.
    """
    weighted = any(source.weight for source in sources)
    for number, (source, images) in enumerate(zip(sources, available, strict=True)):
        name = f"source {number} ({source.kind})"
        if source.count is not None and source.count > images:
            raise ConfigError(f"{name}: count = {source.count}, but it has {images} images")
        if weighted and source.weight is None and source.count is None:
            raise ConfigError(f"{name}: give it a weight or a count, as other sources have")
    pairs = list(zip(sources, available, strict=True))
    total = min((images / s.weight for s, images in pairs if s.weight is not None), default=0.0)
    return [
        s.count or (images if s.weight is None else round(total * s.weight)) for s, images in pairs
    ]
