"""What a folder or a file of faces holds: format, people, frames, units and axes, problems."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from glsim.config import ENDLESS, SourceSettings, load_settings
from glsim.dataset.layout import HEADER
from glsim.distribution import DrawKeys
from glsim.errors import ConfigError, GlsimError
from glsim.faces import open_source
from glsim.faces.base import BadFace, Face, FaceKey, FaceSource
from glsim.faces.one import OneMesh
from glsim.faces.tree import check_root, listing
from glsim.frame import Frame
from glsim.meshio import load_mesh
from glsim.pipeline import simulate
from glsim.plan import Task
from glsim.preview import Shown, of_frame

SAMPLE: Final = 40
"""Frames that are read unless told otherwise: enough for every person of most sets."""

_FACS: Final = re.compile(r"\d+[LR]?(\+\d+[LR]?)*", re.ASCII)
_DEPTH: Final = 4
_LOOK: Final = 200  # folders that are looked into to tell a format


@dataclass
class Report:
    """kind: a source's name or "mesh". people: subject -> sequences, frames.

    checked: frames that were read. vertices, triangles: of those, least and most. frames_found:
    "unit, axes" -> how many of them. problems: reason -> how many. good: those that can be shown.
    """

    kind: str
    root: Path
    people: dict[str, tuple[int, int]] = field(default_factory=dict)
    checked: int = 0
    vertices: tuple[int, int] = (0, 0)
    triangles: tuple[int, int] = (0, 0)
    placed: Counter[str] = field(default_factory=Counter)
    problems: Counter[str] = field(default_factory=Counter)
    good: list[FaceKey] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """All frames of all people."""
        return sum(frames for _, frames in self.people.values())


def recognise(path: Path) -> str:
    """The kind of source that reads a folder. Raises ConfigError for none and for a data set."""
    root = check_root(path)
    if (root / HEADER).is_file():
        raise ConfigError(f"{root}: is a data set of glsim: look at it with glsim preview")
    if (root / "generic_neutral_mesh.obj").is_file():
        return "ict-facekit"
    registrations = 0
    for number, folder in enumerate(_folders(root, _DEPTH)):
        if re.fullmatch(r"Tester_\d+", folder.name):
            return "facewarehouse"
        if re.fullmatch(r"\d\d", folder.name) and any(folder.glob("frame_*_pose.txt")):
            return "biwi"
        if _FACS.fullmatch(folder.name) and any(folder.glob("*.[op][bl][jy]")):
            registrations += 1
        if number > _LOOK:
            break
    return "d3dfacs" if registrations else "folder"


def open_path(path: Path, unit: str = "auto", axes: str = "auto") -> tuple[str, FaceSource]:
    """The kind and the source of a folder or of one mesh file. Raises ConfigError, MeshError."""
    if path.is_file():
        loaded = load_mesh(path, unit=unit, axes=axes)
        return "mesh", OneMesh(loaded.mesh, path.stem, loaded.notes)
    kind = recognise(path)
    given: dict[str, object] = {"kind": kind, "root": path}
    if kind not in ENDLESS:
        given |= {"unit": unit, "axes": axes}
    return kind, open_source(SourceSettings.model_validate(given), 0)


def inspect(path: Path, kind: str, source: FaceSource, sample: int = SAMPLE) -> Report:
    """List everything, read ``sample`` frames spread over it (0: all). Raises ConfigError."""
    report = Report(kind, path)
    people, each = (3, 4) if kind in ENDLESS else (None, None)
    keys: list[FaceKey] = []
    for subject in source.subjects(people):
        frames = source.frames(subject, each)
        report.people[subject] = len({key.sequence for key in frames}), len(frames)
        keys += frames
    chosen = keys if sample == 0 else _spread(keys, sample)
    sizes: list[tuple[int, int]] = []
    for result in source.load(chosen):
        report.checked += 1
        if isinstance(result, BadFace):
            report.problems[_without_root(str(result.error), path)] += 1
        else:
            sizes.append((len(result.mesh.vertices_mm), len(result.mesh.faces)))
            report.good.append(result.key)
            _note(report, result)
    if sizes:
        vertices, triangles = zip(*sizes, strict=True)
        report.vertices = min(vertices), max(vertices)
        report.triangles = min(triangles), max(triangles)
    return report


def pictures(
    source: FaceSource, keys: Sequence[FaceKey], backend: str | None = None
) -> Iterator[Shown]:
    """Frames as an ideal sensor sees them at 0.9 m; those that cannot be rendered are left out."""
    settings = load_settings(overrides={"sensor": "ideal"})
    tasks = [
        Task(number, "train", key.subject, 0, key, DrawKeys(0, 0, 0), 0)
        for number, key in enumerate(keys)
    ]
    for result in simulate(settings, tasks, sources=[source], backend=backend):
        if isinstance(result, Frame):
            shown = of_frame(result)
            key = result.key
            caption = f"{key.subject} {key.sequence} {key.frame}"
            yield Shown(shown.clean_m, shown.noisy_m, shown.reason, shown.intrinsics, caption)


def _note(report: Report, face: Face) -> None:
    unit, axes = face.notes.get("unit"), face.notes.get("axes")
    if unit is not None:
        how = face.notes.get("found_by_rule")
        found = " and ".join(map(str, how)) if isinstance(how, list) else ""
        rule = f" ({found} found by rule)" if found else ""
        scale = f" {face.notes['scale']}" if "scale" in face.notes else ""
        report.placed[f"unit {unit}{scale}, axes {axes}{rule}"] += 1
    doubts = face.notes.get("doubts")
    for doubt in doubts if isinstance(doubts, list) else []:
        report.problems[f"{face.key.subject}: {doubt}"] += 1


def _spread(keys: list[FaceKey], count: int) -> list[FaceKey]:
    """``count`` keys at even distances, the first and the last among them."""
    if len(keys) <= count:
        return keys
    last = len(keys) - 1
    return [keys[round(number * last / max(1, count - 1))] for number in range(count)]


def _without_root(text: str, root: Path) -> str:
    return text.replace(f"{root}/", "")


def _folders(root: Path, depth: int) -> Iterator[Path]:
    """Folders below the root, level by level."""
    level = [root]
    for _ in range(depth):
        below = []
        for folder in level:
            try:
                below += [folder / name for name in listing(folder) if (folder / name).is_dir()]
            except GlsimError:
                continue
            if len(below) > _LOOK:
                break
        yield from below
        level = below
