"""Captions that say what was run: plan, people, images, absent face sets, sensor, trainings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from glsim.core.errors import counted
from glsim.core.files.atomic import read_json
from glsim.data.disk_format import HEADER
from glsim.data.reader import open_dataset
from glsim.eval.scoring.trained_networks import TrainedRun, steps_text
from glsim.simulation.plan.paper_sources import PAPER_SOURCES, STAND_IN, missing_counts

_NAMES = {STAND_IN: "embedded heads", **{kind: s.name for kind, s in PAPER_SOURCES.items()}}
#: File of a reproduction's folder that names its plan.
PLAN_FILE: Final = "plan.json"


def plan_size(folder: Path) -> str:
    """Return the end of a title that names the plan of a reproduction: ", small"; "" if unknown."""
    file = folder / PLAN_FILE
    return f", {read_json(file)['size']}" if file.is_file() else ""


def run_note(data: Path, runs: Sequence[TrainedRun] = ()) -> str:
    """Describe a data set and the trainings on it in a caption; a folder of files has no note."""
    if not (data / HEADER).is_file():
        return ""
    dataset = open_dataset(data)
    counts = Counter(str(pair.record["source"]) for pair in dataset)
    people = Counter(split for split, _ in {(p.record["split"], p.key.subject) for p in dataset})
    frames = dataset.header["frames"]
    note = "; ".join(
        f"{name}: {counted(count, 'image')} of {counted(people[name], 'person', 'people')}"
        for name, count in frames.items()
        if count
    )
    note += f". Faces: {', '.join(f'{source_name(kind)} ({n:,})' for kind, n in counts.items())}."
    others = " and ".join(source_name(kind) for kind in counts if kind not in PAPER_SOURCES)
    missing = missing_counts(counts)
    if others and missing:
        lacks = ", ".join(f"{PAPER_SOURCES[kind].name} ({n:,})" for kind, n in missing.items())
        note += f" In place of {lacks}: {others}."
    note += f" Sensor: {dataset.sensor_title}."
    if runs:
        seeds = ", ".join(map(str, sorted({run.seed for run in runs})))
        hours = sum(run.seconds for run in runs) / 3600
        note += f" {len(runs)} trainings (seeds {seeds}) of {steps_text(runs)}, {hours:.2g} h."
    return note


def source_name(kind: str) -> str:
    """Return the name that captions use for a kind of face source."""
    return _NAMES.get(kind, kind)
