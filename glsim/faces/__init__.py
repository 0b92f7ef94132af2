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
    root, unit, axes = settings.root, settings.unit, settings.axes
    if settings.kind == "d3dfacs":
        from glsim.faces.d3dfacs import D3dfacs

        every, peak_only = settings.every or 1, bool(settings.peak_only)
        return D3dfacs(root, unit=unit, axes=axes, every=every, peak_only=peak_only)
    if settings.kind == "facewarehouse":
        from glsim.faces.facewarehouse import FaceWarehouse

        steps, poses = settings.steps or 1, settings.poses is not False
        return FaceWarehouse(root, unit=unit, axes=axes, steps=steps, poses=poses)
    if settings.kind == "biwi":
        from glsim.faces.biwi import Biwi

        return Biwi(root, unit=unit, axes=axes, every=settings.every or 1)
    from glsim.faces.folder import Folder

    return Folder(root, unit=unit, axes=axes)
