"""Captions that name a data set's face sources, and those of the paper that it lacks."""

from __future__ import annotations

from collections import Counter

from glsim.data.reader import Dataset
from glsim.simulation.plan.paper_sources import PAPER_SOURCES, STAND_IN, missing_counts

_NAMES = {STAND_IN: "embedded heads", **{kind: s.name for kind, s in PAPER_SOURCES.items()}}


def data_note(dataset: Dataset) -> str:
    """Describe a data set in a caption: sources, numbers of frames, absent face sets, sensor."""
    counts = Counter(str(pair.record["source"]) for pair in dataset)
    sources = ", ".join(f"{source_name(kind)} ({count:,})" for kind, count in counts.items())
    note = f"Frames: {sources}."
    others = " and ".join(source_name(kind) for kind in counts if kind not in PAPER_SOURCES)
    missing = missing_counts(counts)
    if others and missing:
        lacks = ", ".join(f"{PAPER_SOURCES[kind].name} ({n:,})" for kind, n in missing.items())
        note += f" In place of {lacks}: {others}."
    return f"{note} Sensor: {dataset.sensor_title}."


def source_name(kind: str) -> str:
    """Return the name that captions use for a kind of face source."""
    return _NAMES.get(kind, kind)
