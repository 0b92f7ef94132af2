"""Dressed heads for tests: a dresser of procedural faces, and pictures of clothes."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from glsim.faces.face_source import Face, WornPart
from glsim.faces.sources.procedural import ProceduralFaces
from glsim.looks.dress import Dresser
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import AppearanceSettings, load_settings

#: Everything on everybody.
ALL = {"wear": "always", "hair": 1, "beard": 1, "brows": 1, "glasses": 1, "cloth": 1}


def appearance(**values: object) -> AppearanceSettings:
    """Return the settings [appearance] with some changed values."""
    return load_settings(overrides={"appearance": values}).appearance


@lru_cache(maxsize=1)
def heads() -> ProceduralFaces:
    """Return the shared procedural source, since making its model takes a second."""
    return ProceduralFaces(seed=4)


def dresser(**values: object) -> Dresser:
    """Return a dresser of the shared source; people wear everything unless ``values`` differ."""
    return Dresser(heads(), appearance(**{**ALL, **values}))


def frames(subject: str, count: int) -> list[Face]:
    """Return the first faces of a subject, starting with the neutral face."""
    loaded = heads().load(heads().frames(subject, count))
    return [face for face in loaded if isinstance(face, Face)]


def keys(subject: int) -> ScopeSeeds:
    """Return the seeds of a subject."""
    return ScopeSeeds(frame=1, sequence=2, subject=subject)


def part(face: Face, region: str) -> WornPart:
    """Return the first part of a region."""
    return next(p for p in face.parts if p.region == region)


def placed(face: Face) -> list[NDArray[np.float32]]:
    """Return the vertices of all parts."""
    return [p.mesh.vertices_mm for p in face.parts]
