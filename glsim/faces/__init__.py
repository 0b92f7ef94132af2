"""Faces: the face sources, one file each in ``sources``, with their models and readers."""

from __future__ import annotations

from glsim.core.errors import ConfigError
from glsim.faces.face_source import FaceSettings, FaceSource
from glsim.settings.source_settings import SourceSettings


def open_source(settings: SourceSettings, seed: int) -> FaceSource:
    """Open the source of a [[source]] table. Raises ConfigError if it fails or holds no faces."""
    if not isinstance(settings, FaceSettings):
        raise ConfigError(f"source {settings.kind!r} declares no faces")
    return settings.open(seed)
