"""Cloth on whole people: it covers torso and legs, follows the posture, and leaves hands free."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from glsim.appearance.anatomy import Anatomy
from glsim.appearance.binding import skull_motion
from glsim.appearance.cloth import GARMENTS, fit_cloth, make_cloth, make_cloth_grid, make_trousers
from glsim.appearance.dress import Dresser
from glsim.faces.base import Face
from tests.support.people import needs_anny
from tests.support.wardrobe import ALL, appearance, keys

pytestmark = needs_anny


@lru_cache(maxsize=1)
def people():  # type: ignore[no-untyped-def]
    from glsim.faces.people import People

    return People(seed=3)


@lru_cache(maxsize=1)
def body() -> Anatomy:
    source = people()
    vertices, faces = source.neutral("a0002")
    return Anatomy(source.name, vertices, faces, source.regions, source.region_names)


def covered(points: np.ndarray, region: str) -> float:
    """Share of a region's vertices with cloth within 80 mm."""
    own = body().vertices_mm[body().is_in(region)][::9]
    gaps = np.linalg.norm(own[:, None] - points[None, ::3], axis=2).min(axis=1)
    return float((gaps < 80).mean())


@pytest.mark.parametrize("garment", GARMENTS, ids=lambda g: g.name)
def test_garments_cover_the_torso_and_their_share_of_the_arms(garment) -> None:  # type: ignore[no-untyped-def]
    grid = make_cloth_grid(body())
    assert grid is not None
    made = make_cloth(fit_cloth(grid, body().vertices_mm), garment, 1.0, 5)
    assert made is not None
    still = skull_motion(body().vertices_mm[:3], body().vertices_mm[:3])
    points = made[0].place(body().vertices_mm, still)
    assert np.isfinite(points).all()
    assert covered(points, "torso") > 0.85
    assert covered(points, "hand") < 0.25
    assert covered(points, "arm") == pytest.approx(garment.sleeve, abs=0.35)


def test_trousers_reach_the_feet() -> None:
    grid = make_cloth_grid(body())
    assert grid is not None
    made = make_trousers(fit_cloth(grid, body().vertices_mm), 0.96, 5)
    assert made is not None
    still = skull_motion(body().vertices_mm[:3], body().vertices_mm[:3])
    assert covered(made[0].place(body().vertices_mm, still), "leg") > 0.9


def test_cloth_lies_over_the_skin_in_a_posture() -> None:
    """Every point of the cloth of a posed frame is within 60 mm of the posed skin."""
    source = people()
    there = Dresser(source, appearance(**{**ALL, "wear": "auto"}))
    face = next(iter(source.load(source.frames("a0002", 1))))
    assert isinstance(face, Face)
    dressed = there.dress(face, keys(2))
    skin = face.mesh.vertices_mm[body().body][::4]
    for part in dressed.parts:
        if part.region == "cloth":
            points = part.mesh.vertices_mm[::25]
            gaps = np.linalg.norm(points[:, None] - skin[None], axis=2).min(axis=1)
            assert np.percentile(gaps, 95) < 60


def test_people_are_dressed_by_default() -> None:
    assert Dresser(people(), appearance()).is_on
    assert not Dresser(people(), appearance(wear="never")).is_on


def test_skin_under_cloth_is_left_out_but_for_the_rims() -> None:
    source = people()
    face = next(iter(source.load(source.frames("a0002", 1))))
    assert isinstance(face, Face)
    dressed = Dresser(source, appearance(**ALL)).dress(face, keys(2))
    bare = Dresser(source, appearance(**{**ALL, "cloth": 0})).dress(face, keys(2))
    assert bare.mesh.faces is face.mesh.faces
    left = np.zeros(len(face.mesh.vertices_mm), bool)
    left[dressed.mesh.faces] = True
    assert left[body().is_in("hand", "ear", "nose", "lips")].all()
    assert left[body().is_in("torso")].mean() < 0.6
    # Nor does skin under cloth cast shadows: its fewer triangles would stick out of the cloth.
    assert bare.mesh.occluder is face.mesh.occluder
    assert face.mesh.occluder is not None
    assert dressed.mesh.occluder is not None
    assert len(dressed.mesh.occluder) < 0.8 * len(face.mesh.occluder)
    casts = np.zeros(len(face.mesh.vertices_mm), bool)
    casts[dressed.mesh.occluder] = True
    assert casts[body().is_in("torso")].mean() < 0.5 * casts[body().is_in("nose")].mean()
