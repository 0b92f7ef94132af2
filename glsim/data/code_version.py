"""The version of glsim with a hash of the code that decides the bytes of a data set.

Two checkouts of one version number may make different frames of a seed. Commands, training,
scoring, documentation, and reading of data sets decide no byte and are not hashed.
"""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Final

#: Packages and modules of glsim that decide the bytes of frames and of their records.
DECIDING: Final = (
    *("core", "faces", "gl", "looks", "noise", "render", "sensors", "settings", "shaders"),
    *("simulation", "core.files.png", "data.chunk_writer", "data.chunks", "data.records"),
)
_SUFFIXES: Final = (".py", ".glsl", ".frag", ".vert", ".npz", ".toml")


@cache
def code_version() -> str:
    """Return the version of glsim and a hash of its deciding code, such as "0.3.0+1f2e3d4c"."""
    digest = hashlib.blake2b(digest_size=4)
    for room in DECIDING:
        spec = find_spec(f"glsim.{room}")
        assert spec is not None
        folders = map(Path, spec.submodule_search_locations or ())
        files = [path for folder in folders for path in folder.rglob("*") if _decides(room, path)]
        for path in sorted(files) or [Path(str(spec.origin))]:
            data = path.read_bytes()
            digest.update(f"{room} {path.name} {len(data)} ".encode() + data)
    return f"{version('glsim')}+{digest.hexdigest()}"


def _decides(room: str, path: Path) -> bool:
    """Whether a file of a room decides bytes; the identity holds sensors and presets by value."""
    if path.suffix == ".toml" and (room == "sensors" or path.parent.name == "presets"):
        return False
    return path.suffix in _SUFFIXES and (room != "core" or path.parent.name == "core")
