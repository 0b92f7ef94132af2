"""Cloth on whole people: it covers torso and legs, follows the posture, and leaves hands free."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from glsim.appearance.anatomy import Anatomy
from glsim.appearance.binding import Motion, skull_motion
from glsim.appearance.cloth import UP, ClothBody, fit_cloth, make_cloth_grid
from glsim.appearance.dress import Dresser
from glsim.appearance.garments import GARMENTS, LOWERS, Lower
from glsim.appearance.tailor import make_garment, make_lower
from glsim.faces.base import Face
from tests.support.people import needs_anny
from tests.support.wardrobe import ALL, appearance, keys

pytestmark = needs_anny


@lru_cache(maxsize=1)
def people():  # type: ignore[no-untyped-def]
    from glsim.faces.people.source import People

    return People(seed=3)


@lru_cache(maxsize=1)
def body() -> Anatomy:
    source = people()
    vertices, faces = source.neutral("a0002")
    return Anatomy(source.name, vertices, faces, source.regions, source.region_names)


@lru_cache(maxsize=1)
def fitted() -> ClothBody:
    grid = make_cloth_grid(body())
    assert grid is not None
    return fit_cloth(grid, body().vertices_mm)


def still() -> Motion:
    return skull_motion(body().vertices_mm[:3], body().vertices_mm[:3])


def worn_points(made) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Where cloth lies on the body at rest."""
    assert made is not None
    return made[0].place(body().vertices_mm, still())


def lower(name: str) -> Lower:
    return next(one for one in LOWERS if one.name == name)


def covered(points: np.ndarray, region: str) -> float:
    """Share of a region's vertices with cloth within 80 mm."""
    own = body().vertices_mm[body().is_in(region)][::9]
    gaps = np.linalg.norm(own[:, None] - points[None, ::3], axis=2).min(axis=1)
    return float((gaps < 80).mean())


def gap_mm(points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Distances from places of the skin to the nearest cloth."""
    return np.linalg.norm(places[:, None] - points[None], axis=2).min(axis=1)


@pytest.mark.parametrize("garment", GARMENTS, ids=lambda g: g.name)
def test_garments_cover_the_torso_and_their_share_of_the_arms(garment) -> None:  # type: ignore[no-untyped-def]
    points = worn_points(make_garment(fitted(), garment, False, 1.0, 5))
    assert np.isfinite(points).all()
    assert covered(points, "torso") > 0.85
    assert covered(points, "hand") < 0.3
    assert covered(points, "arm") == pytest.approx(garment.sleeve, abs=0.35)


def test_a_shirt_rests_on_the_shoulders_and_hangs_below() -> None:
    shirt = next(g for g in GARMENTS if g.name == "shirt")
    points = worn_points(make_garment(fitted(), shirt, False, 1.0, 5))
    own = fitted()
    torso = np.zeros(len(own.skin), bool)
    torso[own.trunk.index] = True
    pit = own.armpits[:, 1].mean()
    high = torso & (own.normal[:, 1] > 0.9) & (own.skin[:, 1] > pit + 60)
    front = torso & (own.normal[:, 2] > 0.7)
    belly = front & (np.abs(own.skin[:, 1] - own.waist_mm) < 60)
    assert np.median(gap_mm(points, own.skin[high])) < 9
    assert 12 < np.median(gap_mm(points, own.skin[belly])) < 60


def test_cloth_spans_the_hollow_of_the_back_and_folds() -> None:
    """Around the trunk cloth is nearly convex; its folds make it rougher than the skin."""
    own = fitted()
    sweater = next(g for g in GARMENTS if g.name == "sweater")
    points = worn_points(make_garment(own, sweater, False, 1.0, 5))
    level = np.abs(points[:, 1] - (own.waist_mm + 60)) < 12
    ring = points[level][:, [0, 2]]
    ring = ring[np.abs(ring[:, 0] - own.neck[0]) < 230]
    skin = own.skin[own.trunk.index]
    there = skin[np.abs(skin[:, 1] - (own.waist_mm + 60)) < 12][:, [0, 2]]
    spine = there[np.abs(there[:, 0] - own.neck[0]) < 15, 1].min()
    beside = there[:, 1].min()
    cloth = ring[np.abs(ring[:, 0] - own.neck[0]) < 25, 1].min()
    assert cloth < min(spine, beside) - 3
    flat = next(g for g in GARMENTS if g.name == "sweater")
    plain = worn_points(make_garment(own, replace(flat, fold=0.0), False, 1.0, 5))
    assert plain.shape == points.shape
    moved = np.linalg.norm(points - plain, axis=1)
    assert 3 < np.percentile(moved, 90) < 30


def test_collars_and_hems_are_thick() -> None:
    """A collar rises over the neckline, and cloth at its edges has an inner side."""
    own = fitted()
    shirt = next(g for g in GARMENTS if g.name == "shirt")
    binding, faces, outside = make_garment(own, shirt, False, 1.0, 5)  # type: ignore[misc]
    points = binding.place(body().vertices_mm, still())
    over = (points - own.neck) @ UP
    near = np.linalg.norm(points - own.neck, axis=1) < 160
    assert over[near].max() > 25
    assert len(outside) < len(faces)
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    lone = set(map(tuple, sides)) - set(map(tuple, sides[:, ::-1]))
    rim = np.unique(np.array(list(lone)))
    inner = gap_mm(points[np.setdiff1d(np.arange(len(points)), rim)], points[rim])
    assert np.median(inner) < 20  # the lone edge is that of the turned-in strip


def test_trousers_reach_the_feet() -> None:
    made = make_lower(fitted(), lower("trousers"), True, 1.0, 5)
    assert covered(worn_points(made), "leg") > 0.85


def test_a_skirt_spans_the_space_between_the_legs() -> None:
    own = fitted()
    points = worn_points(make_lower(own, lower("skirt"), True, 1.0, 5))
    between = np.abs(points[:, 0] - own.neck[0]) < 20
    low = between & (points[:, 1] < own.crotch_mm - 80)
    assert low.sum() > 20
    knees = own.skin[np.isfinite(own.cloth.leg)]
    knees = knees[np.abs(knees[:, 1] - points[low, 1].mean()) < 60]
    assert points[low, 2].max() > knees[:, 2].max() - 10
    assert points[low, 2].min() < knees[:, 2].min() + 10


def test_a_skirt_follows_both_legs() -> None:
    """With one leg ahead the left half moves and the right half stays."""
    own = fitted()
    made = make_lower(own, lower("pencil skirt"), True, 1.0, 5)
    assert made is not None
    moved = body().vertices_mm.copy()
    left = body().is_in("leg") & (moved[:, 0] > own.neck[0])
    moved[left, 2] += 100
    shift = (made[0].place(moved, still()) - made[0].place(body().vertices_mm, still()))[:, 2]
    rest = worn_points(made)
    low = rest[:, 1] < own.crotch_mm - 60
    side = rest[:, 0] - own.neck[0]
    assert np.median(shift[low & (side > 90)]) == pytest.approx(100, abs=3)
    assert np.median(shift[low & (side < -90)]) == pytest.approx(0, abs=3)
    middle = shift[low & (np.abs(side) < 10)]
    assert np.all((middle > 20) & (middle < 80))


def test_cloth_lies_over_the_skin_in_a_posture() -> None:
    """Every point of the cloth of a posed frame is near the posed skin; hoods stand off most."""
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
            assert np.percentile(gaps, 95) < 80


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
