"""Inspection of a face set: its format, people, units and problems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Final

from glsim.core.depth_frame import DepthFrame
from glsim.core.errors import ConfigError, GlsimError
from glsim.core.files.listing import entries
from glsim.data.disk_format import HEADER
from glsim.data.recordings.files import spread
from glsim.faces import open_source
from glsim.faces.face_source import BadFace, FaceKey, FaceSettings, FaceSource
from glsim.faces.meshes.alignment import Turns, describe_notes
from glsim.faces.meshes.load import load_mesh
from glsim.faces.one_mesh import OneMesh
from glsim.faces.scans.file_tree import check_root
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import load_settings
from glsim.settings.source_settings import generates, source_kinds, source_table
from glsim.settings.toml_tables import parse_table
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from glsim.simulation.plan.tasks import Task

_MAX_DEPTH: Final = 4  # levels of folders searched to recognise a format
_MAX_FOLDERS: Final = 200  # folders searched to recognise a format


@dataclass
class FaceSetReport:
    """A report of a face set: its people, frames, units and problems.

    Args:
        vertices, triangles: (smallest, largest) number in a mesh.
        placements: description of unit and axes -> number of frames.
        is_sample: whether the set generates any number of people, and these are some of them.
    """

    kind: str
    root: Path
    is_sample: bool = False
    people: dict[str, tuple[int, int]] = field(default_factory=dict)
    checked: int = 0
    vertices: tuple[int, int] = (0, 0)
    triangles: tuple[int, int] = (0, 0)
    placements: Counter[str] = field(default_factory=Counter)
    problems: Counter[str] = field(default_factory=Counter)
    usable: list[FaceKey] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Number of frames of all people."""
        return sum(frames for _, frames in self.people.values())


def recognise(path: Path) -> str:
    """Return the source kind that fits a folder. ConfigError if it is absent or a data set."""
    root = check_root(path)
    if (root / HEADER).is_file():
        raise ConfigError(f"{root}: is a data set of glsim: look at it with glsim preview")
    folders = list(islice(_folders(root, _MAX_DEPTH), _MAX_FOLDERS))
    tables = {kind: source_table(kind) for kind in source_kinds()}
    return max(
        (kind for kind, table in tables.items() if issubclass(table, FaceSettings)),
        key=lambda kind: tables[kind].likeness(root, folders),  # type: ignore[attr-defined]
    )


def open_faces(
    path: Path, unit: str = "auto", axes: str = "auto", rotation_deg: Turns | None = None
) -> tuple[str, FaceSource]:
    """Open a folder or a mesh file as (kind, source). Raises ConfigError or MeshError."""
    if path.is_file():
        loaded = load_mesh(path, unit=unit, axes=axes, rotation_deg=rotation_deg)
        return "mesh", OneMesh(loaded.mesh, path.stem, loaded.notes)
    kind = recognise(path)
    values = {"kind": kind, "root": path, "unit": unit, "axes": axes, "rotation_deg": rotation_deg}
    return kind, open_source(parse_table(source_table(kind), values, str(path)), 0)


def inspect(path: Path, kind: str, source: FaceSource, sample: int) -> FaceSetReport:
    """List all frames, and load ``sample`` frames, evenly spaced (0: all). Raises ConfigError."""
    report = FaceSetReport(kind, path, is_sample=generates(kind))
    people, frames_each = (3, 4) if report.is_sample else (None, None)
    keys: list[FaceKey] = []
    for subject in source.subjects(people):
        frames = source.frames(subject, frames_each)
        report.people[subject] = len({key.sequence for key in frames}), len(frames)
        keys += frames
    chosen = [keys[number] for number in spread(len(keys), sample or len(keys))]
    sizes: list[tuple[int, int]] = []
    for result in source.load(chosen):
        report.checked += 1
        if isinstance(result, BadFace):
            report.problems[str(result.error).replace(f"{path}/", "")] += 1
        else:
            sizes.append((len(result.mesh.vertices_mm), len(result.mesh.faces)))
            report.usable.append(result.key)
            placement, doubts = describe_notes(result.notes)
            if placement:
                report.placements[placement] += 1
            report.problems.update(f"{result.key.subject}: {doubt}" for doubt in doubts)
    if sizes:
        counts = zip(*sizes, strict=True)
        report.vertices, report.triangles = ((min(each), max(each)) for each in counts)
    return report


def preview_faces(
    source: FaceSource, keys: Sequence[FaceKey], backend: str | None = None
) -> Iterator[DepthFrame]:
    """Render frames with an ideal sensor at 0.9 m, leaving out frames that fail."""
    settings = load_settings(overrides={"sensor": "ideal"})
    seeds = ScopeSeeds(0, 0, 0)
    tasks = [Task(n, "train", key.subject, 0, key, seeds, 0) for n, key in enumerate(keys)]
    for result in simulate(settings, tasks, sources=[source], backend=backend):
        if isinstance(result, Frame):
            key = result.key
            caption = f"{key.subject} {key.sequence} {key.frame}"
            yield result.measured(caption, rounded=False)


def _folders(root: Path, depth: int) -> Iterator[Path]:
    """Yield the folders below a root, level by level."""
    level = [root]
    for _ in range(depth):
        below: list[Path] = []
        for folder in level[:_MAX_FOLDERS]:
            with suppress(GlsimError):  # an unreadable folder
                below += [folder / name for name in entries(folder, ())[1]]
        yield from below
        level = below
