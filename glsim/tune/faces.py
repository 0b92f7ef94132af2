"""The faces that a page shows, and the command that makes the same frames."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from glsim.faces.base import FaceSource
from glsim.faces.one_mesh import OneMesh
from glsim.meshio.load import load_mesh
from glsim.pipeline import open_sources
from glsim.settings.distribution import Distribution
from glsim.settings.schema import Settings, parse_assignment
from glsim.settings.source_settings import parse_source

#: Frames of one mesh: the same surface with other noise.
_MESH_FRAMES = 30


def opener(
    settings: Settings, face: Path | None
) -> tuple[Settings, Callable[[Settings], Sequence[FaceSource]]]:
    """Return settings with a plan of frames, and the function that opens their face sources.

    Args:
        face: a mesh file that replaces the source of ``settings``.

    Raises:
        MeshError: ``face`` cannot be read.
    """
    if face is None:
        return settings, open_sources
    loaded = load_mesh(face)
    source = OneMesh(loaded.mesh, face.stem, loaded.notes)
    single = parse_source({"subjects": 1, "frames_per_subject": _MESH_FRAMES})
    return settings.model_copy(update={"source": (single,)}), lambda _: [source]


def as_values(settings: Settings, assignments: Sequence[str]) -> tuple[Settings, dict[str, Any]]:
    """Split settings into fixed ones and values that the page shows as changed.

    Changed values are those of the rig and the stages, and ``--set`` of the pose and the scene.
    """
    values: dict[str, Any] = {f"rig.{key}": value for key, value in settings.rig.items()}
    for stage, own in settings.stage.items():
        values |= {f"{stage}.{name}": plain_value(setting) for name, setting in own.items()}
    for text in assignments:
        path, value = parse_assignment(text)
        if path[0] in ("pose", "scene") and len(path) == 2:
            values[".".join(path)] = value
    return settings.model_copy(update={"rig": {}, "stage": {}}), values


def plain_value(setting: Distribution) -> Any:
    """Return a setting as ``--set`` has it: a number, or a table."""
    if setting.constant is not None:
        return setting.constant
    table = setting.model_dump(exclude_none=True, exclude_defaults=True)
    return {k: list(v) if isinstance(v, tuple) else v for k, v in table.items()}


def face_command(
    face: Path | None,
    source: str | None,
    root: Path | None,
    preset: str | None = None,
    config: Path | None = None,
    seed: int | None = None,
) -> str:
    """Return the beginning of the command line that makes the same frames."""
    words = ["glsim", "generate", "-o", "data"] if face is None else ["glsim", "render", str(face)]
    options = {
        "--source": source, "--root": root, "--preset": preset, "--config": config, "--seed": seed,
    }  # fmt: skip
    for name, value in options.items():
        if value is not None:
            words += [name, str(value)]
    return shlex.join(words)
