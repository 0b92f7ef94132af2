"""The paper's face sets in the paper's proportions; embedded heads replace missing sets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from glsim.core.errors import ConfigError
from glsim.faces import open_source
from glsim.settings.source_settings import parse_source
from glsim.simulation.plan.split import PAPER_IMAGES


class PaperSource(NamedTuple):
    """A face set of the paper: its name, number of people, and number of images."""

    name: str
    people: int
    images: int


#: Kind of source -> its face set. The paper prints the numbers of people, and for FaceWarehouse 19
#: expressions each, without a neutral face: the set has 19 such poses, and 46 blend shapes. It does
#: not print how its images are divided. Biwi: all images of the published set. D3DFACS: the rest.
PAPER_SOURCES: Final = {
    "d3dfacs": PaperSource("D3DFACS", 10, sum(PAPER_IMAGES) - 150 * 19 - 15_678),
    "facewarehouse": PaperSource("FaceWarehouse", 150, 150 * 19),
    "biwi": PaperSource("Biwi", 20, 15_678),
}
#: The kind of source that replaces missing sets.
STAND_IN: Final = "procedural"
#: Kind of source -> settings of the paper's frames.
_SETTINGS: Final = {"facewarehouse": {"expressions": True}}


def paper_counts(images: int) -> dict[str, int]:
    """Divide ``images`` among source kinds in the paper's proportions, at least 1 each."""
    paper = sum(PAPER_IMAGES)
    counts = {k: max(1, round(images * s.images / paper)) for k, s in PAPER_SOURCES.items()}
    largest = max(counts, key=lambda kind: counts[kind])
    counts[largest] += images - sum(counts.values())
    return counts


def missing_counts(held: Mapping[str, int]) -> dict[str, int]:
    """Count how many images of each kind of source are missing from the paper's mix.

    ``held``: available images of each kind. A kind that lacks one image, by rounding, is left out.
    """
    wanted = paper_counts(sum(held.values()))
    lacks = {kind: count - held.get(kind, 0) for kind, count in wanted.items()}
    return {kind: count for kind, count in lacks.items() if count > min(1, held.get(kind, 0))}


def paper_mixture(roots: Mapping[str, Path], images: int) -> list[dict[str, Any]]:
    """Return the [[source]] tables of a data set of ``images`` in the paper's proportions.

    If a set has no folder in ``roots``, or fewer images than its share, embedded heads are added
    for as many people as are missing. Raises ConfigError for a folder that does not hold its set.
    """
    tables: list[dict[str, Any]] = []
    for kind, count in paper_counts(images).items():
        people, held = PAPER_SOURCES[kind].people, 0
        if kind in roots:
            root = roots[kind].resolve()
            had, available = _contents(kind, root)
            held = min(count, available)
            people = max(1, people - had)
            table = {"kind": kind, "root": str(root), "count": held}
            tables.append(table | _SETTINGS.get(kind, {}))
        if rest := count - held:
            people = min(people, rest)
            each = math.ceil(rest / people)
            tables.append(
                {"kind": STAND_IN, "subjects": people, "frames_per_subject": each, "count": rest}
            )
    return tables


def _contents(kind: str, root: Path) -> tuple[int, int]:
    """Count the people and the frames of a face set on disk, without opening its files."""
    table = {"kind": kind, "root": root} | _SETTINGS.get(kind, {})
    source = open_source(parse_source(table), 0)
    people = source.subjects(None)
    frames = sum(len(source.frames(name, None)) for name in people)
    if not frames:
        raise ConfigError(f"{root}: holds no frames of {PAPER_SOURCES[kind].name}")
    return len(people), frames
