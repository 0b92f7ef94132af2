"""Hats, headphones and hands lie on heads of any shape, hide hair, and follow the head."""

from dataclasses import replace

import numpy as np
import pytest

from glsim.faces.face_source import Face
from glsim.looks.styles import STYLE_TABLE
from tests.support.wardrobe import dresser, frames, heads, keys, part

LANDMARKS, REGIONS = heads().topology.landmarks, np.array(heads().topology.region_names)
CENTRE = np.array([0.0, 25.0, -90.0])  # of a skull


def worn(subject: int, **values: object) -> Face:
    return dresser(**values).dress(frames(f"p000{subject}", 1)[0], keys(subject))


def above(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """How much farther out than each point its nearest direction of others is, mm; NaN: none."""
    far, near = (np.linalg.norm(p - CENTRE, axis=1) for p in (others, points))
    cosine = ((points - CENTRE) / near[:, None]) @ ((others - CENTRE) / far[:, None]).T
    return np.where(cosine.max(axis=1) > 0.999, far[cosine.argmax(axis=1)] - near, np.nan)


@pytest.mark.parametrize("subject", range(5))
def test_hats_lie_on_the_head_and_over_its_hair(subject: int) -> None:
    face = worn(subject, hat=1)
    hat, skin = part(face, "hat").mesh.vertices_mm, face.mesh.vertices_mm
    brow = skin[LANDMARKS[17:27], 1].max()
    ahead = (hat[:, 2] > 0) & (np.abs(hat[:, 0]) < 40)
    assert brow - 25 < hat[ahead, 1].min() < brow + 35  # a peak hangs before the brow
    gaps = above(skin[skin[:, 1] > brow + 60], hat)
    assert 2 < np.nanmin(gaps) < np.nanmedian(gaps) < 32
    hair = part(face, "hair").mesh
    seen = (hair.strands[:, 3] > 0) & (hair.vertices_mm[:, 1] > brow + 30)
    assert not (above(hair.vertices_mm[seen], hat) < -0.5).any()


@pytest.mark.parametrize("subject", range(5))
def test_headphones_enclose_the_ears_and_rest_on_the_hair(subject: int) -> None:
    face = worn(subject, headphones=1)
    points, skin = part(face, "headphones").mesh.vertices_mm, face.mesh.vertices_mm
    ears = skin[REGIONS[heads().topology.regions] == "ear"]
    cups = points[np.abs(points[:, 1] - ears[:, 1].mean()) < 55]
    assert np.abs(cups[:, 0]).max() > np.abs(ears[:, 0]).max() + 5
    assert (cups[:, 1:].min(axis=0) < ears[:, 1:].min(axis=0) + 5).all()
    assert (cups[:, 1:].max(axis=0) > ears[:, 1:].max(axis=0) - 5).all()
    assert 2 < points[:, 1].max() - skin[:, 1].max() < 30


@pytest.mark.parametrize("pose", STYLE_TABLE["hands"])
def test_hands_touch_the_face_and_follow_it(pose: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STYLE_TABLE, "hands", {pose: STYLE_TABLE["hands"][pose]})
    there, face = dresser(hand=1, glasses=0), frames("p0001", 1)[0]
    skins = [heads().neutral("p0001")[0], heads().person("p0001").frame({"AU26": 1.0})]
    shapes = [replace(face, mesh=replace(face.mesh, vertices_mm=skin)) for skin in skins]
    still, moved = (part(there.dress(f, keys(3)), "hand").mesh.vertices_mm for f in shapes)
    skin = skins[0][skins[0][:, 1] > skins[0][LANDMARKS[8], 1] - 15]
    assert np.linalg.norm(still[:, None] - skin, axis=2).min() < 4.5
    assert np.nanmin(above(skin, still)) > -25  # nor goes a finger through it
    share = (still - moved)[:, 1].mean() / (skins[0] - skins[1])[LANDMARKS[8], 1]
    assert share == pytest.approx(float(pose == "chin on fist"), abs=0.35)
