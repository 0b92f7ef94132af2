"""Mix several face sources: choose which of their frames a data set uses, by count or by weight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from glsim.core.errors import ConfigError
from glsim.settings.source_settings import SourceSettings


@dataclass(frozen=True)
class Thinning:
    """``count`` of the ``total`` frames of a source, at even distances."""

    total: int
    count: int

    def below(self, position: int) -> int:
        """Return how many of the first ``position`` frames are chosen."""
        return position * self.count // self.total if self.total else 0

    def position(self, number: int) -> int:
        """Return where the chosen frame of this number is among all frames, both from 0."""
        return -(-(number + 1) * self.total // self.count) - 1


def mix_sources(sources: Sequence[SourceSettings], available: Sequence[int]) -> list[Thinning]:
    """Choose the frames of each source.

    Raises ConfigError as ``image_counts``.

    Args:
        available: number of frames of each source.
    """
    counts = image_counts(sources, available)
    return [Thinning(total, count) for total, count in zip(available, counts, strict=True)]


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
