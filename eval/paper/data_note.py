"""The sources of heads of a reproduction, in a sentence for every caption."""

from __future__ import annotations

from collections import Counter

from glsim.dataset import Dataset
from glsim.plan.paper_sources import PAPER_SOURCES, STAND_IN, missing_counts

_NAMES = {STAND_IN: "embedded heads", **{kind: s.name for kind, s in PAPER_SOURCES.items()}}


def data_note(dataset: Dataset) -> str:
    """Name the face sources of a data set, their frames, and the sets that they replace."""
    held = Counter(str(pair.record["source"]) for pair in dataset)
    sources = ", ".join(f"{source_name(kind)} ({count:,})" for kind, count in held.items())
    note = f"Frames: {sources}."
    others = " and ".join(source_name(kind) for kind in held if kind not in PAPER_SOURCES)
    missing = missing_counts(held)
    if others and missing:
        lacks = ", ".join(f"{PAPER_SOURCES[kind].name} ({n:,})" for kind, n in missing.items())
        note += f" In place of {lacks}: {others}."
    return f"{note} Sensor: {dataset.sensor_title}."


def source_name(kind: str) -> str:
    """Return the name of a face source in captions."""
    return _NAMES.get(kind, kind)
