"""Face sources: suppliers of face meshes, one file or package per source."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.faces.base import FaceSource
    from glsim.settings.schema import SourceSettings

#: Frames of a generated sequence, unless the settings say otherwise.
DEFAULT_SEQUENCE: Final = 30


def open_source(settings: SourceSettings, seed: int) -> FaceSource:
    """Open the source that ``settings.kind`` names; ``seed`` is used by generated faces only.

    Raises ConfigError.
    """
    timing = settings.frames_per_sequence or DEFAULT_SEQUENCE, settings.frames_per_second
    if settings.kind == "procedural":
        from glsim.faces.procedural import ProceduralFaces

        return ProceduralFaces(seed, *timing)
    if settings.kind == "people":
        from glsim.faces.people import People

        return People(seed, *timing, framing=settings.framing or "face")
    if settings.root is None:
        raise ConfigError(f"source {settings.kind!r} needs --root: the folder with its files")
    if settings.kind == "ict-facekit":
        from glsim.faces.ict_facekit import IctFaceKit

        return IctFaceKit(settings.root, seed, *timing)
    if settings.kind == "kinect2":
        raise ConfigError("source 'kinect2' holds recorded frames, no faces: glsim import kinect2")
    root, unit, axes = settings.root, settings.unit, settings.axes
    if settings.kind == "d3dfacs":
        from glsim.faces.scans.d3dfacs import D3dfacs

        every, peak_only = settings.every or 1, bool(settings.peak_only)
        return D3dfacs(root, unit=unit, axes=axes, every=every, peak_only=peak_only)
    if settings.kind == "facewarehouse":
        from glsim.faces.scans.facewarehouse import FaceWarehouse

        steps, poses = settings.steps or 1, settings.poses is not False
        return FaceWarehouse(root, unit=unit, axes=axes, steps=steps, poses=poses)
    if settings.kind == "biwi":
        from glsim.faces.scans.biwi import Biwi

        return Biwi(root, unit=unit, axes=axes, every=settings.every or 1)
    from glsim.faces.scans.folder import Folder

    return Folder(root, unit=unit, axes=axes)
