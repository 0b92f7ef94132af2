"""Cloth on whole people: it covers torso and legs, follows the posture, and leaves hands free."""

from functools import lru_cache

import numpy as np
import pytest

from glsim.faces.people.model import REGIONS
from glsim.looks import cloth
from glsim.looks.anatomy import Anatomy
from glsim.looks.binding import Shell, skull_motion
from glsim.looks.cloth import make_clothes
from glsim.looks.cloth_body import UP, ClothBody, fit_cloth, make_cloth_grid
from glsim.looks.dress import Dresser
from glsim.looks.garments import LOWER, SHOES, UPPER, Garment
from tests.support.people import needs_anny
from tests.support.wardrobe import ALL, appearance, keys

pytestmark = needs_anny


@lru_cache(maxsize=1)
def people():  # type: ignore[no-untyped-def]
    from glsim.faces.sources.people import People

    return People(seed=3)


@lru_cache(maxsize=1)
def body() -> Anatomy:
    source = people()
    vertices, faces = source.neutral("a0002")
    return Anatomy(source.name, vertices, faces, source.topology.regions, REGIONS)


@lru_cache(maxsize=1)
def fitted() -> ClothBody:
    grid = make_cloth_grid(body())
    return fit_cloth(grid, body().vertices_mm)


def clothes(upper: Garment, lower: Garment = LOWER[0], tucked: bool = False) -> list[Shell]:
    return [shell for shell, _ in make_clothes(fitted(), (upper, lower, SHOES), tucked, 1.0, 5)]


def points_of(worn: Shell) -> np.ndarray:
    """Where cloth lies on the body at rest."""
    vertices_mm = body().vertices_mm
    return worn.place(vertices_mm, skull_motion(vertices_mm[:3], vertices_mm[:3]))


def named(name: str) -> Garment:
    return next(g for g in (*UPPER, *LOWER) if g.name == name)


def covered(points: np.ndarray, region: str) -> float:
    """Share of a region's vertices with cloth within 80 mm."""
    return float((gap_mm(points[::3], body().vertices_mm[body().is_in(region)][::9]) < 80).mean())


def gap_mm(points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Distances from places of the skin to the nearest cloth."""
    return np.linalg.norm(places[:, None] - points[None], axis=2).min(axis=1)


@pytest.mark.parametrize("garment", UPPER, ids=lambda g: g.name)
def test_garments_cover_the_torso_and_their_share_of_the_arms(garment: Garment) -> None:
    points = points_of(clothes(garment)[0])
    assert np.isfinite(points).all()
    assert covered(points, "torso") > 0.85
    assert covered(points, "hand") < 0.3
    assert covered(points, "arm") == pytest.approx(garment.limb, abs=0.35)


def test_trousers_and_shoes_reach_the_floor() -> None:
    _, trousers, shoes = map(points_of, clothes(named("T-shirt")))
    assert covered(trousers, "leg") > 0.85
    assert covered(shoes, "foot") > 0.95
    assert shoes[:, 1].min() == pytest.approx(fitted().skin[:, 1].min(), abs=4)
    shorts = points_of(clothes(named("T-shirt"), named("shorts"))[1])
    assert covered(shorts, "leg") < 0.75


def test_a_shirt_rests_on_the_shoulders_and_hangs_below() -> None:
    points, own = points_of(clothes(named("shirt"))[0]), fitted()
    torso = own.part == 0
    high = torso & (own.normal[:, 1] > 0.9) & (own.skin[:, 1] > own.armpits[:, 1].mean() + 60)
    belly = torso & (own.normal[:, 2] > 0.7) & (np.abs(own.skin[:, 1] - own.waist_mm) < 60)
    assert np.median(gap_mm(points, own.skin[high])) < 9
    assert 12 < np.median(gap_mm(points, own.skin[belly])) < 60


def test_cloth_lies_outside_of_the_skin_spans_hollows_and_folds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cloth, "_DRAWN_SHARE", 1.0)
    own, sweater = fitted(), named("sweater")
    points = points_of(clothes(sweater)[0])
    level = own.waist_mm + 60
    skin = own.skin[(own.part == 0) & (np.abs(own.skin[:, 1] - level) < 12)][:, [0, 2]]
    ring = points[(np.abs(points[:, 1] - level) < 12)][:, [0, 2]]
    ring = ring[np.abs(ring[:, 0] - own.neck[0]) < 230]
    middle = np.array([own.neck[0], skin[:, 1].mean()])
    turn, around = (np.arctan2(*(p - middle).T) for p in (skin, ring))
    for place, angle in zip(skin, turn, strict=True):
        near = np.abs(np.angle(np.exp(1j * (around - angle)))) < 0.12
        assert np.linalg.norm(ring[near] - middle, axis=1).max() > np.linalg.norm(place - middle)
    spine = skin[np.abs(skin[:, 0] - own.neck[0]) < 15, 1].min()
    outer = ring[np.abs(ring[:, 0] - own.neck[0]) < 25, 1].min()
    assert outer < spine - 3
    _, folds = make_clothes(fitted(), (sweater, LOWER[0], SHOES), False, 1.0, 5)[0]
    assert folds[:, [3, 7]].min() == 0  # at the hem
    assert 5 < np.median(folds[:, 3]) < 25


@pytest.mark.parametrize(("name", "height"), [("shirt", 25), ("T-shirt", 5), ("turtleneck", 40)])
def test_collars_rise_over_the_neckline_and_cloth_ends_inside(name: str, height: float) -> None:
    worn, own = clothes(named(name))[0], fitted()
    points = points_of(worn)
    near = np.linalg.norm(points - own.neck, axis=1) < 160
    assert ((points - own.neck) @ UP)[near].max() > height
    sides = worn.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    lone = set(map(tuple, sides)) - set(map(tuple, sides[:, ::-1]))
    rim = np.unique(np.array(list(lone)))
    inner = gap_mm(points[np.setdiff1d(np.arange(len(points)), rim)], points[rim])
    assert np.median(inner) < 20  # the lone edge is that of the turned-in strip


def test_people_are_dressed_by_default_and_cloth_follows_a_posture() -> None:
    """Every point of the cloth of a posed frame is near the posed skin; hoods stand off most."""
    source = people()
    assert not Dresser(source, appearance(wear="never")).is_on
    there = Dresser(source, appearance(**{**ALL, "wear": "auto"}))
    face = next(iter(source.load(source.frames("a0002", 1))))
    dressed = there.dress(face, keys(2))
    skin = face.mesh.vertices_mm[body().body][::4]
    for part in dressed.parts:
        if part.region == "cloth":
            assert np.percentile(gap_mm(skin, part.mesh.vertices_mm[::25]), 95) < 80
