"""Face sources: where the meshes come from. One file or package a source."""

from __future__ import annotations

from typing import TYPE_CHECKING

from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.config import SourceSettings
    from glsim.faces.base import FaceSource


def open_source(settings: SourceSettings, seed: int) -> FaceSource:
    """The source that ``settings.kind`` names. Raises ConfigError."""
    if settings.kind == "procedural":
        from glsim.faces.procedural import ProceduralFaces

        return ProceduralFaces(seed)
    if settings.root is None:
        raise ConfigError(f"source {settings.kind!r} needs --root: the folder that holds its files")
    if settings.kind == "ict-facekit":
        from glsim.faces.ict_facekit import IctFaceKit

        return IctFaceKit(settings.root, seed)
    from glsim.faces.folder import Folder

    return Folder(settings.root, unit=settings.unit, axes=settings.axes)
